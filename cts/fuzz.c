/* SPDX-License-Identifier: Apache-2.0 */
/*
 * `gnomon run fuzz`: trials in worker processes, failures sorted by what they need, one of each kind reduced.
 *
 * The parent never opens the driver. A worker tells it by a pipe what it found, and by shared memory which trial it is
 * at, so that the process's end, by a signal or by the driver's exit(), is put down to its trial; that is then reduced with
 * a process for each attempt.
 */
#include <argp.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cts/arguments.h"
#include "cts/commands.h"
#include "cts/driver.h"
#include "cts/fuzz.h"
#include "cts/progress.h"
#include "cts/select.h"

enum { MOST_JOBS = 64, MOST_KINDS = 512, MOST_KNOWN = 64, TRIAL_TIMEOUT = 20, SHRINK_ATTEMPTS = 3000, CRASH_ATTEMPTS = 400 };

enum {
    OPTION_SECONDS = 256,
    OPTION_TRIALS,
    OPTION_SEED,
    OPTION_JOBS,
    OPTION_DRIVER,
    OPTION_BACKEND,
    OPTION_OUT,
    OPTION_KNOWN,
};

static const struct argp_option argp_options[] = {
    {"seconds", OPTION_SECONDS, "N", 0, "How long to go on", 0},
    {"trials", OPTION_TRIALS, "N", 0, "How many trials to make, however long it takes", 0},
    {"seed", OPTION_SEED, "S", 0, "Trial number N of a seed is the same everywhere (default: 1)", 0},
    {"jobs", OPTION_JOBS, "N", 0, "How many worker processes (default: 2)", 0},
    {"driver", OPTION_DRIVER, "ICD.json|NAME", 0, "As for `run`", 0},
    {"backend", OPTION_BACKEND, "NAME", 0, "query, pipeline or all (the default)", 0},
    {"out", OPTION_OUT, "DIR", 0, "Where the reduced scenes go (default: gnomon-fuzz)", 0},
    {"known", OPTION_KNOWN, "PATTERN", 0, "A kind of failure that does not count; may be repeated", 0},
    {0},
};

struct kind {
    char name[256];
    uint32_t needed; /* ingredients */
    uint64_t count, first; /* the lowest trial */
    uint64_t filed; /* the trial whose reduced scene is kept; UINT64_MAX: none */
};

struct fuzz {
    double seconds;
    uint64_t trials, seed;
    uint32_t jobs;
    const char *driver_name, *driver, *out, *backend;
    const char *known[MOST_KNOWN];
    size_t known_count;
    double begin;
    struct kind kinds[MOST_KINDS];
    size_t kind_count;
    uint64_t done, rays, failed;
};

