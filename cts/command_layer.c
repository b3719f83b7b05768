/* SPDX-License-Identifier: Apache-2.0 */
/* `gnomon layer`: runs an application with the layer enabled, and says at the end what came of it. Every process of the application
 * writes files of its own in a folder that is joined into what was asked for. */
#include <argp.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vulkan/vulkan.h>
#include <yyjson.h>

#include "checks/rules/rules.h"
#include "cts/commands.h"

#define LAYER "VK_LAYER_GNOMON_ray_tracing"
#define MANIFEST "VkLayer_gnomon_ray_tracing.json"
#define SETTING "VK_GNOMON_RAY_TRACING_"

enum { KEY_PROFILE = 256, KEY_LOG, KEY_SARIF, KEY_PRINT_ENV };

static const struct argp_option options[] = {
    {"profile", KEY_PROFILE, "NAME", 0, "API whose rules apply: vulkan (default), wgpu, webgpu-rt, diligent, hgi", 0},
    {"log", KEY_LOG, "FILE", 0, "Write findings and the closing statement as JSON Lines", 0},
    {"sarif", KEY_SARIF, "FILE", 0, "Write findings as SARIF 2.1.0, for code scanning", 0},
    {"print-env", KEY_PRINT_ENV, NULL, 0, "Only print the variables that enable the layer, for `eval`", 0},
    {0}};

struct arguments {
    const char *profile, *log, *sarif;
    bool print_env;
    char **application; /* NULL-terminated */
};

static error_t parse(int key, char *value, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    enum gn_profile profile;
    switch (key) {
    case KEY_PROFILE:
        if (!gn_profile_parse(value, &profile))
            argp_error(state, "there is no profile '%s'", value);
        arguments->profile = value;
        break;
    case KEY_LOG:
    case KEY_SARIF:
        if (!*value)
            argp_error(state, "%s: expected the name of a file, found an empty one", key == KEY_LOG ? "--log" : "--sarif");
        *(key == KEY_LOG ? &arguments->log : &arguments->sarif) = value;
        break;
    case KEY_PRINT_ENV: arguments->print_env = true; break;
    case ARGP_KEY_ARG:
        arguments->application = &state->argv[state->next - 1];
        state->next = state->argc;
        break;
    case ARGP_KEY_END:
        if (!arguments->application && !arguments->print_env)
            argp_error(state, "expected an application: gnomon layer -- APP ARGS");
        break;
    default: return ARGP_ERR_UNKNOWN;
    }
    return 0;
}

void gn_layer_find(char *out, size_t size)
{
    char self[4096], file[4400];
    ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
    self[length > 0 ? length : 0] = '\0';
    char *slash = strrchr(self, '/');
    if (slash)
        *slash = '\0';
    slash = strrchr(self, '/');
    if (slash)
        *slash = '\0';
    snprintf(out, size, "%s/layer", self);
    snprintf(file, sizeof file, "%s/" MANIFEST, out);
    if (access(file, R_OK) != 0) {
        fprintf(stderr, "gnomon: expected the layer at %s: %s\n", file, strerror(errno));
        out[0] = '\0';
    }
}

static void set_variable(const char *name, const char *value, bool print)
{
    if (!print) {
        setenv(name, value, 1);
        return;
    }
    printf("export %s='", name);
    for (const char *c = value; *c; c++)
        printf(*c == '\'' ? "'\\''" : "%c", *c);
    printf("'\n");
}

/* Puts `value` before what the variable holds, unless it is there already. */
static void prepend(const char *name, const char *value, bool print)
{
    char joined[8192];
    const char *old = getenv(name);
    size_t size = strlen(value);
    for (const char *part = old; part; part = strchr(part, ':') ? strchr(part, ':') + 1 : NULL)
        if (strncmp(part, value, size) == 0 && (part[size] == ':' || !part[size])) {
            set_variable(name, old, print);
            return;
        }
    snprintf(joined, sizeof joined, "%s%s%s", value, old && *old ? ":" : "", old ? old : "");
    set_variable(name, joined, print);
}

