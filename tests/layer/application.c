/* SPDX-License-Identifier: Apache-2.0 */
/* An application for `gnomon layer`, which knows nothing of the layer: application MODE...
 *   right      builds a BLAS, then a TLAS
 *   wrong      builds the TLAS only
 *   leave      as wrong, but ends without destroying anything
 *   fork       as wrong, with a child that ends at once and knows nothing of it
 *   abort      as wrong, and ends by abort()
 *   wait       as wrong, and waits to be terminated, having printed a line
 *   fail       as right, and ends with status 7 */
#include "tests/layer/harness.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

int main(int argc, char **argv)
{
    const char *mode = argc == 2 ? argv[1] : "";
    struct world_options options = {.without_layer = true, .without_messenger = true};
    struct world *world = calloc(1, sizeof *world);
    if (!world)
        return 3;
    world_init(world, &options);
    struct structure blas = blas_create(world, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, 0);
    struct structure tlas = tlas_create(world, 1);
    tlas_refer(&tlas, 0, blas.address);
    VkCommandBuffer commands = commands_begin(world, 0);
    if (strcmp(mode, "right") == 0 || strcmp(mode, "fail") == 0) {
        commands_build_one(world, commands, &blas);
        commands_barrier(commands);
    }
    commands_build_one(world, commands, &tlas);
    commands_end(commands);
    submit_and_wait(world, commands);
    if (strcmp(mode, "leave") == 0)
        exit(0);
    if (strcmp(mode, "fork") == 0) {
        pid_t child = fork();
        if (child == 0)
            exit(0);
        waitpid(child, NULL, 0);
    }
    if (strcmp(mode, "abort") == 0)
        abort();
    if (strcmp(mode, "wait") == 0) {
        puts("waiting");
        fflush(stdout);
        for (;;)
            pause();
    }
    structure_destroy(world, &tlas);
    structure_destroy(world, &blas);
    world_finish(world);
    free(world);
    return strcmp(mode, "fail") == 0 ? 7 : 0;
}
