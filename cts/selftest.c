/* SPDX-License-Identifier: Apache-2.0 */
/* Runs of the suite, one for each fault, each a process with one worker, and what became of the cases. */
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
/* So many cases of each family come first, with all of the families that look at single places and those that the fault's
 * own table names. The rest runs when these have caught nothing. */
enum { SAMPLE = 3 };
static const char *const whole_families[] = {"exact", "planted", "limits"};

struct fault {
    const char *name, *text;
    const char *witness; /* cases to run besides the sample; "" for none */
    size_t caught, *by_family; /* how many cases noticed it */
    const char *first; /* one of these */
    bool whole; /* every case was run */
    bool over;
};

/* A run in progress. */
struct job {
    pid_t pid; /* 0: none */
    struct fault *fault; /* NULL: the driver as it is */
    const char *out;
};

struct selftest {
    const struct gn_run_options *options;
    const struct gn_run_plan *plan;
    const char *driver;
    struct gn_arena arena;
    char folder[PATH_MAX]; /* of the layer */
    struct fault *faults;
    size_t fault_count;
    bool all_faults; /* none is left out */
    size_t *family_cases; /* in the plan */
    enum gn_case_status *without; /* by case of the plan; GN_CASE_STATUS_COUNT: it did not run */
    bool *sampled; /* by case of the plan */
    struct job *jobs;
    uint32_t job_count;
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
    bool (*describe)(size_t, const char **, const char **, const char **) = NULL;
    /* The way POSIX has for symbols that are functions. */
    if (library)
        *(void **)&describe = dlsym(library, "gn_faulty_describe");
    if (!describe) {
        fprintf(stderr, "gnomon: --selftest: %s\n", dlerror());
        return false;
    }
    const char *name, *text, *witness;
    size_t all = 0;
    while (describe(all, &name, &text, &witness))
        all++;
    test->faults = GN_NEW(&test->arena, struct fault, all);
    for (size_t i = 0; describe(i, &name, &text, &witness); i++)
        if (gn_pattern_matches(pattern, name))
            test->faults[test->fault_count++] = (struct fault){
                .name = name,
                .text = text,
                .witness = witness,
                .by_family = GN_NEW(&test->arena, size_t, gn_case_family_count),
            };
    test->all_faults = test->fault_count == all;
    if (!test->fault_count)
        fprintf(stderr, "gnomon: --selftest: no fault matches '%s'\n", pattern);
    return test->fault_count > 0;
}

/* Its place among all families. */
static size_t family_of(const struct gn_case_family *family)
{
    size_t i = 0;
    while (i + 1 < gn_case_family_count && gn_case_families[i] != family)
        i++;
    return i;
}

static void sample_make(struct selftest *test)
{
    size_t *seen = GN_NEW(&test->arena, size_t, gn_case_family_count);
    test->family_cases = GN_NEW(&test->arena, size_t, gn_case_family_count);
    test->sampled = GN_NEW(&test->arena, bool, test->plan->count);
    for (size_t i = 0; i < test->plan->count; i++)
        test->family_cases[family_of(test->plan->cases[i].family)]++;
    for (size_t i = 0; i < test->plan->count; i++) {
        const size_t family = family_of(test->plan->cases[i].family), place = seen[family]++;
        const size_t all = test->family_cases[family];
        /* Evenly over the family: where the share of SAMPLE that is due grows by one. */
        test->sampled[i] = place * SAMPLE / all != (place + 1) * SAMPLE / all;
        for (size_t w = 0; w < sizeof whole_families / sizeof whole_families[0]; w++)
            test->sampled[i] |= strcmp(gn_case_families[family]->name, whole_families[w]) == 0;
    }
}

/* What runs with a fault, in memory of the arena. */
static struct gn_run_plan plan_for(struct selftest *test, const struct fault *fault)
{
    struct gn_run_plan plan = *test->plan;
    if (!fault || fault->whole)
        return plan;
    plan.cases = GN_NEW(&test->arena, struct gn_selected, test->plan->count);
    plan.count = 0;
    for (size_t i = 0; i < test->plan->count; i++)
        if (test->sampled[i] || gn_pattern_matches(fault->witness, test->plan->cases[i].name))
            plan.cases[plan.count++] = test->plan->cases[i];
    return plan;
}

