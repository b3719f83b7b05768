/* SPDX-License-Identifier: Apache-2.0 */
/* One run of the suite for each fault, each in a process of its own, and what became of the cases. */
#include "cts/selftest.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cts/progress.h"

#define LAYER "VK_LAYER_GNOMON_faulty"
#define LIBRARY "libVkLayer_gnomon_faulty.so"

/* Most faults show in nearly every ray; those that show in one place have a case that looks there. */
static const double ray_share = 0.02;
/* So many cases of each family come first, and all of the families that look at single places. The rest runs when these
 * have caught nothing. */
enum { SAMPLE = 3 };
static const char *const whole_families[] = {"exact", "planted"};

struct fault {
    const char *name, *text;
    size_t caught, *by_family; /* how many cases noticed it */
    double seconds;
};

struct selftest {
    const struct gn_run_options *options;
    const struct gn_run_plan *plan;
    const char *driver;
    struct gn_arena arena;
    char folder[PATH_MAX]; /* of the layer */
    struct fault *faults;
    size_t fault_count;
    const char **families;
    size_t family_count;
    enum gn_case_status *without; /* by case of the plan; GN_CASE_STATUS_COUNT: it did not run */
    struct gn_run_plan sample; /* some of the plan's cases */
};

/* The layer lies beside the program in the build, or where GNOMON_FAULTY_LAYER says. */
static bool layer_find(struct selftest *test)
{
    char program[PATH_MAX];
    const char *named = getenv("GNOMON_FAULTY_LAYER");
    ssize_t length = readlink("/proc/self/exe", program, sizeof program - 1);
    if (!named && length > 0) {
        program[length] = 0;
        char *folder = gn_arena_printf(&test->arena, "%s/../tests/faulty", dirname(program));
        if (realpath(folder, test->folder))
            return true;
    }
    if (named && realpath(named, test->folder))
        return true;
    fprintf(stderr, "gnomon: --selftest: expected the folder of the faulty layer in %s\n",
            named ? named : "../tests/faulty beside this program, where a build with tests has it");
    return false;
}

static bool faults_list(struct selftest *test, const char *pattern)
{
    char path[PATH_MAX + 64];
    snprintf(path, sizeof path, "%s/" LIBRARY, test->folder);
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    bool (*describe)(size_t, const char **, const char **) = NULL;
    /* The way POSIX has for symbols that are functions. */
    if (library)
        *(void **)&describe = dlsym(library, "gn_faulty_describe");
    if (!describe) {
        fprintf(stderr, "gnomon: --selftest: %s\n", dlerror());
        return false;
    }
    const char *name, *text;
    size_t all = 0;
    while (describe(all, &name, &text))
        all++;
    test->faults = GN_NEW(&test->arena, struct fault, all);
    for (size_t i = 0; describe(i, &name, &text); i++)
        if (gn_pattern_matches(pattern, name))
            test->faults[test->fault_count++] =
                (struct fault){.name = name, .text = text, .by_family = GN_NEW(&test->arena, size_t, test->family_count)};
    if (!test->fault_count)
        fprintf(stderr, "gnomon: --selftest: no fault matches '%s'\n", pattern);
    return test->fault_count > 0;
}

static size_t family_of(const struct selftest *test, const struct gn_case_family *family)
{
    for (size_t i = 0; i < test->family_count; i++)
        if (strcmp(test->families[i], family->name) == 0)
            return i;
    return 0;
}

/* The families of the plan, in its order. */
static void families_list(struct selftest *test)
{
    test->families = GN_NEW(&test->arena, const char *, gn_case_family_count);
    for (size_t i = 0; i < test->plan->count; i++) {
        const char *name = test->plan->cases[i].family->name;
        if (!test->family_count || strcmp(test->families[family_of(test, test->plan->cases[i].family)], name) != 0)
            test->families[test->family_count++] = name;
    }
}

