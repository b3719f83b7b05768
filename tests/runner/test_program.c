/* SPDX-License-Identifier: Apache-2.0 */
/* The real program with its workers, on lavapipe: usage, isolation, interruption, files. argv[1] is the
 * program. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <fcntl.h>
#include <libxml/parser.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <yyjson.h>

#include "cts/results.h"

/* Small and sure to pass, so that these tests are about the runner. */
#define FEW "query.smoke.quad", "query.masks.*"

static const char *program;
static char folder[] = "/tmp/gnomon-program-XXXXXX";

struct outcome {
    int status; /* exit status, or 128 + signal */
    char *out, *err;
};

static char *read_all(const char *path)
{
    char *data = NULL, error[256];
    size_t length = 0;
    if (!gn_file_read(path, 1 << 24, &data, &length, error, sizeof error))
        fail_msg("%s", error);
    return data;
}

static bool exists(const char *path)
{
    return access(path, F_OK) == 0;
}

/* Starts the program in the test's folder. `fault` is for GNOMON_TEST_FAULT, `file_limit` bytes for
 * RLIMIT_FSIZE. */
static pid_t start(const char *const *arguments, const char *fault, rlim_t file_limit)
{
    const char *argv[32] = {program};
    for (size_t i = 0; arguments[i]; i++)
        argv[i + 1] = arguments[i];
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        signal(SIGINT, SIG_DFL);
        signal(SIGTERM, SIG_DFL);
        int out = open("out.txt", O_WRONLY | O_CREAT | O_TRUNC, 0666);
        int err = open("err.txt", O_WRONLY | O_CREAT | O_TRUNC, 0666);
        dup2(out, 1);
        dup2(err, 2);
        unsetenv("GNOMON_TEST_FAULT");
        if (fault)
            setenv("GNOMON_TEST_FAULT", fault, 1);
        if (file_limit)
            setrlimit(RLIMIT_FSIZE, &(struct rlimit){file_limit, file_limit});
        execv(program, (char *const *)(uintptr_t)argv);
        _exit(127);
    }
    return pid;
}

static struct outcome finish(pid_t pid)
{
    struct outcome outcome;
    int status;
    assert_int_equal(waitpid(pid, &status, 0), pid);
    outcome.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    outcome.out = read_all("out.txt");
    outcome.err = read_all("err.txt");
    return outcome;
}

static void forget(struct outcome *outcome)
{
    free(outcome->out);
    free(outcome->err);
}

#define ARGUMENTS(...) ((const char *const[]){__VA_ARGS__, NULL})
#define RUN(...) finish(start(ARGUMENTS(__VA_ARGS__), NULL, 0))
#define RUN_FAULT(fault, ...) finish(start(ARGUMENTS(__VA_ARGS__), fault, 0))

static void expect_status(const struct outcome *outcome, int status, const char *said)
{
    if (outcome->status != status || (said && !strstr(outcome->err, said) && !strstr(outcome->out, said)))
        fail_msg("expected exit status %d and '%s', found %d\nstdout: %s\nstderr: %s", status,
                 said ? said : "", outcome->status, outcome->out, outcome->err);
}

