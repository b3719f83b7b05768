/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon merge`: joins the shards of a run into one folder with all reports. */
#include <argp.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cts/commands.h"
#include "cts/expect.h"
#include "cts/output.h"
#include "cts/progress.h"

enum { OPTION_OUT = 256, OPTION_EXPECT };

static const struct argp_option argp_options[] = {
    {"out", OPTION_OUT, "DIR", 0, "Where the joined reports go (default: gnomon-out)", 0},
    {"expect", OPTION_EXPECT, "FILE", 0, "As for `gnomon run`; may be repeated", 0},
    {0},
};

struct arguments {
    const char *out;
    const char **folders, **expects;
    size_t folder_count, expect_count;
};

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    switch (key) {
    case OPTION_OUT:
        arguments->out = argument;
        return 0;
    case OPTION_EXPECT:
        arguments->expects[arguments->expect_count++] = argument;
        return 0;
    case ARGP_KEY_ARG:
        arguments->folders[arguments->folder_count++] = argument;
        return 0;
    case ARGP_KEY_END:
        if (!arguments->folder_count)
            argp_error(state, "expected the folders of the shards");
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

/* One shard as it lies in its folder. */
struct shard {
    const char *folder;
    struct gn_results results;
};

static bool read_shard(struct shard *shard, char *out_error, size_t error_size)
{
    char path[4096], error[600], *text = NULL;
    size_t length = 0;
    struct gn_results *results = &shard->results;
    struct gn_results_run run;
    gn_results_init(results);
    snprintf(path, sizeof path, "%s/run.json", shard->folder);
    if (!gn_file_read(path, 1 << 20, &text, &length, error, sizeof error)) {
        snprintf(out_error, error_size, "%s is no folder of a run: %s", shard->folder, error);
        return false;
    }
    bool ok = gn_results_run_decode(text, length, &results->arena, &run, error, sizeof error);
    free(text);
    if (!ok) {
        snprintf(out_error, error_size, "%s/run.json: %s", shard->folder, error);
        return false;
    }
    results->run = run;
    snprintf(path, sizeof path, "%s/results.jsonl", shard->folder);
    if (!gn_results_jsonl_read(results, path, out_error, error_size))
        return false;
    for (size_t i = 0; i < results->count; i++)
        results->seconds += results->cases[i].seconds;
    if (results->count < run.selected) {
        snprintf(out_error, error_size,
                 "%s has %zu of its %" PRIu64 " cases: run it to its end, with --resume, before it is joined",
                 shard->folder, results->count, run.selected);
        return false;
    }
    return true;
}

/* Shards that have cases, and so a device, come first. */
static int compare_shards(const void *a, const void *b)
{
    const struct shard *x = a, *y = b;
    return !x->results.run.selected - !y->results.run.selected;
}

/* Whether the shards are the parts of one run, each of them once. */
static bool fit(const struct shard *shards, size_t count, char *out_error, size_t error_size)
{
    const struct gn_results_run *first = &shards[0].results.run;
    for (size_t i = 1; i < count; i++) {
        const struct gn_results_run *run = &shards[i].results.run;
        struct gn_results_run copy = *run;
        /* Where there was no case, no device was opened. */
        if (!run->selected)
            copy.device = first->device;
        const char *what = gn_results_run_difference(first, &copy);
        if (!what && run->shard_count != first->shard_count)
            what = "number of shards";
        if (!what && run->durations != first->durations)
            what = "file of durations";
        if (what) {
            snprintf(out_error, error_size, "%s has another %s than %s", shards[i].folder, what, shards[0].folder);
            return false;
        }
        for (size_t j = 0; j < i && first->shard_count > 1; j++) {
            if (shards[j].results.run.shard == run->shard) {
                snprintf(out_error, error_size, "%s and %s are both shard %u of %u", shards[j].folder, shards[i].folder,
                         run->shard, run->shard_count);
                return false;
            }
        }
    }
    for (uint32_t wanted = 1; wanted <= first->shard_count; wanted++) {
        bool found = false;
        for (size_t i = 0; i < count && !found; i++)
            found = shards[i].results.run.shard == wanted;
        if (!found) {
            snprintf(out_error, error_size, "shard %u of %u is missing", wanted, first->shard_count);
            return false;
        }
    }
    return true;
}

static int compare_names(const void *a, const void *b)
{
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

static bool is_disjoint(const struct shard *shards, size_t count, char *out_error, size_t error_size)
{
    size_t total = 0, n = 0;
    bool ok = true;
    for (size_t i = 0; i < count; i++)
        total += shards[i].results.count;
    const char **names = calloc(total ? total : 1, sizeof *names);
    if (!names) {
        snprintf(out_error, error_size, "out of memory for %zu cases", total);
        return false;
    }
    for (size_t i = 0; i < count; i++)
        for (size_t c = 0; c < shards[i].results.count; c++)
            names[n++] = shards[i].results.cases[c].name;
    qsort(names, total, sizeof *names, compare_names);
    for (size_t i = 1; i < total && ok; i++) {
        ok = strcmp(names[i - 1], names[i]) != 0;
        if (!ok)
            snprintf(out_error, error_size, "%s is in more than one of the folders", names[i]);
    }
    free(names);
    return ok;
}

static bool is_same_folder(const char *a, const char *b)
{
    struct stat x, y;
    return stat(a, &x) == 0 && stat(b, &y) == 0 && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}

/* Writes everything; gives the exit status. */
static int join(const struct shard *shards, size_t count, const char *out, const struct gn_expectations *expectations,
                struct gn_results *results)
{
    struct gn_output output = {0};
    struct gn_results earlier;
    char error[1024];
    int status = 2;
    gn_results_init(&earlier);
    results->run = shards[0].results.run;
    results->run.shard = results->run.shard_count = 1;
    results->run.selected = 0;
    results->run.command = gn_command_name;
    for (size_t i = 0; i < count; i++) {
        results->run.selected += shards[i].results.run.selected;
        /* The shards ran beside each other: together they took as long as the longest. */
        results->seconds = shards[i].results.seconds > results->seconds ? shards[i].results.seconds : results->seconds;
    }
    if (!gn_output_open(&output, out, &earlier, &status, error, sizeof error) ||
        !gn_output_begin(&output, results, false, &status, error, sizeof error))
        goto fail;
    status = 3;
    for (size_t i = 0; i < count; i++) {
        for (size_t c = 0; c < shards[i].results.count; c++) {
            struct gn_results_case cs = shards[i].results.cases[c];
            gn_expectations_apply(expectations, &cs);
            if (!gn_output_take(&output, shards[i].folder, &cs, error, sizeof error))
                goto fail;
            gn_results_add(results, &cs);
        }
    }
    gn_results_sort(results);
    bool written = gn_output_end(&output, results, error, sizeof error);
    status = written ? gn_results_exit_status(results) : 3;
    gn_summary_print(results, out);
    if (!written)
        goto fail;
    printf("\nreport: %s/report.html\n", out);
    goto done;
fail:
    fprintf(stderr, "gnomon: %s\n", error);
done:
    gn_output_close(&output);
    gn_results_finish(&earlier);
    return status;
}

int gn_command_merge(int argc, char **argv)
{
    static const struct argp argp = {
        argp_options,
        parse,
        "DIR...",
        "Joins the folders of a run's shards (`gnomon run --shard I/N`) into one with all reports. Every shard has to be "
        "there once, whole, and of the same suite, seed and driver.\v"
        "Exit status: 0 as expected, 1 failures, 2 wrong usage, or folders that are no parts of one run, 3 the harness "
        "itself failed, 4 every case was skipped.",
        NULL,
        NULL,
        NULL};
    struct gn_results results;
    struct gn_expectations expectations = {0};
    char error[1024];
    int status = 2;
    gn_results_init(&results);
    struct arguments arguments = {.out = "gnomon-out",
                                  .folders = GN_NEW(&results.arena, const char *, (size_t)argc),
                                  .expects = GN_NEW(&results.arena, const char *, (size_t)argc)};
    struct shard *shards = NULL;
    size_t read = 0;
    if (argp_parse(&argp, argc, argv, 0, NULL, &arguments) != 0)
        goto done;
    shards = calloc(arguments.folder_count, sizeof *shards);
    if (!shards) {
        fprintf(stderr, "gnomon: out of memory\n");
        status = 3;
        goto done;
    }
    bool ok = true;
    for (; ok && read < arguments.folder_count; read++) {
        shards[read].folder = arguments.folders[read];
        ok = read_shard(&shards[read], error, sizeof error);
        if (ok && is_same_folder(arguments.folders[read], arguments.out)) {
            snprintf(error, sizeof error, "--out: %s is one of the folders to be joined", arguments.out);
            ok = false;
        }
    }
    for (size_t i = 0; ok && i < arguments.expect_count; i++)
        ok = gn_expectations_read(&expectations, arguments.expects[i], &results.arena, error, sizeof error);
    if (ok)
        qsort(shards, read, sizeof *shards, compare_shards);
    ok = ok && fit(shards, read, error, sizeof error) && is_disjoint(shards, read, error, sizeof error) &&
         gn_expectations_fit(&expectations, &shards[0].results.run.device, error, sizeof error);
    if (!ok) {
        fprintf(stderr, "gnomon: %s\n", error);
        goto done;
    }
    size_t catalogue_count = 0;
    struct gn_selected *catalogue = gn_catalogue(&results.arena, &catalogue_count);
    gn_expectations_check(&expectations, catalogue, catalogue_count, &results);
    free(catalogue);
    status = join(shards, read, arguments.out, &expectations, &results);
done:
    for (size_t i = 0; i < read; i++)
        gn_results_finish(&shards[i].results);
    free(shards);
    gn_expectations_finish(&expectations);
    gn_results_finish(&results);
    return status;
}