static void enable_layer(const struct arguments *arguments, const char *folder)
{
    prepend("VK_ADD_LAYER_PATH", folder, arguments->print_env);
    if (getenv("VK_LAYER_PATH")) /* the loader would then overlook the other */
        prepend("VK_LAYER_PATH", folder, arguments->print_env);
    prepend("VK_INSTANCE_LAYERS", LAYER, arguments->print_env);
    if (arguments->profile)
        set_variable(SETTING "PROFILE", arguments->profile, arguments->print_env);
    if (arguments->print_env) {
        if (arguments->log)
            set_variable(SETTING "LOG_FILE", arguments->log, true);
        if (arguments->sarif)
            set_variable(SETTING "SARIF_FILE", arguments->sarif, true);
    }
}

static volatile sig_atomic_t child;

static void pass_on(int signal)
{
    if (child > 0)
        kill((pid_t)child, signal);
}

/* Runs the application. False with a message when it cannot be started. Keys of a terminal reach it by themselves. */
static bool run_application(char **application, int *out_status)
{
    int started[2], failure = 0;
    if (pipe2(started, O_CLOEXEC) != 0) {
        fprintf(stderr, "gnomon: pipe: %s\n", strerror(errno));
        return false;
    }
    pid_t pid = fork();
    if (pid == 0) {
        close(started[0]);
        execvp(application[0], application);
        failure = errno;
        if (write(started[1], &failure, sizeof failure) < 0)
            _exit(126);
        _exit(127);
    }
    close(started[1]);
    child = pid;
    static const int forwarded[] = {SIGTERM, SIGHUP, SIGUSR1, SIGUSR2}, ignored[] = {SIGINT, SIGQUIT};
    for (size_t i = 0; pid > 0 && i < sizeof forwarded / sizeof forwarded[0]; i++)
        sigaction(forwarded[i], &(struct sigaction){.sa_handler = pass_on, .sa_flags = SA_RESTART}, NULL);
    for (size_t i = 0; pid > 0 && i < sizeof ignored / sizeof ignored[0]; i++)
        signal(ignored[i], SIG_IGN);
    if (pid < 0)
        failure = errno;
    else if (read(started[0], &failure, sizeof failure) != sizeof failure)
        failure = 0;
    close(started[0]);
    while (pid > 0 && waitpid(pid, out_status, 0) < 0 && errno == EINTR)
        ;
    child = 0;
    if (failure)
        fprintf(stderr, "gnomon: cannot run %s: %s\n", application[0], strerror(failure));
    return !failure;
}

/* Per rule: how many sites, how often in all. */
struct row {
    char rule[96];
    enum gn_severity severity;
    unsigned long long sites, count;
};

/* What the statements say of one matter, added up. */
struct entry {
    char what[160], why[320];
    bool counted;
    unsigned long long count;
};

struct entries {
    struct entry list[64];
    size_t count;
};

struct outcome {
    struct row rows[256];
    size_t row_count;
    unsigned long long sites[GN_SEVERITY_COUNT];
    unsigned long long damaged, statements, judged_devices;
    struct entries checked, not_checked;
};

static void count_finding(struct outcome *outcome, const char *rule, enum gn_severity severity, unsigned long long count)
{
    size_t i = 0;
    while (i < outcome->row_count && (strcmp(outcome->rows[i].rule, rule) != 0 || outcome->rows[i].severity != severity))
        i++;
    if (i == sizeof outcome->rows / sizeof outcome->rows[0])
        return;
    if (i == outcome->row_count) {
        snprintf(outcome->rows[i].rule, sizeof outcome->rows[i].rule, "%s", rule);
        outcome->rows[i].severity = severity;
        outcome->row_count++;
    }
    outcome->rows[i].sites++;
    outcome->rows[i].count += count;
    outcome->sites[severity]++;
}