static void usage(void **state)
{
    static const struct {
        const char *arguments[6];
        int status;
        const char *said;
    } rows[] = {
        {{NULL}, 2, "usage: gnomon"},
        {{"--version"}, 0, "gnomon 0."},
        {{"--help"}, 0, "replay"},
        {{"nosuch"}, 2, "there is no command 'nosuch'"},
        {{"worker"}, 2, "not for use by hand"},
        {{"run", "--help"}, 0, "--driver"},
        {{"clauses", "nonsense"}, 2, "clauses takes no arguments"},
        {{"run", "--nonsense"}, 2, "nonsense"},
        {{"run", "--backend", "raster"}, 2, "found 'raster'"},
        {{"run", "--faults", "mask.*"}, 2, "goes with --selftest"},
        {{"run", "--jobs", "0"}, 2, "--jobs: expected a whole number from 1"},
        {{"run", "--jobs", "two"}, 2, "found 'two'"},
        {{"run", "--seed", "-1"}, 2, "--seed"},
        {{"run", "--seed", "18446744073709551616"}, 2, "--seed"},
        {{"run", "--scale", "nan"}, 2, "--scale"},
        {{"run", "--timeout", "0"}, 2, "--timeout"},
        {{"run", "--shard", "3/2"}, 2, "--shard"},
        {{"run", "--shard", "1/2x"}, 2, "--shard"},
        {{"run", "--driver", "/nowhere/icd.json"}, 2, "/nowhere/icd.json: No such file"},
        {{"run", "--driver", "nvidia"}, 2, "no driver is named 'nvidia'"},
        {{"run", "--out", "/dev/null/x"}, 2, "/dev/null/x"},
        {{"run", "--out", ""}, 2, "--out"},
        {{"run", "--expect", "/nowhere.txt"}, 2, "/nowhere.txt"},
        {{"run", "query.nothing.like.this"}, 4, "no case matches"},
        {{"run", "query.smoke.quad", "query.nothing.like.this"}, 4, "no case matches"},
        {{"replay"}, 2, "expected a replay file"},
        {{"replay", "/nowhere.json"}, 2, "/nowhere.json"},
        {{"replay", "/etc/passwd"}, 2, "not JSON"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct outcome outcome = finish(start(rows[i].arguments, NULL, 0));
        expect_status(&outcome, rows[i].status, rows[i].said);
        forget(&outcome);
    }
    assert_false(exists("gnomon-out")); /* nothing is made before it is clear that something will run */
}

static void list(void **state)
{
    struct outcome all = RUN("run", "--list"), some = RUN("run", "--list", "query.masks.*");
    (void)state;
    expect_status(&all, 0, "query.smoke.quad\n");
    expect_status(&some, 0, "query.masks.");
    assert_null(strstr(some.out, "query.smoke.quad"));
    assert_int_equal(strlen(all.err), 0);
    forget(&all);
    forget(&some);
}

/* Nothing that is asked of applications and drivers is left out, and the list names cases and clauses that exist. */
static void clauses(void **state)
{
    struct outcome missing = RUN("clauses", "--missing"), all = RUN("clauses");
    (void)state;
    expect_status(&missing, 0, " 0 missing\n");
    expect_status(&all, 0, "NG-031, undefined: ");
    assert_non_null(strstr(all.out, "rules: query.use.uninitialized"));
    forget(&missing);
    forget(&all);
}

static void no_ray_tracing(void **state)
{
    struct outcome outcome;
    (void)state;
    /* An ICD file whose library is no driver: the loader finds no device. */
    FILE *file = fopen("broken.json", "w");
    fputs("{\"file_format_version\": \"1.0.0\", \"ICD\": {\"library_path\": \"/nowhere/libvulkan_none.so\", "
          "\"api_version\": \"1.3.0\"}}",
          file);
    fclose(file);
    outcome = RUN("run", "query.smoke.quad", "--driver", "broken.json");
    expect_status(&outcome, 4, "nothing ran");
    forget(&outcome);
}

/* Every line is JSON with the promised keys, the last one is the summary. Gives the number of cases. */
static size_t check_jsonl(const char *path, bool summary)
{
    static const char *const keys[] = {"name", "status", "seconds", "rays", "message"};
    char *text = read_all(path);
    size_t cases = 0;
    bool last_is_summary = false;
    for (char *line = text, *end; *line; line = end + 1) {
        end = strchr(line, '\n');
        if (!end)
            fail_msg("%s ends in a torn line: %s", path, line);
        yyjson_doc *doc = yyjson_read(line, (size_t)(end - line), 0);
        if (!doc)
            fail_msg("%s: not JSON: %.*s", path, (int)(end - line), line);
        yyjson_val *root = yyjson_doc_get_root(doc);
        for (size_t k = 0; k < sizeof keys / sizeof keys[0]; k++)
            if (!yyjson_obj_get(root, keys[k]))
                fail_msg("%s: no \"%s\" in %.*s", path, keys[k], (int)(end - line), line);
        last_is_summary = yyjson_equals_str(yyjson_obj_get(root, "name"), "summary");
        cases += !last_is_summary;
        yyjson_doc_free(doc);
    }
    assert_int_equal(last_is_summary, summary);
    free(text);
    return cases;
}

static void all_files(void **state)
{
    struct outcome outcome = RUN("run", FEW, "--out", "plain", "--jobs", "2");
    (void)state;
    expect_status(&outcome, 0, "cases passed.");
    assert_non_null(strstr(outcome.out, "report: plain/report.html"));
    size_t cases = check_jsonl("plain/results.jsonl", true);
    assert_true(cases >= 3);
    char *csv = read_all("plain/results.csv");
    size_t lines = 0;
    for (char *c = csv; *c; c++)
        lines += *c == '\n';
    assert_int_equal(lines, cases);
    assert_non_null(strstr(csv, "query.smoke.quad,Pass,"));
    free(csv);
    xmlDocPtr doc = xmlReadFile("plain/junit.xml", NULL, XML_PARSE_NONET);
    assert_non_null(doc);
    xmlFreeDoc(doc);
    char *page = read_all("plain/report.html");
    char *verdict = strstr(page, "class=\"verdict ok\""), *families = strstr(page, "<h2>Families");
    assert_true(verdict && families && verdict < families);
    free(page);
    assert_false(exists("plain/replay/query.smoke.quad.json"));
    forget(&outcome);
}

static void isolation(void **state)
{
    static const struct {
        const char *fault, *status, *said;
    } rows[] = {
        {"crash:query.smoke.quad", "crash", "signal 11"},
        {"exit:query.smoke.quad", "error", "exit status 7"},
        {"lost:query.smoke.quad", "error", "the device was lost"},
        {"hang:query.smoke.quad", "timeout", "no answer within 5 s"},
        {"flood:query.smoke.quad", "timeout", "no answer within 5 s"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        char expected[128];
        struct outcome outcome =
            RUN_FAULT(rows[i].fault, "run", "query.smoke.quad", "query.masks.zero_ray", "--out", "faulty",
                      "--jobs", "1", "--timeout", strcmp(rows[i].status, "timeout") == 0 ? "5" : "60");
        expect_status(&outcome, 1, rows[i].said);
        check_jsonl("faulty/results.jsonl", true);
        char *lines = read_all("faulty/results.jsonl");
        snprintf(expected, sizeof expected, "{\"name\":\"query.smoke.quad\",\"status\":\"%s\"",
                 rows[i].status);
        if (!strstr(lines, expected))
            fail_msg("%s: expected %s in %s", rows[i].fault, expected, lines);
        /* The others ran, in a new process. */
        if (!strstr(outcome.out, "1 of ") || strstr(outcome.out, "; 0 passed"))
            fail_msg("%s: expected one failure and passes, found %s", rows[i].fault, outcome.out);
        assert_non_null(strstr(outcome.out, "replay faulty/replay/query.smoke.quad.json"));
        assert_true(exists("faulty/replay/query.smoke.quad.json"));
        /* What was printed is kept with the case. */
        if (strcmp(rows[i].status, "crash") == 0)
            assert_non_null(strstr(lines, "GNOMON_TEST_FAULT: crash at query.smoke.quad"));
        free(lines);
        forget(&outcome);
    }
    /* A driver that dies while it is opened is no case's fault. */
    struct outcome outcome = RUN_FAULT("crash:open", "run", FEW, "--out", "unopened");
    expect_status(&outcome, 4, "signal 11");
    forget(&outcome);
}

static void replay(void **state)
{
    struct outcome outcome = RUN_FAULT("lost:query.smoke.quad", "run", "query.smoke.quad", "--out", "again");
    (void)state;
    expect_status(&outcome, 1, NULL);
    forget(&outcome);
    outcome = RUN("replay", "again/replay/query.smoke.quad.json");
    expect_status(&outcome, 0, "it does not fail");
    forget(&outcome);
    /* One ray, although none failed: its explanation. */
    FILE *file = fopen("one.json", "w");
    fputs("{\"replay\":\"query.smoke.quad\",\"driver\":\"\",\"seed\":1,\"scale\":1,\"trace\":0,\"ray\":5}",
          file);
    fclose(file);
    outcome = RUN("replay", "one.json", "--driver", "lavapipe");
    expect_status(&outcome, 0, "1. The ray: number 5 of trace 0");
    assert_non_null(strstr(outcome.out, "5. The verdict: exact"));
    forget(&outcome);
    file = fopen("far.json", "w");
    fputs("{\"replay\":\"query.smoke.quad\",\"driver\":\"\",\"seed\":1,\"scale\":1,\"trace\":0,\"ray\":"
          "5000000}",
          file);
    fclose(file);
    outcome = RUN("replay", "far.json", "--driver", "lavapipe");
    expect_status(&outcome, 3, "there is no ray 5000000");
    forget(&outcome);
    file = fopen("unknown.json", "w");
    fputs("{\"replay\":\"query.no.such\",\"driver\":\"\",\"seed\":1,\"scale\":1}", file);
    fclose(file);
    outcome = RUN("replay", "unknown.json");
    expect_status(&outcome, 2, "no case named 'query.no.such'");
    forget(&outcome);
}

static void expectations(void **state)
{
    struct outcome outcome;
    FILE *file = fopen("expect.txt", "w");
    (void)state;
    fputs("# a test's own fault\nquery.smoke.quad,Crash\n", file);
    fclose(file);
    outcome = RUN_FAULT("crash:query.smoke.quad", "run", FEW, "--out", "expected", "--expect", "expect.txt");
    expect_status(&outcome, 0, "1 failed as expected");
    forget(&outcome);
    outcome = RUN("run", FEW, "--out", "expected", "--expect", "expect.txt");
    expect_status(&outcome, 1, "1 case passed against expectation");
    forget(&outcome);
    file = fopen("stale.txt", "w");
    fputs("query.gone.away,Fail\n", file);
    fclose(file);
    outcome = RUN("run", FEW, "--out", "expected", "--expect", "stale.txt");
    expect_status(&outcome, 1, "stale.txt:1: no case is named query.gone.away");
    forget(&outcome);
}

static void wait_for_file(const char *path)
{
    for (int i = 0; i < 2000 && !exists(path); i++)
        nanosleep(&(struct timespec){0, 10 * 1000 * 1000}, NULL);
    assert_true(exists(path));
}

/* Processes of this program that are left over, by their command line. */
static int count_workers(void)
{
    int n = 0;
    DIR *proc = opendir("/proc");
    for (struct dirent *entry; (entry = readdir(proc));) {
        char path[300], line[512], directory[512];
        snprintf(path, sizeof path, "/proc/%s/cmdline", entry->d_name);
        int fd = open(path, O_RDONLY);
        ssize_t length = fd < 0 ? -1 : read(fd, line, sizeof line - 1);
        if (fd >= 0)
            close(fd);
        if (length < 14 || memcmp(line, "gnomon\0worker", 14) != 0)
            continue;
        snprintf(path, sizeof path, "/proc/%s/cwd", entry->d_name);
        length = readlink(path, directory, sizeof directory - 1);
        n += length > 0 && (directory[length] = 0, strcmp(directory, folder) == 0);
    }
    closedir(proc);
    return n;
}

static void interruption(void **state)
{
    static const struct {
        int number;
        const char *said;
    } rows[] = {{SIGINT, "interrupted by Ctrl-C"}, {SIGTERM, "interrupted by SIGTERM"}};
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        char out[16];
        snprintf(out, sizeof out, "stop%zu", i);
        char report[64], lines[64], waiting[64];
        snprintf(report, sizeof report, "%s/report.html", out);
        snprintf(lines, sizeof lines, "%s/results.jsonl", out);
        snprintf(waiting, sizeof waiting, "%s/run.json", out);
        /* One case hangs, so the run is certainly under way. */
        pid_t pid = start(ARGUMENTS("run", FEW, "--out", out, "--jobs", "2"), "hang:query.smoke.quad", 0);
        wait_for_file(waiting);
        for (int t = 0; t < 500; t++) {
            char *text = read_all(lines);
            bool some = strchr(text, '\n');
            free(text);
            if (some)
                break;
            nanosleep(&(struct timespec){0, 10 * 1000 * 1000}, NULL);
        }
        kill(pid, rows[i].number);
        struct outcome outcome = finish(pid);
        expect_status(&outcome, 3, rows[i].said);
        assert_true(check_jsonl(lines, true) >= 1);
        char *page = read_all(report);
        assert_non_null(strstr(page, rows[i].said));
        free(page);
        assert_int_equal(count_workers(), 0);
        forget(&outcome);
    }
}

static void killed_and_resumed(void **state)
{
    (void)state;
    pid_t pid = start(ARGUMENTS("run", FEW, "--out", "killed", "--jobs", "1"), "hang:query.masks.updated", 0);
    wait_for_file("killed/run.json");
    for (int t = 0; t < 500; t++) {
        char *text = read_all("killed/results.jsonl");
        bool some = strchr(text, '\n');
        free(text);
        if (some)
            break;
        nanosleep(&(struct timespec){0, 10 * 1000 * 1000}, NULL);
    }
    kill(pid, SIGKILL);
    struct outcome outcome = finish(pid);
    assert_int_equal(outcome.status, 128 + SIGKILL);
    forget(&outcome);
    size_t before = check_jsonl("killed/results.jsonl", false);
    for (int t = 0; t < 200 && count_workers(); t++)
        nanosleep(&(struct timespec){0, 10 * 1000 * 1000}, NULL);
    assert_int_equal(count_workers(), 0); /* they end with their parent */

    /* As after a kill in the middle of a line. */
    FILE *file = fopen("killed/results.jsonl", "a");
    fputs("{\"name\":\"query.smo", file);
    fclose(file);
    outcome = RUN("run", FEW, "--out", "killed", "--resume", "--seed", "2");
    expect_status(&outcome, 2, "another seed");
    forget(&outcome);
    outcome = RUN("run", FEW, "--out", "killed", "--resume");
    expect_status(&outcome, 0, "cases passed");
    size_t after = check_jsonl("killed/results.jsonl", true);
    assert_true(after > before);
    forget(&outcome);
    /* Once more: nothing is left to do, and the summary is still one. */
    outcome = RUN("run", FEW, "--out", "killed", "--resume");
    expect_status(&outcome, 0, "cases passed");
    assert_int_equal(check_jsonl("killed/results.jsonl", true), after);
    forget(&outcome);
    static const struct {
        const char *line, *said;
    } foreign[] = {
        {"{\"name\":\"query.no.such\",\"status\":\"pass\"}\n", "query.no.such which is no case of this run"},
        {"{\"name\":\"query.smoke.quad\",\"status\":\"pass\"}\n", "query.smoke.quad twice"},
    };
    for (size_t i = 0; i < sizeof foreign / sizeof foreign[0]; i++) {
        char *lines = read_all("killed/results.jsonl");
        file = fopen("killed/results.jsonl", "a");
        fputs(foreign[i].line, file);
        fclose(file);
        outcome = RUN("run", FEW, "--out", "killed", "--resume");
        expect_status(&outcome, 2, foreign[i].said);
        forget(&outcome);
        file = fopen("killed/results.jsonl", "w");
        fputs(lines, file);
        fclose(file);
        free(lines);
    }
    outcome = RUN("run", "query.smoke.quad", "--out", "killed", "--resume");
    expect_status(&outcome, 2, "another choice of cases");
    forget(&outcome);
    outcome = RUN("run", FEW, "--out", "never", "--resume");
    expect_status(&outcome, 2, "--resume");
    forget(&outcome);
}

static void full_disk(void **state)
{
    (void)state;
    struct outcome outcome = finish(start(ARGUMENTS("run", FEW, "--out", "full"), NULL, 3000));
    expect_status(&outcome, 3, "File too large");
    assert_true(check_jsonl("full/results.jsonl", false) >= 1); /* whole lines, all readable */
    forget(&outcome);
    mkdir("devfull", 0777);
    assert_int_equal(symlink("/dev/full", "devfull/results.jsonl"), 0);
    outcome = RUN("run", FEW, "--out", "devfull");
    expect_status(&outcome, 3, "No space left on device");
    forget(&outcome);
}

static void in_use(void **state)
{
    (void)state;
    mkdir("busy", 0777);
    int fd = open("busy", O_RDONLY | O_DIRECTORY);
    assert_int_equal(flock(fd, LOCK_EX), 0);
    struct outcome outcome = RUN("run", FEW, "--out", "busy");
    expect_status(&outcome, 2, "in use by another run");
    forget(&outcome);
    close(fd);
}

static void limits(void **state)
{
    (void)state;
    struct outcome outcome = RUN_FAULT("lost:query.smoke.quad", "run", "query.smoke.quad", "query.masks.*",
                                       "--out", "limited", "--max-fails", "1", "--jobs", "1");
    expect_status(&outcome, 1, NULL);
    check_jsonl("limited/results.jsonl", true);
    forget(&outcome);
    /* The same seed gives the same rays, another one others; also in other processes. */
    char *lines[3];
    static const char *const seeds[] = {"7", "7", "8"};
    for (int i = 0; i < 3; i++) {
        outcome = RUN("run", "query.smoke.quad", "--out", "seeded", "--seed", seeds[i]);
        expect_status(&outcome, 0, NULL);
        forget(&outcome);
        char *text = read_all("seeded/results.jsonl");
        lines[i] = strdup(strstr(text, "\"ideal_hits\""));
        *strchr(lines[i], '\n') = 0;
        free(text);
    }
    assert_string_equal(lines[0], lines[1]);
    assert_string_not_equal(lines[0], lines[2]);
    for (int i = 0; i < 3; i++)
        free(lines[i]);
}

/* What a case came to, but for the time: one string for all cases of a run, in the order of their names. */
static char *verdicts(const char *path)
{
    char *text = read_all(path), *rows[64], *joined = calloc(1, strlen(text) + 1);
    size_t count = 0;
    for (char *line = strtok(text, "\n"); line && count < 64; line = strtok(NULL, "\n")) {
        yyjson_doc *doc = yyjson_read(line, strlen(line), 0);
        yyjson_mut_doc *copy = yyjson_doc_mut_copy(doc, NULL);
        yyjson_mut_val *root = yyjson_mut_doc_get_root(copy);
        if (!yyjson_equals_str(yyjson_obj_get(yyjson_doc_get_root(doc), "name"), "summary")) {
            yyjson_mut_obj_remove_key(root, "seconds");
            yyjson_mut_obj_remove_key(root, "worker"); /* and where it was run */
            yyjson_mut_obj_remove_key(root, "position");
            rows[count++] = yyjson_mut_write(copy, 0, NULL);
        }
        yyjson_mut_doc_free(copy);
        yyjson_doc_free(doc);
    }
    for (size_t i = 0; i < count; i++)
        for (size_t j = i + 1; j < count; j++)
            if (strcmp(rows[i], rows[j]) > 0) {
                char *kept = rows[i];
                rows[i] = rows[j];
                rows[j] = kept;
            }
    for (size_t i = 0; i < count; i++) {
        strcat(joined, rows[i]);
        free(rows[i]);
    }
    free(text);
    return joined;
}

/* Two runs with one seed give the same verdicts, errors and offenders, whoever runs which case. */
static void same_seed_same_verdicts(void **state)
{
    (void)state;
    static const char *const jobs[] = {"1", "3"}, *const folders[] = {"once", "again"};
    char *found[2];
    for (int i = 0; i < 2; i++) {
        struct outcome outcome =
            RUN("run", "query.random.scene_1", "pipeline.random.scene_2", "*.random.shared_1", "*.fan.3", "query.stages.*.mixed",
                "*.relations.order.*", "pipeline.tables.records.stride_2_mixed", "--jobs", jobs[i], "--scale", "0.2", "--out",
                folders[i]);
        forget(&outcome);
        char path[64];
        snprintf(path, sizeof path, "%s/results.jsonl", folders[i]);
        found[i] = verdicts(path);
    }
    assert_true(strlen(found[0]) > 1000);
    assert_string_equal(found[0], found[1]);
    free(found[0]);
    free(found[1]);
}

static int make_folder(void **state)
{
    (void)state;
    return mkdtemp(folder) && chdir(folder) == 0 ? 0 : -1;
}

static int remove_folder(void **state)
{
    char command[128];
    (void)state;
    snprintf(command, sizeof command, "rm -r '%s'", folder);
    return chdir("/") == 0 ? system(command) : -1;
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(usage),        cmocka_unit_test(list),         cmocka_unit_test(clauses),
        cmocka_unit_test(no_ray_tracing),
        cmocka_unit_test(all_files),    cmocka_unit_test(isolation),    cmocka_unit_test(replay),
        cmocka_unit_test(expectations), cmocka_unit_test(interruption), cmocka_unit_test(killed_and_resumed),
        cmocka_unit_test(full_disk),    cmocka_unit_test(in_use),       cmocka_unit_test(limits),
        cmocka_unit_test(same_seed_same_verdicts),
    };
    if (argc != 2) {
        fprintf(stderr, "usage: %s PROGRAM\n", argv[0]);
        return 2;
    }
    program = realpath(argv[1], NULL);
    /* The driver is the default one, and the terminal none, whatever the caller's environment says. */
    unsetenv("VK_DRIVER_FILES");
    unsetenv("VK_ICD_FILENAMES");
    return program ? cmocka_run_group_tests(tests, make_folder, remove_folder) : 2;
}