static void sample_make(struct selftest *test)
{
    size_t *seen = GN_NEW(&test->arena, size_t, test->family_count), *all = GN_NEW(&test->arena, size_t, test->family_count);
    test->sample = *test->plan;
    test->sample.cases = GN_NEW(&test->arena, struct gn_selected, test->plan->count);
    test->sample.count = 0;
    for (size_t i = 0; i < test->plan->count; i++)
        all[family_of(test, test->plan->cases[i].family)]++;
    for (size_t i = 0; i < test->plan->count; i++) {
        const size_t family = family_of(test, test->plan->cases[i].family), place = seen[family]++;
        /* Evenly over the family: where the share of SAMPLE that is due grows by one. */
        bool taken = place * SAMPLE / all[family] != (place + 1) * SAMPLE / all[family];
        for (size_t w = 0; w < sizeof whole_families / sizeof whole_families[0]; w++)
            taken = taken || strcmp(test->families[family], whole_families[w]) == 0;
        if (taken)
            test->sample.cases[test->sample.count++] = test->plan->cases[i];
    }
}

/* Never returns. */
static void child(const struct selftest *test, const struct gn_run_plan *plan, const char *fault, const char *out)
{
    struct gn_run_options options = *test->options;
    struct gn_results results;
    char path[2 * PATH_MAX];
    const char *old = getenv("VK_ADD_LAYER_PATH");
    snprintf(path, sizeof path, "%s.log", out);
    int log = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (log < 0 || dup2(log, STDOUT_FILENO) < 0 || dup2(log, STDERR_FILENO) < 0)
        _exit(3);
    snprintf(path, sizeof path, "%s%s%s", test->folder, old && *old ? ":" : "", old ? old : "");
    setenv("VK_ADD_LAYER_PATH", path, 1);
    setenv("VK_INSTANCE_LAYERS", LAYER, 1);
    setenv("GNOMON_FAULT", fault, 1);
    options.scale *= ray_share;
    options.max_fails = 0;
    gn_results_init(&results);
    int exit_status = gn_run_plan_run(plan, &options, test->driver, out, "--selftest", &results);
    gn_results_finish(&results);
    fflush(stdout);
    _exit(exit_status);
}

/* Reads what came of the cases into out_statuses; false when the run left nothing to read. */
static bool statuses_read(struct selftest *test, const char *out, enum gn_case_status *out_statuses)
{
    char error[512], *text = NULL;
    size_t length = 0;
    for (size_t i = 0; i < test->plan->count; i++)
        out_statuses[i] = GN_CASE_STATUS_COUNT;
    const char *path = gn_arena_printf(&test->arena, "%s/results.jsonl", out);
    if (!gn_file_read(path, 1u << 30, &text, &length, error, sizeof error)) {
        fprintf(stderr, "gnomon: --selftest: %s; %s.log may say why\n", error, out);
        return false;
    }
    for (char *line = text, *end; (end = memchr(line, '\n', (size_t)(text + length - line))); line = end + 1) {
        struct gn_arena arena = {0};
        struct gn_results_case cs;
        /* The summary is no case. */
        if (gn_results_case_decode(line, (size_t)(end - line), &arena, &cs, error, sizeof error)) {
            const struct gn_selected *selected = gn_catalogue_find(test->plan->cases, test->plan->count, cs.name);
            if (selected)
                out_statuses[selected - test->plan->cases] = cs.status;
        }
        gn_arena_finish(&arena);
    }
    free(text);
    return true;
}

/* An empty name is the driver as it is. False when the harness failed or was interrupted. */
static bool run_with(struct selftest *test, const struct gn_run_plan *plan, const char *fault,
                     enum gn_case_status *out_statuses)
{
    int status = 0;
    const char *out = gn_arena_printf(&test->arena, "%s/%s", test->options->out, *fault ? fault : "none");
    fflush(stdout);
    pid_t pid = fork();
    if (pid == 0)
        child(test, plan, fault, out);
    if (pid < 0) {
        fprintf(stderr, "gnomon: --selftest: cannot start a process: %s\n", strerror(errno));
        return false;
    }
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    /* 4 is a driver that could not even be opened: everything is lost, which reads as not run. */
    if (!WIFEXITED(status) || WEXITSTATUS(status) == 2 || WEXITSTATUS(status) == 3) {
        fprintf(stderr, "gnomon: --selftest: the run with '%s' did not end well; see %s.log\n", fault, out);
        return false;
    }
    return statuses_read(test, out, out_statuses);
}