static void count_entries(struct entries *entries, yyjson_val *list)
{
    yyjson_val *item;
    size_t at, max;
    yyjson_arr_foreach(list, at, max, item)
    {
        const char *what = yyjson_get_str(yyjson_obj_get(item, "what")), *why = yyjson_get_str(yyjson_obj_get(item, "why"));
        size_t i = 0;
        while (i < entries->count && strcmp(entries->list[i].what, what ? what : "") != 0)
            i++;
        if (!what || i == sizeof entries->list / sizeof entries->list[0])
            continue;
        struct entry *entry = &entries->list[i];
        if (i == entries->count) {
            entries->count++;
            snprintf(entry->what, sizeof entry->what, "%s", what);
            snprintf(entry->why, sizeof entry->why, "%s", why ? why : "");
            entry->counted = yyjson_obj_get(item, "count") != NULL;
        }
        entry->count += yyjson_get_uint(yyjson_obj_get(item, "count"));
    }
}

static void count_line(struct outcome *outcome, const char *line, size_t size)
{
    yyjson_doc *document = yyjson_read(line, size, 0);
    yyjson_val *root = yyjson_doc_get_root(document), *statement = yyjson_obj_get(root, "statement");
    const char *rule = yyjson_get_str(yyjson_obj_get(root, "rule")), *name = yyjson_get_str(yyjson_obj_get(root, "severity"));
    enum gn_severity severity;
    if (statement) {
        outcome->statements++;
        outcome->judged_devices += yyjson_get_uint(yyjson_obj_get(yyjson_obj_get(statement, "devices"), "judged"));
        count_entries(&outcome->checked, yyjson_obj_get(statement, "checked"));
        count_entries(&outcome->not_checked, yyjson_obj_get(statement, "not_checked"));
    } else if (rule && name && gn_severity_parse(name, &severity)) {
        count_finding(outcome, rule, severity, yyjson_get_uint(yyjson_obj_get(root, "count")));
    } else {
        outcome->damaged++;
    }
    yyjson_doc_free(document);
}

/* Reads a log, and adds it to `out` if there is one. */
static bool read_log(const char *path, FILE *out, struct outcome *outcome)
{
    FILE *file = fopen(path, "r");
    char *line = NULL;
    size_t capacity = 0;
    ssize_t size;
    if (!file) {
        fprintf(stderr, "gnomon: %s: %s\n", path, strerror(errno));
        return false;
    }
    while ((size = getline(&line, &capacity, file)) > 0) {
        count_line(outcome, line, (size_t)size);
        if (out)
            fwrite(line, 1, (size_t)size, out);
    }
    free(line);
    fclose(file);
    return true;
}

/* The runs of all documents become the runs of one. */
static bool add_sarif(yyjson_mut_doc *all, const char *path)
{
    yyjson_read_err error;
    yyjson_doc *document = yyjson_read_file(path, 0, NULL, &error);
    if (!document) {
        fprintf(stderr, "gnomon: %s: %s\n", path, error.msg);
        return false;
    }
    yyjson_val *root = yyjson_doc_get_root(document), *run;
    size_t i, max;
    if (!yyjson_mut_doc_get_root(all)) {
        yyjson_mut_doc_set_root(all, yyjson_val_mut_copy(all, root));
    } else {
        yyjson_mut_val *runs = yyjson_mut_obj_get(yyjson_mut_doc_get_root(all), "runs");
        yyjson_arr_foreach(yyjson_obj_get(root, "runs"), i, max, run) yyjson_mut_arr_append(runs, yyjson_val_mut_copy(all, run));
    }
    yyjson_doc_free(document);
    return true;
}

static int only_files(const struct dirent *entry)
{
    return entry->d_name[0] != '.';
}