/* Never returns. */
static void child(const struct selftest *test, const struct gn_run_plan *plan, const struct job *job, uint32_t workers)
{
    struct gn_run_options options = *test->options;
    struct gn_results results;
    char path[2 * PATH_MAX];
    const char *old = getenv("VK_ADD_LAYER_PATH");
    snprintf(path, sizeof path, "%s.log", job->out);
    int log = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (log < 0 || dup2(log, STDOUT_FILENO) < 0 || dup2(log, STDERR_FILENO) < 0)
        _exit(3);
    snprintf(path, sizeof path, "%s%s%s", test->folder, old && *old ? ":" : "", old ? old : "");
    setenv("VK_ADD_LAYER_PATH", path, 1);
    setenv("VK_INSTANCE_LAYERS", LAYER, 1);
    setenv("GNOMON_FAULT", job->fault ? job->fault->name : "", 1);
    options.scale *= ray_share;
    options.max_fails = 0;
    options.jobs = workers;
    gn_results_init(&results);
    int exit_status = gn_run_plan_run(plan, &options, test->driver, job->out, "--selftest", &results);
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

static bool job_start(struct selftest *test, struct job *job, struct fault *fault, uint32_t workers)
{
    job->fault = fault;
    job->out = gn_arena_printf(&test->arena, "%s/%s", test->options->out, fault ? fault->name : "none");
    const struct gn_run_plan plan = plan_for(test, fault);
    fflush(stdout);
    job->pid = fork();
    if (job->pid == 0)
        child(test, &plan, job, workers);
    if (job->pid < 0)
        fprintf(stderr, "gnomon: --selftest: cannot start a process: %s\n", strerror(errno));
    return job->pid > 0;
}

/* Takes in what a run that has ended has left. False when the harness failed or was interrupted. */
static bool job_read(struct selftest *test, const struct job *job, int status, enum gn_case_status *out_statuses)
{
    /* 4 is a driver that could not even be opened: everything is lost, which reads as not run. */
    if (WIFEXITED(status) && WEXITSTATUS(status) != 2 && WEXITSTATUS(status) != 3)
        return statuses_read(test, job->out, out_statuses);
    fprintf(stderr, "gnomon: --selftest: the run with '%s' did not end well; see %s.log\n",
            job->fault ? job->fault->name : "", job->out);
    return false;
}

/* Whether a case says more against the driver than it did. A skip says nothing. */
static bool noticed(enum gn_case_status without, enum gn_case_status with)
{
    if (with == GN_CASE_STATUS_COUNT || with == GN_CASE_SKIP || with == GN_CASE_PASS || with == without)
        return false;
    return without == GN_CASE_PASS || (without == GN_CASE_LEAK && with != GN_CASE_LEAK);
}

static void fault_count_cases(struct selftest *test, struct fault *fault, const enum gn_case_status *with)
{
    for (size_t c = 0; c < test->plan->count; c++)
        if (noticed(test->without[c], with[c])) {
            fault->caught++;
            fault->by_family[family_of(test->plan->cases[c].family)]++;
            fault->first = fault->first ? fault->first : test->plan->cases[c].name;
        }
}

static void fault_print(const struct fault *fault)
{
    printf("%-7s %-28s %s\n", fault->caught ? "caught" : "MISSED", fault->name, fault->text);
    if (!fault->caught)
        return;
    printf("        %zu case%s:", fault->caught, fault->caught == 1 ? "" : "s");
    for (size_t f = 0; f < gn_case_family_count; f++)
        if (fault->by_family[f])
            printf(" %s %zu", gn_case_families[f]->name, fault->by_family[f]);
    if (fault->whole)
        printf(", out of the whole suite: its witness could be %s", fault->first);
    printf("\n");
}

/* The runs with faults, as many at a time as there are jobs. False when one of them did not end well. */
static bool faults_run(struct selftest *test, enum gn_case_status *with)
{
    size_t next = 0, printed = 0;
    uint32_t busy = 0;
    bool ok = true;
    while (busy || (ok && next < test->fault_count)) {
        for (uint32_t j = 0; j < test->job_count && ok && next < test->fault_count; j++)
            if (!test->jobs[j].pid) {
                ok = job_start(test, &test->jobs[j], &test->faults[next++], 1);
                busy += ok;
            }
        int status = 0;
        const pid_t pid = waitpid(-1, &status, 0);
        if (pid < 0 && errno != EINTR)
            return false;
        struct job *job = test->jobs;
        while (job < test->jobs + test->job_count && job->pid != pid)
            job++;
        if (pid <= 0 || job == test->jobs + test->job_count)
            continue;
        struct fault *fault = job->fault;
        job->pid = 0;
        busy--;
        if (!job_read(test, job, status, with)) {
            ok = false;
            continue;
        }
        fault_count_cases(test, fault, with);
        fault->over = fault->caught || fault->whole;
        if (!fault->over && ok) {
            fault->whole = true;
            ok = job_start(test, job, fault, 1);
            busy += ok;
        }
        for (; printed < test->fault_count && test->faults[printed].over; printed++)
            fault_print(&test->faults[printed]);
        fflush(stdout);
    }
    return ok;
}

/* What each family caught, and why it is there where it caught nothing alone. Gives how many nothing speaks for. */
static size_t families_print(struct selftest *test)
{
    size_t idle = 0;
    printf("\n%-16s %6s %6s  %s\n", "family", "caught", "alone", "what no other family caught, or why it is there");
    for (size_t f = 0; f < gn_case_family_count; f++) {
        size_t caught = 0, alone = 0;
        const char *list = "";
        if (!test->family_cases[f])
            continue;
        for (size_t i = 0; i < test->fault_count; i++) {
            const struct fault *fault = &test->faults[i];
            caught += fault->by_family[f] > 0;
            if (fault->by_family[f] && fault->by_family[f] == fault->caught) {
                alone++;
                list = gn_arena_printf(&test->arena, "%s%s%s", list, *list ? " " : "", fault->name);
            }
        }
        const char *reason = gn_case_family_reasons[f];
        printf("%-16s %6zu %6zu  %s\n", gn_case_families[f]->name, caught, alone,
               alone ? list : *reason ? reason : "NOTHING, and no reason is given in cts/cases/families.def");
        idle += !alone && !*reason;
    }
    return idle;
}

int gn_selftest_run(const struct gn_run_options *options, const struct gn_run_plan *plan, const char *driver,
                    const char *pattern)
{
    struct selftest test = {.options = options, .plan = plan, .driver = driver};
    char error[512], took[32];
    int exit_status = 2;
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
    test.job_count = options->jobs;
    test.jobs = GN_NEW(&test.arena, struct job, test.job_count);
    const double begin = gn_clock();
    int status = 0;
    if (!job_start(&test, &test.jobs[0], NULL, options->jobs))
        goto done;
    while (waitpid(test.jobs[0].pid, &status, 0) < 0 && errno == EINTR) {
    }
    if (!job_read(&test, &test.jobs[0], status, test.without))
        goto done;
    test.jobs[0].pid = 0;
    size_t judged = 0, first = 0;
    for (size_t i = 0; i < plan->count; i++) {
        judged += test.without[i] == GN_CASE_PASS;
        first += test.sampled[i];
    }
    printf("%zu faults; %zu cases, %zu of which pass without a fault; %zu of them come first\n\n", test.fault_count,
           plan->count, judged, first);
    if (!judged) {
        fprintf(stderr, "gnomon: nothing ran: no case passes on this driver as it is; see %s/none.log\n", options->out);
        exit_status = 4;
        goto done;
    }
    if (!faults_run(&test, with))
        goto done;
    size_t failed = 0;
    for (size_t i = 0; i < test.fault_count; i++)
        failed += !test.faults[i].caught;
    size_t checks = test.fault_count;
    const size_t idle = families_print(&test);
    /* Of a part of the faults, or of the cases, no family can be asked what it is for. */
    if (test.all_faults && plan->count == plan->catalogue_count) {
        for (size_t f = 0; f < gn_case_family_count; f++)
            checks += test.family_cases[f] > 0;
        failed += idle;
    }
    printf("\n%s\n%zu passed, %zu failed\n", gn_format_duration(gn_clock() - begin, took), checks - failed, failed);
    exit_status = failed > 0;
done:
    gn_arena_finish(&test.arena);
    return fflush(stdout) == 0 ? exit_status : 3;
}
