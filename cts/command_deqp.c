/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `gnomon --deqp-...`: the program as deqp-runner starts one of VK-GL-CTS: cases from a list, one after another in this process, a
 * line as each begins and one with its status. A crash is the process's, as deqp-runner expects it.
 */
#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cts/commands.h"
#include "cts/driver.h"
#include "cts/select.h"
#include "cts/worker.h"

struct session {
    const char *list, *log, *driver;
    const char *patterns; /* of --deqp-case, parted by commas */
    uint64_t seed;
    double scale;
};

/* The value of "NAME=VALUE", or NULL. */
static const char *value_of(const char *argument, const char *name)
{
    size_t length = strlen(name);
    return strncmp(argument, name, length) == 0 && argument[length] == '=' ? argument + length + 1 : NULL;
}

/* Options of VK-GL-CTS that have no meaning here are passed over, as those of surfaces are. */
static bool parse(struct session *session, int argc, char **argv)
{
    for (int i = 1; i < argc; i++) {
        const char *value, *argument = argv[i];
        if (strcmp(argument, "-n") == 0 && i + 1 < argc) {
            session->patterns = argv[++i];
        } else if ((value = value_of(argument, "--deqp-caselist-file"))) {
            session->list = value;
        } else if ((value = value_of(argument, "--deqp-case"))) {
            session->patterns = value;
        } else if ((value = value_of(argument, "--deqp-log-filename"))) {
            session->log = value;
        } else if ((value = value_of(argument, "--deqp-base-seed"))) {
            char *end;
            errno = 0;
            session->seed = strtoull(value, &end, 10);
            if (*end || errno || !isdigit((unsigned char)*value)) {
                fprintf(stderr, "gnomon: --deqp-base-seed: expected a whole number up to 2^64-1, found '%s'\n", value);
                return false;
            }
        } else if ((value = value_of(argument, "--driver"))) {
            session->driver = value;
        } else if ((value = value_of(argument, "--scale")) && strtod(value, NULL) > 0) {
            session->scale = strtod(value, NULL);
        } else if (strncmp(argument, "--deqp-", 7) != 0) {
            fprintf(stderr, "gnomon: expected options of VK-GL-CTS, --driver=ICD.json or --scale=X, found '%s'\n", argument);
            return false;
        }
    }
    if (!session->list == !session->patterns) {
        fprintf(stderr, "gnomon: expected one of --deqp-caselist-file=FILE and --deqp-case=PATTERN\n");
        return false;
    }
    return true;
}

static bool is_wanted(const char *patterns, const char *name)
{
    bool wanted = false;
    for (const char *at = patterns; *at && !wanted; at += strcspn(at, ","), at += *at == ',') {
        char *pattern = strndup(at, strcspn(at, ","));
        wanted = pattern && gn_pattern_matches(pattern, name);
        free(pattern);
    }
    return wanted;
}

static const char *status_word(enum gn_case_status status)
{
    switch (status) {
    case GN_CASE_PASS:
        return "Pass";
    case GN_CASE_SKIP:
        return "NotSupported";
    case GN_CASE_ERROR:
        return "InternalError";
    default:
        return "Fail";
    }
}

/* False when the device is of no use any more. */
static bool run_case(const struct gn_selected *selected, struct gn_device *device, const struct session *session,
                     FILE *log, uint64_t counts[GN_CASE_STATUS_COUNT])
{
    struct gn_case_run run;
    char message[sizeof run.result.message + sizeof "leak: "];
    printf("Test case '%s'..\n", selected->name);
    fflush(stdout);
    gn_worker_test_fault(selected->name);
    gn_case_execute(selected->self, selected->name, selected->backend, device, session->seed, session->scale, -1, -1, &run);
    enum gn_case_status status = run.result.status;
    snprintf(message, sizeof message, "%s%s", status == GN_CASE_LEAK ? "leak: " : "", run.result.message);
    gn_text_clean(message);
    message[strcspn(message, "\n")] = 0;
    printf("  %s (%s)\n\n", status_word(status), *message ? message : status_word(status));
    fflush(stdout);
    counts[status]++;
    if (log) {
        fprintf(log, "\n#beginTestCaseResult %s\n<TestCaseResult CasePath=\"%s\">\n <Number Name=\"TestDuration\" Unit=\"us\">%.0f</Number>\n <Result "
                     "StatusCode=\"%s\">", selected->name, selected->name, 1e6 * run.result.seconds, status_word(status));
        for (const char *at = message; *at; at++)
            fputs(*at == '&' ? "&amp;" : *at == '<' ? "&lt;" : *at == '>' ? "&gt;" : (char[]){*at, 0}, log);
        fputs("</Result>\n</TestCaseResult>\n#endTestCaseResult\n", log);
        fflush(log);
    }
    gn_case_run_finish(&run);
    return status != GN_CASE_ERROR;
}

