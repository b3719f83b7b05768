/* SPDX-License-Identifier: Apache-2.0 */
/* The commands of the `gnomon` program. Each takes its arguments with argv[0] "gnomon COMMAND" and gives the
 * exit status: 0 as expected, 1 failures, 2 wrong usage or bad input, 3 the harness failed, 4 nothing ran. */
#ifndef GNOMON_CTS_COMMANDS_H
#define GNOMON_CTS_COMMANDS_H

#include <stddef.h>

int gn_command_run(int argc, char **argv);
int gn_command_gate(int argc, char **argv);
/* Takes its arguments as they are, see cts/command_deqp.c. */
int gn_command_deqp(int argc, char **argv);
int gn_command_merge(int argc, char **argv);
int gn_command_replay(int argc, char **argv);
int gn_command_instrument(int argc, char **argv);
int gn_command_accuracy(int argc, char **argv);
int gn_command_effects(int argc, char **argv);
int gn_command_rules(int argc, char **argv);
int gn_command_clauses(int argc, char **argv);
int gn_command_layer(int argc, char **argv);

/* The folder of the layer, beside that of this program; "" with a message on stderr if it is not there. */
void gn_layer_find(char *out, size_t size);

/* What the user types for this program: GNOMON_COMMAND, which a wrapper may set, or argv[0] of main(). */
extern const char *gn_command_name;

#endif