/* Joins the files of all processes, counts what they say, and removes them. */
static bool collect(const char *folder, const char *sarif_path, FILE *log, struct outcome *outcome)
{
    struct dirent **entries = NULL;
    yyjson_mut_doc *sarif = yyjson_mut_doc_new(NULL);
    int count = scandir(folder, &entries, only_files, alphasort);
    bool good = count >= 0 && sarif;
    for (int i = 0; i < count; i++) {
        char path[8192];
        snprintf(path, sizeof path, "%s/%s", folder, entries[i]->d_name);
        const char *extension = strrchr(entries[i]->d_name, '.');
        if (good)
            good = extension && strcmp(extension, ".sarif") == 0 ? add_sarif(sarif, path) : read_log(path, log, outcome);
        unlink(path);
        free(entries[i]);
    }
    free(entries);
    rmdir(folder);
    if (good && sarif_path && yyjson_mut_doc_get_root(sarif)) {
        yyjson_write_err error;
        if (!yyjson_mut_write_file(sarif_path, sarif, YYJSON_WRITE_PRETTY, NULL, &error)) {
            fprintf(stderr, "gnomon: %s: %s\n", sarif_path, error.msg);
            good = false;
        }
    }
    yyjson_mut_doc_free(sarif);
    return good;
}

static void print_entries(const struct entries *entries, const char *title)
{
    for (size_t i = 0; i < entries->count; i++) {
        const struct entry *entry = &entries->list[i];
        if (entry->counted && !entry->count)
            continue;
        fprintf(stderr, "  %-11s ", title);
        if (entry->counted)
            fprintf(stderr, "%llu ", entry->count);
        fprintf(stderr, "%s%s%s\n", entry->what, *entry->why ? ": " : "", entry->why);
    }
}

static const char *plural(unsigned long long count)
{
    return count == 1 ? "" : "s";
}

/* The verdict first, then what it rests on. Returns the exit status. */
static int conclude(const struct outcome *outcome, const char *application, int status)
{
    bool died = WIFSIGNALED(status), failed = died || WEXITSTATUS(status) != 0;
    unsigned long long errors = outcome->sites[GN_SEVERITY_ERROR], warnings = outcome->sites[GN_SEVERITY_WARNING],
                       notes = outcome->sites[GN_SEVERITY_NOTE];
    const char *verdict = errors || failed ? "FAIL" : outcome->judged_devices ? "PASS" : "NOTHING JUDGED";
    fprintf(stderr, "gnomon layer: %s: %llu error%s, %llu warning%s and %llu note%s in %s", verdict, errors, plural(errors), warnings,
            plural(warnings), notes, plural(notes), application);
    if (died)
        fprintf(stderr, ", which died of signal %d (%s)", WTERMSIG(status), strsignal(WTERMSIG(status)));
    else if (failed)
        fprintf(stderr, ", which ended with status %d", WEXITSTATUS(status));
    fprintf(stderr, "\n");
    for (int severity = GN_SEVERITY_ERROR; severity > GN_SEVERITY_SILENT; severity--)
        for (size_t i = 0; i < outcome->row_count; i++) {
            const struct row *row = &outcome->rows[i];
            if ((int)row->severity == severity)
                fprintf(stderr, "  %-11s %s: %llu time%s at %llu site%s\n", gn_severity_name(row->severity), row->rule, row->count,
                        plural(row->count), row->sites, plural(row->sites));
        }
    print_entries(&outcome->checked, "checked");
    print_entries(&outcome->not_checked, "not checked");
    if (!outcome->statements)
        fprintf(stderr, "  not checked everything: no Vulkan instance was made with the layer, or its end was not reached\n");
    else if (!outcome->judged_devices)
        fprintf(stderr, "  not checked everything: no device with acceleration structures was made\n");
    if (outcome->damaged)
        fprintf(stderr, "  not checked %llu damaged line%s of the log\n", outcome->damaged, plural(outcome->damaged));
    return errors || failed ? 1 : outcome->damaged ? 3 : outcome->judged_devices ? 0 : 4;
}

/* A place for the files whose name the layer's settings can carry: they take commas and colons for separators. */
static bool make_folder(char *out, size_t size)
{
    const char *base = getenv("TMPDIR");
    if (!base || base[0] != '/' || strpbrk(base, ",:%") || strlen(base) > 512)
        base = "/tmp";
    snprintf(out, size, "%s/gnomon-layer-XXXXXX", base);
    if (mkdtemp(out))
        return true;
    fprintf(stderr, "gnomon: %s: %s\n", out, strerror(errno));
    return false;
}

