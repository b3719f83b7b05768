/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon replay FILE`. */
#include "cts/commands.h"
int gn_command_replay(int argc, char **argv)
{
    (void)argc; (void)argv;
    return 2;
}
