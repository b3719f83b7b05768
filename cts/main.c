/* SPDX-License-Identifier: Apache-2.0 */
/* The `gnomon` program: finds the command and runs it. */
#include <argp.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cts/commands.h"
#include "cts/results.h"
#include "cts/worker.h"

static const struct {
    const char *name;
    int (*run)(int argc, char **argv);
    const char *title;
    const char *help; /* NULL: not for use by hand */
} commands[] = {
    {"run", gn_command_run, "gnomon run", "run the conformance suite on a driver and write reports"},
    {"gate", gn_command_gate, "gnomon gate", "may this driver change land? Compare with expectations or another driver"},
    {"merge", gn_command_merge, "gnomon merge", "join the shards of a run"},
    {"replay", gn_command_replay, "gnomon replay",
     "re-run a failing ray or case and explain it step by step"},
    {"accuracy", gn_command_accuracy, "gnomon accuracy", "measure what accuracy costs in time: table and plot"},
    {"effects", gn_command_effects, "gnomon effects", "say what a scene calls for, what is left out, and what it would cost"},
    {"instrument", gn_command_instrument, "gnomon instrument", "judge one shader and write it with run-time checks"},
    {"layer", gn_command_layer, "gnomon layer", "run an application under the layer and judge its use of ray tracing"},
    {"rules", gn_command_rules, "gnomon rules", "list the layer's rules, with severity, remedy and sources"},
    {"clauses", gn_command_clauses, "gnomon clauses", "list the statements of the API documents, and what holds each"},
    {"worker", gn_worker_main, "gnomon worker", NULL},
};
#define COMMAND_COUNT (sizeof commands / sizeof commands[0])

static void list_commands(FILE *file)
{
    for (size_t i = 0; i < COMMAND_COUNT; i++)
        if (commands[i].help)
            fprintf(file, "  %-8s %s\n", commands[i].name, commands[i].help);
}

static void usage(FILE *file)
{
    fprintf(file, "usage: gnomon COMMAND [OPTION...]\n\n");
    list_commands(file);
    fprintf(
        file,
        "\n`gnomon COMMAND --help` describes its options; `gnomon --version` says which version this is.\n"
        "Exit status: 0 as expected, 1 failures, 2 wrong usage or bad input, 3 the harness itself failed,\n"
        "4 nothing ran.\n");
}

int main(int argc, char **argv)
{
    const char *given = getenv("GNOMON_COMMAND");
    gn_command_name = given && *given ? given : argc && argv[0] && *argv[0] ? argv[0] : "gnomon";
    argp_err_exit_status = 2;
    /* A file beyond the limit of file sizes is an error of writing; workers inherit this. */
    signal(SIGXFSZ, SIG_IGN);
    if (argc < 2) {
        usage(stderr);
        return 2;
    }
    if (strcmp(argv[1], "--version") == 0 || strcmp(argv[1], "-V") == 0) {
        printf("gnomon %s\n", gn_version());
        return 0;
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 || strcmp(argv[1], "-?") == 0 ||
        strcmp(argv[1], "help") == 0) {
        usage(stdout);
        return 0;
    }
    if (strncmp(argv[1], "--deqp-", 7) == 0)
        return gn_command_deqp(argc, argv);
    for (size_t i = 0; i < COMMAND_COUNT; i++) {
        if (strcmp(argv[1], commands[i].name) != 0)
            continue;
        if (!commands[i].help)
            return commands[i].run(argc, argv);
        /* argp names the program by argv[0]. */
        char title[64];
        snprintf(title, sizeof title, "%s", commands[i].title);
        argv[1] = title;
        return commands[i].run(argc - 1, argv + 1);
    }
    fprintf(stderr, "gnomon: there is no command '%s'; there are\n", argv[1]);
    list_commands(stderr);
    return 2;
}