/* The names of the list file that this suite has; others are said on stderr, and deqp-runner then finds them missing. */
static size_t read_list(const char *path, const struct gn_selected *catalogue, size_t catalogue_count,
                        const struct gn_selected **out)
{
    char error[512], *data = NULL;
    size_t length = 0, count = 0;
    if (!gn_file_read(path, 64 << 20, &data, &length, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        return SIZE_MAX;
    }
    for (char *line = strtok(data, "\r\n"); line; line = strtok(NULL, "\r\n")) {
        const struct gn_selected *found = gn_catalogue_find(catalogue, catalogue_count, line);
        if (found && count < catalogue_count)
            out[count++] = found;
        else if (*line)
            fprintf(stderr, "gnomon: no case is named '%s'\n", line);
    }
    free(data);
    return count;
}

int gn_command_deqp(int argc, char **argv)
{
    struct session session = {.seed = 1, .scale = 1};
    struct gn_arena arena = {0};
    struct gn_device *device = NULL;
    struct gn_selected *catalogue = NULL;
    const struct gn_selected **cases = NULL;
    FILE *log = NULL;
    char error[2048];
    uint64_t counts[GN_CASE_STATUS_COUNT] = {0};
    size_t catalogue_count = 0, count = 0, done = 0;
    int status = 2;
    if (!parse(&session, argc, argv))
        goto done;
    catalogue = gn_catalogue(&arena, &catalogue_count);
    cases = calloc(catalogue_count, sizeof *cases);
    if (!cases) {
        fprintf(stderr, "gnomon: out of memory\n");
        status = 3;
        goto done;
    }
    if (session.list) {
        count = read_list(session.list, catalogue, catalogue_count, cases);
        if (count == SIZE_MAX)
            goto done;
    } else {
        for (size_t i = 0; i < catalogue_count; i++)
            if (is_wanted(session.patterns, catalogue[i].name))
                cases[count++] = &catalogue[i];
    }
    if (!count) {
        fprintf(stderr, "gnomon: nothing ran: no case is named so\n");
        status = 4;
        goto done;
    }
    const char *driver = gn_driver_resolve(session.driver, &arena, error, sizeof error);
    struct gn_device_options options = {driver && *driver ? driver : NULL, -1};
    device = driver ? gn_device_create(&options, error, sizeof error) : NULL;
    if (!device) {
        fprintf(stderr, "gnomon: %s\n", error);
        goto done;
    }
    if (session.log && !(log = fopen(session.log, "w"))) {
        perror(session.log);
        goto done;
    }
    printf("Writing test log into %s\ngnomon %s starting..\n  target implementation = '%s'\n\n",
           session.log ? session.log : "nothing", gn_version(), gn_device_info(device)->name);
    if (log)
        fprintf(log, "#sessionInfo releaseName gnomon-%s\n#beginSession\n", gn_version());
    bool usable = true;
    while (usable && done < count)
        usable = run_case(cases[done++], device, &session, log, counts);
    if (log)
        fputs("\n#endSession\n", log);
    if (usable)
        printf("DONE!\n");
    printf("\nTest run totals:\n  Passed:        %llu/%zu\n  Failed:        %llu/%zu\n  Not supported: %llu/%zu\n",
           (unsigned long long)counts[GN_CASE_PASS], done,
           (unsigned long long)(counts[GN_CASE_FAIL] + counts[GN_CASE_LEAK] + counts[GN_CASE_ERROR]), done,
           (unsigned long long)counts[GN_CASE_SKIP], done);
    /* As VK-GL-CTS: 1 tells that something failed. */
    status = counts[GN_CASE_FAIL] || counts[GN_CASE_LEAK] || counts[GN_CASE_ERROR] ? 1 : 0;
    bool written = fflush(stdout) == 0 && !ferror(stdout);
    if (!written)
        fprintf(stderr, "gnomon: cannot write the results to standard output\n");
    if (log && (fflush(log) != 0 || ferror(log))) {
        fprintf(stderr, "gnomon: cannot write %s\n", session.log);
        written = false;
    }
    if (!written)
        status = 3;
done:
    if (log)
        fclose(log);
    gn_device_destroy(device);
    free(cases);
    free(catalogue);
    gn_arena_finish(&arena);
    return status;
}