/* Whether a case says more against the driver than it did. A skip says nothing. */
static bool noticed(enum gn_case_status without, enum gn_case_status with)
{
    if (with == GN_CASE_STATUS_COUNT || with == GN_CASE_SKIP || with == GN_CASE_PASS || with == without)
        return false;
    return without == GN_CASE_PASS || (without == GN_CASE_LEAK && with != GN_CASE_LEAK);
}

static void fault_print(const struct selftest *test, const struct fault *fault)
{
    printf("%-7s %-28s %s\n", fault->caught ? "caught" : "MISSED", fault->name, fault->text);
    if (!fault->caught)
        return;
    printf("        %zu case%s:", fault->caught, fault->caught == 1 ? "" : "s");
    for (size_t f = 0; f < test->family_count; f++)
        if (fault->by_family[f])
            printf(" %s %zu", test->families[f], fault->by_family[f]);
    printf("\n");
}

static void families_print(const struct selftest *test)
{
    printf("\n%-16s %6s %6s  %s\n", "family", "caught", "alone", "what no other family caught");
    for (size_t f = 0; f < test->family_count; f++) {
        size_t caught = 0, alone = 0;
        const char *list = "";
        for (size_t i = 0; i < test->fault_count; i++) {
            const struct fault *fault = &test->faults[i];
            caught += fault->by_family[f] > 0;
            if (fault->by_family[f] && fault->by_family[f] == fault->caught) {
                alone++;
                list = gn_arena_printf((struct gn_arena *)&test->arena, "%s%s%s", list, *list ? " " : "", fault->name);
            }
        }
        printf("%-16s %6zu %6zu  %s\n", test->families[f], caught, alone, list);
    }
}

int gn_selftest_run(const struct gn_run_options *options, const struct gn_run_plan *plan, const char *driver,
                    const char *pattern)
{
    struct selftest test = {.options = options, .plan = plan, .driver = driver};
    size_t missed = 0;
    char error[512], took[32];
    int exit_status = 2;
    families_list(&test);
    if (!layer_find(&test) || !faults_list(&test, pattern))
        goto done;
    if (!gn_folder_create(options->out, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        goto done;
    }
    exit_status = 3;
    sample_make(&test);
    test.without = GN_NEW(&test.arena, enum gn_case_status, plan->count);
    enum gn_case_status *with = GN_NEW(&test.arena, enum gn_case_status, plan->count);
    const double begin = gn_clock();
    if (!run_with(&test, plan, "", test.without))
        goto done;
    size_t judged = 0;
    for (size_t i = 0; i < plan->count; i++)
        judged += test.without[i] == GN_CASE_PASS;
    printf("%zu faults; %zu cases, %zu of which pass without a fault; %zu of them come first\n\n", test.fault_count,
           plan->count, judged, test.sample.count);
    if (!judged) {
        fprintf(stderr, "gnomon: nothing ran: no case passes on this driver as it is; see %s/none.log\n", options->out);
        exit_status = 4;
        goto done;
    }
    for (size_t i = 0; i < test.fault_count; i++) {
        struct fault *fault = &test.faults[i];
        for (int all = 0; all < 2 && !fault->caught; all++) {
            if (!run_with(&test, all ? plan : &test.sample, fault->name, with))
                goto done;
            for (size_t c = 0; c < plan->count; c++)
                if (noticed(test.without[c], with[c])) {
                    fault->caught++;
                    fault->by_family[family_of(&test, plan->cases[c].family)]++;
                }
        }
        missed += !fault->caught;
        fault_print(&test, fault);
        fflush(stdout);
    }
    families_print(&test);
    printf("\n%s\n%zu passed, %zu failed\n", gn_format_duration(gn_clock() - begin, took), test.fault_count - missed, missed);
    exit_status = missed > 0;
done:
    gn_arena_finish(&test.arena);
    return fflush(stdout) == 0 ? exit_status : 3;
}