/* Where the records of shaders outlive their process. Memory of a disk is not what every driver lets a device write to. */
static bool make_records_folder(char *out, size_t size)
{
    snprintf(out, size, "/dev/shm/gnomon-layer-XXXXXX");
    return mkdtemp(out) || make_folder(out, size);
}

/* A killed process has left something; the layer itself tells what, when the next instance is made. */
static bool tell_left(const char *records)
{
    struct dirent **entries = NULL;
    int count = scandir(records, &entries, only_files, alphasort);
    for (int i = 0; i < count; i++)
        free(entries[i]);
    free(entries);
    pid_t pid = count > 0 ? fork() : -1;
    if (pid == 0) {
        const VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_1};
        const VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &application};
        VkInstance instance;
        if (vkCreateInstance(&info, NULL, &instance) == VK_SUCCESS)
            vkDestroyInstance(instance, NULL);
        _exit(0);
    }
    while (pid > 0 && waitpid(pid, NULL, 0) < 0 && errno == EINTR)
        ;
    return pid > 0;
}

int gn_command_layer(int argc, char **argv)
{
    static const struct argp parser = {
        options, parse, "[--] APP [ARGS...]",
        "Runs an application under the layer, and says what it did wrong with ray tracing.\v"
        "The application's own output stays as it is; findings and the verdict go to the standard error stream. Other settings of the "
        "layer are set as docs/layer.md describes. Exit status: 0 no errors found, 1 errors found or the application failed, 2 wrong "
        "usage, 3 Gnomon itself failed, 4 nothing was judged.",
        NULL, NULL, NULL};
    struct arguments arguments = {0};
    struct outcome *outcome = NULL;
    FILE *log = NULL;
    char layer[4200], folder[600], records[600], path[700];
    int exit_status = 3, status = 0;
    if (argp_parse(&parser, argc, argv, ARGP_IN_ORDER, NULL, &arguments) != 0)
        return 2;
    gn_layer_find(layer, sizeof layer);
    if (!*layer)
        return 3;
    enable_layer(&arguments, layer);
    if (arguments.print_env)
        return fflush(stdout) == 0 && !ferror(stdout) ? 0 : 3;

    if (arguments.log && !(log = fopen(arguments.log, "we"))) {
        fprintf(stderr, "gnomon: %s: %s\n", arguments.log, strerror(errno));
        return 2;
    }
    if (arguments.sarif) {
        FILE *file = fopen(arguments.sarif, "we");
        if (!file) {
            fprintf(stderr, "gnomon: %s: %s\n", arguments.sarif, strerror(errno));
            exit_status = 2;
            goto done;
        }
        fclose(file);
    }
    outcome = calloc(1, sizeof *outcome);
    if (!outcome || !make_folder(folder, sizeof folder))
        goto done;
    if (!make_records_folder(records, sizeof records)) {
        rmdir(folder);
        goto done;
    }
    setenv(SETTING "RECORDS_FOLDER", records, 1);
    snprintf(path, sizeof path, "%s/%%p.jsonl", folder);
    setenv(SETTING "LOG_FILE", path, 1);
    if (arguments.sarif) {
        snprintf(path, sizeof path, "%s/%%p.sarif", folder);
        setenv(SETTING "SARIF_FILE", path, 1);
    }
    setenv(SETTING "CRASH_STATEMENT", "true", 0);
    bool started = run_application(arguments.application, &status);
    bool left = started && tell_left(records);
    rmdir(records);
    bool collected = collect(folder, arguments.sarif, log, outcome);
    if (left && outcome->statements)
        outcome->statements--; /* it is not the application's */
    if (!started)
        exit_status = 2;
    else if (collected)
        exit_status = conclude(outcome, arguments.application[0], status);
done:
    if (log && (ferror(log) | fclose(log))) {
        fprintf(stderr, "gnomon: %s: cannot write\n", arguments.log);
        exit_status = 3;
    }
    free(outcome);
    return exit_status;
}