/* What a worker is at; in shared memory. */
struct place {
    volatile uint64_t number;
    volatile uint64_t since; /* seconds of the clock */
    volatile uint64_t done, rays;
    volatile uint32_t shrinking;
    volatile uint32_t inside; /* a trial is being run: whatever ends the process now is the driver's doing */
};

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct fuzz *fuzz = state->input;
    switch (key) {
    case OPTION_SECONDS:
        fuzz->seconds = (double)gn_argument_number(state, "--seconds", argument, 1, 1u << 30);
        break;
    case OPTION_TRIALS:
        fuzz->trials = gn_argument_number(state, "--trials", argument, 1, UINT32_MAX);
        break;
    case OPTION_SEED:
        fuzz->seed = gn_argument_number(state, "--seed", argument, 0, UINT64_MAX);
        break;
    case OPTION_JOBS:
        fuzz->jobs = (uint32_t)gn_argument_number(state, "--jobs", argument, 1, MOST_JOBS);
        break;
    case OPTION_DRIVER:
        fuzz->driver_name = argument;
        break;
    case OPTION_BACKEND:
        if (strcmp(argument, "query") != 0 && strcmp(argument, "pipeline") != 0 && strcmp(argument, "all") != 0)
            argp_error(state, "--backend: expected query, pipeline or all, found '%s'", argument);
        fuzz->backend = argument;
        break;
    case OPTION_OUT:
        fuzz->out = argument;
        break;
    case OPTION_KNOWN:
        if (fuzz->known_count == MOST_KNOWN)
            argp_error(state, "--known: at most %d", MOST_KNOWN);
        fuzz->known[fuzz->known_count++] = argument;
        break;
    case ARGP_KEY_END:
        if (!fuzz->seconds == !fuzz->trials)
            argp_error(state, "expected --seconds or --trials");
        break;
    default:
        return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

/* A kind's name: the status, then what the failure needs. */
static void kind_name(enum gn_case_status status, uint32_t needed, char *out, size_t size)
{
    size_t used = (size_t)snprintf(out, size, "%s", gn_case_status_name(status));
    const char *separator = ".";
    for (uint32_t i = 0; i < GN_FUZZ_INGREDIENT_COUNT; i++)
        if (needed >> i & 1 && used < size) {
            used += (size_t)snprintf(out + used, size - used, "%s%s", separator,
                                     gn_fuzz_ingredient_name((enum gn_fuzz_ingredient)i));
            separator = "+";
        }
    if (!needed && used < size)
        snprintf(out + used, size - used, ".plain");
}

static bool kind_known(const struct fuzz *fuzz, const char *name)
{
    for (size_t i = 0; i < fuzz->known_count; i++)
        if (gn_pattern_matches(fuzz->known[i], name))
            return true;
    return false;
}

static bool file_write(const struct fuzz *fuzz, const char *kind, uint64_t number, const struct gn_fuzz_file *file)
{
    char path[1024];
    size_t length = 0;
    char *text = gn_fuzz_encode(file, &length);
    snprintf(path, sizeof path, "%s/%s.%llu.json", fuzz->out, kind, (unsigned long long)number);
    FILE *to = text ? fopen(path, "w") : NULL;
    bool ok = to && fwrite(text, 1, length, to) == length;
    ok = to && fclose(to) == 0 && ok;
    if (!ok)
        fprintf(stderr, "gnomon: %s: %s\n", path, strerror(errno));
    free(text);
    return ok;
}

/* In a worker: whether a trial fails with this status on the device. */
struct inside {
    struct gn_device *device;
    enum gn_case_status status;
    char message[1024];
    uint32_t ray, focus;
};

static bool inside_run(struct inside *inside, const struct gn_fuzz_trial *trial)
{
    struct gn_case_run run;
    gn_fuzz_execute(trial, inside->device, &run);
    const struct gn_case_result *result = &run.result;
    inside->status = result->status;
    snprintf(inside->message, sizeof inside->message, "%s", result->message);
    inside->ray = inside->focus = 0;
    if (result->has_offender) {
        const struct gn_case_offender *offender = &result->offender;
        inside->ray = offender->ray_index;
        inside->focus = offender->verdict.ideal_hit ? offender->verdict.ideal.instance
                        : offender->answer.kind     ? offender->answer.instance
                                                    : 0;
    }
    gn_case_run_finish(&run);
    /* More candidates than the harness has room for say nothing about the driver. */
    if (inside->status == GN_CASE_ERROR && strstr(inside->message, "more than the"))
        inside->status = GN_CASE_SKIP;
    return gn_case_status_is_failure(inside->status);
}

static bool inside_fails(void *context, const struct gn_fuzz_trial *trial)
{
    struct inside *want = context, found = {.device = want->device};
    if (!trial->ray_count || !trial->scene.instance_count)
        return false;
    return inside_run(&found, trial) && found.status == want->status &&
           /* An error is told from others by how its message begins. */
           (want->status != GN_CASE_ERROR || strncmp(found.message, want->message, 24) == 0);
}

static struct gn_device *device_open(const struct fuzz *fuzz, char *out_error, size_t size)
{
    const struct gn_device_options options = {.icd = fuzz->driver[0] ? fuzz->driver : NULL, .index = -1};
    return gn_device_create(&options, out_error, size);
}

static bool trial_wanted(const struct fuzz *fuzz, const struct gn_fuzz_trial *trial)
{
    return strcmp(fuzz->backend, "all") == 0 || strcmp(fuzz->backend, gn_case_backend_name(trial->backend)) == 0;
}

/* Never returns: trials from `number` on, every `jobs`-th. Lines on `to`: the kind, what it needs, the trial, whether it was filed. */
static void work(const struct fuzz *fuzz, uint64_t number, struct place *place, int to)
{
    char error[2048];
    char (*seen)[256] = calloc(MOST_KINDS, sizeof *seen);
    size_t seen_count = 0;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    struct gn_device *device = device_open(fuzz, error, sizeof error);
    if (!device || !seen) {
        fprintf(stderr, "gnomon: nothing ran: %s\n", error);
        _exit(4);
    }
    const struct gn_device_info *info = gn_device_info(device);
    for (; (!fuzz->trials || number < fuzz->trials) && (!fuzz->seconds || gn_clock() - fuzz->begin < fuzz->seconds);
         number += fuzz->jobs) {
        struct gn_arena arena = {0};
        struct gn_fuzz_trial trial;
        struct inside inside = {.device = device};
        place->number = number;
        place->since = (uint64_t)gn_clock();
        gn_fuzz_make(&arena, fuzz->seed, number, info, &trial);
        if (trial_wanted(fuzz, &trial)) {
            place->inside = 1;
            const bool failed = inside_run(&inside, &trial);
            place->done++;
            place->rays += trial.ray_count;
            if (failed) {
                char name[256];
                place->shrinking = 1;
                trial.focus = inside.focus;
                const uint32_t needed = gn_fuzz_classify(&arena, &trial, inside.ray, inside_fails, &inside);
                kind_name(inside.status, needed, name, sizeof name);
                bool fresh = seen_count < MOST_KINDS;
                for (size_t i = 0; i < seen_count; i++)
                    fresh = fresh && strcmp(seen[i], name) != 0;
                if (fresh) {
                    snprintf(seen[seen_count++], sizeof *seen, "%s", name);
                    gn_fuzz_shrink(&arena, &trial, SHRINK_ATTEMPTS, inside_fails, &inside);
                    struct inside last = {.device = device};
                    (void)inside_run(&last, &trial);
                    const struct gn_fuzz_file file = {trial,        name,         last.message, fuzz->driver,
                                                      info->name, fuzz->seed, number};
                    file_write(fuzz, name, number, &file);
                }
                dprintf(to, "%s %u %llu %d\n", name, needed, (unsigned long long)number, fresh);
                place->shrinking = 0;
            }
            place->inside = 0;
        }
        gn_arena_finish(&arena);
        /* Nobody should go on with a device that failed. */
        if (inside.status == GN_CASE_ERROR) {
            gn_device_destroy(device);
            device = device_open(fuzz, error, sizeof error);
            if (!device)
                _exit(3);
            info = gn_device_info(device);
        }
    }
    gn_device_destroy(device);
    free(seen);
    _exit(0);
}

static void kind_add(struct fuzz *fuzz, const char *name, uint32_t needed, uint64_t number, bool filed)
{
    size_t i = 0;
    while (i < fuzz->kind_count && strcmp(fuzz->kinds[i].name, name) != 0)
        i++;
    fuzz->failed++;
    if (i == MOST_KINDS)
        return;
    struct kind *kind = &fuzz->kinds[i];
    if (i == fuzz->kind_count) {
        fuzz->kind_count++;
        snprintf(kind->name, sizeof kind->name, "%s", name);
        kind->needed = needed;
        kind->first = kind->filed = UINT64_MAX;
    }
    kind->count++;
    if (number < kind->first)
        kind->first = number;
    if (!filed)
        return;
    /* Each worker files its own first: the lowest of all stays. */
    const uint64_t kept = number < kind->filed ? number : kind->filed;
    const uint64_t dropped = number < kind->filed ? kind->filed : number;
    if (dropped != UINT64_MAX) {
        char path[PATH_MAX];
        if ((size_t)snprintf(path, sizeof path, "%s/%s.%llu.json", fuzz->out, kind->name, (unsigned long long)dropped) <
            sizeof path)
            (void)unlink(path);
    }
    kind->filed = kept;
}

/* In the parent: whether a trial ends a process of its own, by a signal or by exit(). */
struct outside {
    const struct fuzz *fuzz;
    struct place *place; /* shared with these processes */
    int end; /* the first one's, as waitpid() has it; SIGALRM is a hang; 0: none yet */
    bool ended;
};

static bool outside_fails(void *context, const struct gn_fuzz_trial *trial)
{
    struct outside *outside = context;
    int status = 0;
    if (!trial->ray_count || !trial->scene.instance_count)
        return false;
    outside->place->inside = 0;
    pid_t pid = fork();
    if (pid == 0) {
        char error[256];
        struct gn_case_run run;
        int nothing = open("/dev/null", O_WRONLY | O_CLOEXEC);
        if (nothing >= 0)
            dup2(nothing, STDERR_FILENO);
        alarm(TRIAL_TIMEOUT);
        struct gn_device *device = device_open(outside->fuzz, error, sizeof error);
        if (!device)
            _exit(3);
        outside->place->inside = 1;
        gn_fuzz_execute(trial, device, &run);
        outside->place->inside = 0;
        _exit(0);
    }
    while (pid > 0 && waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    if (pid < 0 || !outside->place->inside || (outside->ended && outside->end != status))
        return false;
    outside->end = status;
    outside->ended = true;
    return true;
}

static enum gn_case_status end_status(int end)
{
    return !WIFSIGNALED(end) ? GN_CASE_ERROR : WTERMSIG(end) == SIGALRM ? GN_CASE_TIMEOUT : GN_CASE_CRASH;
}

/* A worker ended, in that way, in the midst of this trial. */
static void end_handle(struct fuzz *fuzz, uint64_t number, struct place *place, int end, const struct gn_device_info *info)
{
    struct gn_arena arena = {0};
    struct gn_fuzz_trial trial;
    struct outside outside = {.fuzz = fuzz, .place = place};
    char name[256], message[128];
    bool filed = false;
    uint32_t needed = 0;
    snprintf(name, sizeof name, "%s.not_repeated", gn_case_status_name(end_status(end)));
    gn_fuzz_make(&arena, fuzz->seed, number, info, &trial);
    if (outside_fails(&outside, &trial)) {
        needed = gn_fuzz_classify(&arena, &trial, UINT32_MAX, outside_fails, &outside);
        kind_name(end_status(outside.end), needed, name, sizeof name);
        bool fresh = true;
        for (size_t i = 0; i < fuzz->kind_count; i++)
            fresh = fresh && strcmp(fuzz->kinds[i].name, name) != 0;
        if (fresh) {
            gn_fuzz_shrink(&arena, &trial, CRASH_ATTEMPTS, outside_fails, &outside);
            if (WIFSIGNALED(outside.end))
                snprintf(message, sizeof message, "the process was ended by signal %d (%s)", WTERMSIG(outside.end),
                         strsignal(WTERMSIG(outside.end)));
            else
                snprintf(message, sizeof message, "the process ended itself with exit status %d", WEXITSTATUS(outside.end));
            const struct gn_fuzz_file file = {trial, name, message, fuzz->driver, info->name, fuzz->seed, number};
            filed = file_write(fuzz, name, number, &file);
        }
    }
    kind_add(fuzz, name, needed, number, filed);
    gn_arena_finish(&arena);
}

struct worker {
    pid_t pid;
    int from;
    char line[512];
    size_t used;
};

static bool worker_start(const struct fuzz *fuzz, struct worker *worker, struct place *place, uint64_t number)
{
    int ends[2];
    if (pipe(ends) < 0)
        return false;
    fflush(NULL);
    worker->pid = fork();
    if (worker->pid == 0) {
        close(ends[0]);
        work(fuzz, number, place, ends[1]);
    }
    close(ends[1]);
    worker->from = ends[0];
    worker->used = 0;
    place->since = (uint64_t)gn_clock();
    if (worker->pid < 0)
        close(ends[0]);
    return worker->pid > 0;
}

/* False at the end of what it says. */
static bool worker_read(struct fuzz *fuzz, struct worker *worker)
{
    ssize_t got = read(worker->from, worker->line + worker->used, sizeof worker->line - worker->used - 1);
    if (got <= 0)
        return got < 0 && errno == EINTR;
    worker->used += (size_t)got;
    worker->line[worker->used] = 0;
    char *begin = worker->line, *end;
    while ((end = strchr(begin, '\n'))) {
        char name[256];
        unsigned long long number;
        unsigned needed;
        int filed;
        if (sscanf(begin, "%255s %u %llu %d", name, &needed, &number, &filed) == 4)
            kind_add(fuzz, name, needed, number, filed);
        begin = end + 1;
    }
    worker->used -= (size_t)(begin - worker->line);
    memmove(worker->line, begin, worker->used + 1);
    return true;
}

static volatile sig_atomic_t interrupted;
static void catch_signal(int number)
{
    interrupted = number;
}

/* Runs the workers to their end; what it needs to know of the device comes by shared memory. */
static int run_all(struct fuzz *fuzz, struct place *places, struct gn_device_info *info)
{
    struct worker workers[MOST_JOBS] = {{0}};
    struct pollfd fds[MOST_JOBS];
    uint32_t alive = 0;
    int exit_status = 0;
    for (uint32_t j = 0; j < fuzz->jobs; j++)
        alive += worker_start(fuzz, &workers[j], &places[j], j);
    while (alive > 0) {
        for (uint32_t j = 0; j < fuzz->jobs; j++)
            fds[j] = (struct pollfd){workers[j].pid ? workers[j].from : -1, POLLIN, 0};
        (void)poll(fds, fuzz->jobs, 500);
        for (uint32_t j = 0; j < fuzz->jobs; j++) {
            struct worker *worker = &workers[j];
            int status = 0;
            if (!worker->pid)
                continue;
            const uint64_t patience = places[j].shrinking ? 20 * TRIAL_TIMEOUT : TRIAL_TIMEOUT;
            if (interrupted || (uint64_t)gn_clock() > places[j].since + patience)
                kill(worker->pid, SIGKILL);
            if (!fds[j].revents || worker_read(fuzz, worker))
                continue;
            close(worker->from);
            while (waitpid(worker->pid, &status, 0) < 0 && errno == EINTR) {
            }
            worker->pid = 0;
            alive--;
            if (interrupted || (WIFEXITED(status) && WEXITSTATUS(status) == 0 && !places[j].inside))
                continue;
            if (WIFEXITED(status) && !places[j].inside) {
                exit_status = WEXITSTATUS(status) == 4 ? 4 : 3;
                continue;
            }
            places[j].shrinking = 0;
            end_handle(fuzz, places[j].number, &places[j], status, info);
            places[j].inside = 0;
            alive += worker_start(fuzz, worker, &places[j], places[j].number + fuzz->jobs);
        }
    }
    for (uint32_t j = 0; j < fuzz->jobs; j++) {
        fuzz->done += places[j].done;
        fuzz->rays += places[j].rays;
    }
    return interrupted ? 3 : exit_status;
}

/* What the driver is, found out in a process of its own. */
static int device_ask(const struct fuzz *fuzz, struct gn_device_info *out_shared)
{
    int status = 0;
    fflush(NULL);
    pid_t pid = fork();
    if (pid == 0) {
        char error[2048];
        struct gn_device *device = device_open(fuzz, error, sizeof error);
        if (!device) {
            fprintf(stderr, "gnomon: nothing ran: %s\n", error);
            _exit(4);
        }
        *out_shared = *gn_device_info(device);
        gn_device_destroy(device);
        _exit(0);
    }
    while (pid > 0 && waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    return pid > 0 && WIFEXITED(status) ? WEXITSTATUS(status) : 4;
}

static int kind_compare(const void *left, const void *right)
{
    const struct kind *a = left, *b = right;
    return a->count != b->count ? (a->count < b->count ? 1 : -1) : strcmp(a->name, b->name);
}

/* The kind that needs least among those of this status whose ingredients this one needs, too; itself where there is none. */
static size_t kind_root(const struct fuzz *fuzz, size_t of)
{
    size_t root = of;
    const struct kind *kind = &fuzz->kinds[of];
    const size_t status = strcspn(kind->name, ".");
    for (size_t i = 0; i < fuzz->kind_count; i++) {
        const struct kind *other = &fuzz->kinds[i];
        if (other->needed && (other->needed & kind->needed) == other->needed &&
            strncmp(other->name, kind->name, status + 1) == 0 &&
            __builtin_popcount(other->needed) < __builtin_popcount(fuzz->kinds[root].needed))
            root = i;
    }
    return root;
}

/*
 * Prints the kinds; those that need what another needs and something more go with that one. Gives how many count, and in
 * *out_ways how many there are.
 */
static size_t kinds_report(struct fuzz *fuzz, struct gn_arena *arena, size_t *out_ways)
{
    size_t counting = 0;
    *out_ways = 0;
    qsort(fuzz->kinds, fuzz->kind_count, sizeof *fuzz->kinds, kind_compare);
    for (size_t i = 0; i < fuzz->kind_count; i++) {
        struct kind *kind = &fuzz->kinds[i];
        const char *to = gn_arena_printf(arena, "%s/%s.json", fuzz->out, kind->name);
        const char *from =
            gn_arena_printf(arena, "%s/%s.%llu.json", fuzz->out, kind->name, (unsigned long long)kind->filed);
        const bool filed = rename(from, to) == 0, known = kind_known(fuzz, kind->name);
        size_t variants = 0, more = 0;
        if (kind_root(fuzz, i) != i)
            continue;
        for (size_t v = 0; v < fuzz->kind_count; v++)
            if (v != i && kind_root(fuzz, v) == i) {
                variants++;
                more += fuzz->kinds[v].count;
            }
        ++*out_ways;
        counting += !known;
        printf("%7llu %s %s: first at trial %llu", (unsigned long long)kind->count, known ? "known" : "     ", kind->name,
               (unsigned long long)kind->first);
        if (variants)
            printf("; %zu more in %zu kinds that need this and something else", more, variants);
        printf("\n");
        if (filed)
            printf("        %s replay %s\n", gn_command_name, to);
    }
    return counting;
}

int gn_command_fuzz(int argc, char **argv)
{
    static const struct argp argp = {argp_options,
                                     parse,
                                     NULL,
                                     "Traces random rays through random scenes, judges every answer, sorts failures by what "
                                     "they need, and reduces one of each kind.\vExit status: 0 when nothing failed but what "
                                     "is known, 1 when something did, 2 wrong usage, 3 interrupted, 4 nothing ran.",
                                     NULL,
                                     NULL,
                                     NULL};
    struct fuzz *fuzz = calloc(1, sizeof *fuzz);
    struct gn_arena arena = {0};
    char error[1024], count[2][32], took[32];
    int exit_status = 2;
    const size_t shared_size = MOST_JOBS * sizeof(struct place) + sizeof(struct gn_device_info);
    void *shared = mmap(NULL, shared_size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (!fuzz || shared == MAP_FAILED) {
        fprintf(stderr, "gnomon: no memory for the fuzzer\n");
        exit_status = 3;
        goto done;
    }
    *fuzz = (struct fuzz){.seed = 1, .jobs = 2, .out = "gnomon-fuzz", .backend = "all"};
    if (argp_parse(&argp, argc, argv, 0, NULL, fuzz) != 0)
        goto done;
    fuzz->driver = gn_driver_resolve(fuzz->driver_name, &arena, error, sizeof error);
    if (!fuzz->driver || !gn_folder_create(fuzz->out, error, sizeof error)) {
        fprintf(stderr, "gnomon: %s\n", error);
        goto done;
    }
    struct gn_device_info *info = shared;
    struct place *places = (struct place *)(info + 1);
    if ((exit_status = device_ask(fuzz, info)) != 0)
        goto done;
    const struct sigaction action = {.sa_handler = catch_signal};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    printf("%s, %s %s; seed %llu\n", info->name, info->driver_name, info->driver_info, (unsigned long long)fuzz->seed);
    fuzz->begin = gn_clock();
    exit_status = run_all(fuzz, places, info);
    size_t ways = 0;
    const size_t counting = kinds_report(fuzz, &arena, &ways);
    printf("%llu of %llu scenes failed in %zu ways, %zu of them not known; %s rays, %s, %s scenes/s\n",
           (unsigned long long)fuzz->failed, (unsigned long long)fuzz->done, ways, counting,
           gn_format_count((double)fuzz->rays, count[0]), gn_format_duration(gn_clock() - fuzz->begin, took),
           gn_format_count((double)fuzz->done / (gn_clock() - fuzz->begin), count[1]));
    if (exit_status == 0)
        exit_status = !fuzz->done ? 4 : counting > 0;
done:
    if (shared != MAP_FAILED)
        munmap(shared, shared_size);
    free(fuzz);
    gn_arena_finish(&arena);
    return fflush(stdout) == 0 ? exit_status : 3;
}
