/* SPDX-License-Identifier: Apache-2.0 */
/* The output folder. What is there at any moment is readable, also after a kill or with a full disk. */
#include "cts/output.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

static char *path_of(const char *folder, const char *rest)
{
    size_t size = strlen(folder) + strlen(rest) + 2;
    char *path = malloc(size);
    if (!path) {
        fprintf(stderr, "gnomon: out of memory for a path\n");
        exit(3);
    }
    snprintf(path, size, "%s/%s", folder, rest);
    return path;
}

/*
 * The length of the whole case lines: what a kill tore off and an earlier summary are not among them.
 */
static int64_t case_lines_length(const char *data, size_t length)
{
    static const char summary[] = "{\"name\":\"summary\",";
    int64_t kept = 0;
    for (const char *at = data, *end; (end = memchr(at, '\n', length - (size_t)(at - data))); at = end + 1)
        if ((size_t)(end - at) < sizeof summary || memcmp(at, summary, sizeof summary - 1) != 0)
            kept = end + 1 - data;
    return kept;
}

bool gn_folder_lock(const char *folder, int *out_lock, char *out_error, size_t error_size)
{
    int lock = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    *out_lock = 0;
    if (lock < 0)
        return true; /* a folder that may be written but not read cannot be locked */
    if (flock(lock, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        snprintf(out_error, error_size, "%s is in use by another run; choose another folder with --out", folder);
        close(lock);
        return false;
    }
    *out_lock = lock;
    return true;
}

bool gn_output_open(struct gn_output *output, const char *folder, struct gn_results *out_earlier,
                    int *out_exit_status, char *out_error, size_t error_size)
{
    char *path = path_of(folder, "results.jsonl"), *data = NULL;
    size_t length = 0;
    bool ok = false;
    char ignored[512];
    output->folder = folder;
    *out_exit_status = 2;
    if (!gn_folder_create(folder, out_error, error_size))
        goto done;
    if (!gn_folder_lock(folder, &output->lock, out_error, error_size))
        goto done;
    output->fd = open(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    if (output->fd < 0) {
        *out_exit_status = errno == ENOSPC || errno == EDQUOT ? 3 : 2;
        snprintf(out_error, error_size, "cannot write %s: %s", path, strerror(errno));
        output->fd = 0;
        goto done;
    }
    /* An earlier file that cannot be understood only matters to --resume, which reads it again. */
    if (gn_file_read(path, (size_t)1 << 30, &data, &length, ignored, sizeof ignored))
        output->length = case_lines_length(data, length);
    (void)gn_results_jsonl_read(out_earlier, path, ignored, sizeof ignored);
    ok = true;
done:
    free(data);
    free(path);
    return ok;
}

static bool write_run(const struct gn_output *output, const struct gn_results_run *run, char *out_error,
                      size_t error_size)
{
    size_t length = 0;
    char *path = path_of(output->folder, "run.json"), *text = gn_results_run_encode(run, &length);
    bool ok = false;
    if (!text)
        snprintf(out_error, error_size, "out of memory for %s", path);
    else
        ok = gn_file_write(path, text, length, out_error, error_size);
    free(text);
    free(path);
    return ok;
}

/* Whether an earlier run can be gone on with; a message says what differs. */
static bool same_run(const struct gn_results_run *a, const struct gn_results_run *b, char *out_error,
                     size_t error_size)
{
    const char *what = strcmp(a->driver, b->driver) != 0 ? "driver" : gn_results_run_difference(a, b);
    if (!what && (a->shard != b->shard || a->shard_count != b->shard_count || a->durations != b->durations))
        what = "shard";
    if (what)
        snprintf(out_error, error_size, "--resume: the earlier run had another %s", what);
    return !what;
}

static bool resume_run(struct gn_output *output, struct gn_results *results, int *out_exit_status,
                       char *out_error, size_t error_size)
{
    struct gn_results_run earlier;
    char *run_path = path_of(output->folder, "run.json"), *path = path_of(output->folder, "results.jsonl");
    char *text = NULL, error[512];
    size_t length = 0;
    bool ok = false;
    *out_exit_status = 2;
    if (!gn_file_read(run_path, 1 << 20, &text, &length, error, sizeof error)) {
        snprintf(out_error, error_size, "--resume: %s", error);
        goto done;
    }
    if (!gn_results_run_decode(text, length, &results->arena, &earlier, error, sizeof error)) {
        snprintf(out_error, error_size, "--resume: %s: %s", run_path, error);
        goto done;
    }
    if (!same_run(&earlier, &results->run, out_error, error_size))
        goto done;
    if (!gn_results_jsonl_read(results, path, error, sizeof error)) {
        snprintf(out_error, error_size, "--resume: %s", error);
        goto done;
    }
    ok = true;
done:
    free(text);
    free(path);
    free(run_path);
    return ok;
}

bool gn_output_begin(struct gn_output *output, struct gn_results *results, bool resume, int *out_exit_status,
                     char *out_error, size_t error_size)
{
    static const char *const reports[] = {"report.html", "junit.xml", "results.csv"};
    if (resume) {
        if (!resume_run(output, results, out_exit_status, out_error, error_size))
            return false;
    } else {
        output->length = 0;
    }
    *out_exit_status = 3;
    /* A device such as /dev/full in the file's place cannot be cut; writing to it will say what is wrong. */
    struct stat info;
    if (fstat(output->fd, &info) == 0 && S_ISREG(info.st_mode) &&
        ftruncate(output->fd, output->length) != 0) {
        snprintf(out_error, error_size, "cannot write %s/results.jsonl: %s", output->folder, strerror(errno));
        return false;
    }
    /* Reports of an earlier run would pass for this one's until they are replaced. */
    for (size_t i = 0; i < sizeof reports / sizeof reports[0]; i++) {
        char *path = path_of(output->folder, reports[i]);
        unlink(path);
        free(path);
    }
    return write_run(output, &results->run, out_error, error_size);
}

static bool append_line(struct gn_output *output, const char *text, size_t length, char *out_error,
                        size_t error_size)
{
    const char *parts[] = {text, "\n"};
    size_t lengths[] = {length, 1};
    for (int p = 0; p < 2; p++) {
        for (size_t done = 0; done < lengths[p];) {
            ssize_t n = write(output->fd, parts[p] + done, lengths[p] - done);
            if (n < 0 && errno == EINTR)
                continue;
            if (n <= 0) {
                snprintf(out_error, error_size, "cannot write %s/results.jsonl: %s", output->folder,
                         strerror(n ? errno : ENOSPC));
                /* Half a line is no line. */
                (void)!ftruncate(output->fd, output->length);
                return false;
            }
            done += (size_t)n;
        }
    }
    output->length += (int64_t)length + 1;
    return true;
}

static bool write_picture(const struct gn_output *output, const struct gn_results_case *cs, const char *name,
                          char *out_error, size_t error_size)
{
    size_t length = 0;
    char *folder = path_of(output->folder, "images"), *path = path_of(output->folder, name);
    uint8_t *png = gn_picture_png(cs->image, cs->picture_width, cs->picture_height, &length);
    bool ok = false;
    if (!png)
        snprintf(out_error, error_size, "out of memory for %s", path);
    else
        ok = gn_folder_create(folder, out_error, error_size) &&
             gn_file_write(path, png, length, out_error, error_size);
    free(png);
    free(path);
    free(folder);
    return ok;
}

static bool write_replay(const struct gn_output *output, const struct gn_results_run *run,
                         const struct gn_results_case *cs, const char *name, char *out_error,
                         size_t error_size)
{
    size_t length = 0;
    char *folder = path_of(output->folder, "replay"), *path = path_of(output->folder, name);
    struct gn_replay replay = {
        .name = cs->name,
        .driver = run->driver,
        .device = run->device.name,
        .seed = run->seed,
        .scale = run->scale,
        .trace = cs->has_offender ? (int64_t)cs->offender.trace : -1,
        .ray = cs->has_offender ? (int64_t)cs->offender.ray_index : -1,
        .status = gn_case_status_name(cs->status),
        .message = cs->message,
    };
    char *text = gn_replay_encode(&replay, &length);
    bool ok = false;
    if (!text)
        snprintf(out_error, error_size, "out of memory for %s", path);
    else
        ok = gn_folder_create(folder, out_error, error_size) &&
             gn_file_write(path, text, length, out_error, error_size);
    free(text);
    free(path);
    free(folder);
    return ok;
}

/* What an earlier run left for a case that has nothing of the kind now. */
static void remove_stale(const struct gn_output *output, const char *name)
{
    char *path = path_of(output->folder, name);
    unlink(path);
    free(path);
}

bool gn_output_case(struct gn_output *output, const struct gn_results_run *run, struct gn_results_case *cs,
                    char *out_error, size_t error_size)
{
    static char picture[512], replay[512];
    size_t length = 0;
    bool failed = gn_case_status_is_failure(cs->status);
    snprintf(picture, sizeof picture, "images/%s.png", cs->name);
    snprintf(replay, sizeof replay, "replay/%s.json", cs->name);
    cs->picture = cs->image ? picture : "";
    cs->replay = failed ? replay : "";
    if (!cs->image)
        remove_stale(output, picture);
    else if (!write_picture(output, cs, picture, out_error, error_size))
        return false;
    if (!failed)
        remove_stale(output, replay);
    else if (!write_replay(output, run, cs, replay, out_error, error_size))
        return false;
    uint8_t *image = cs->image;
    cs->image = NULL;
    char *line = gn_results_case_encode(cs, &length);
    cs->image = image;
    if (!line) {
        snprintf(out_error, error_size, "out of memory for the result of %s", cs->name);
        return false;
    }
    bool ok = append_line(output, line, length, out_error, error_size);
    free(line);
    return ok;
}

static bool take_file(const struct gn_output *output, const char *from, const char *name, char *out_error,
                      size_t error_size)
{
    char *source = path_of(from, name), *target = path_of(output->folder, name), *data = NULL;
    size_t length = 0;
    char *slash = strrchr(target, '/');
    bool ok = gn_file_read(source, (size_t)1 << 30, &data, &length, out_error, error_size);
    if (ok) {
        *slash = 0;
        ok = gn_folder_create(target, out_error, error_size);
        *slash = '/';
    }
    ok = ok && gn_file_write(target, data, length, out_error, error_size);
    free(data);
    free(target);
    free(source);
    return ok;
}

/* Whether a name from a file is one that a run gives: it must not lead out of the folder. */
static bool is_ours(const char *name)
{
    return (strncmp(name, "images/", 7) == 0 || strncmp(name, "replay/", 7) == 0) && !strchr(name + 7, '/');
}

bool gn_output_take(struct gn_output *output, const char *from, const struct gn_results_case *cs, char *out_error,
                    size_t error_size)
{
    const char *const files[] = {cs->picture, cs->replay};
    size_t length = 0;
    for (size_t i = 0; i < 2; i++) {
        if (*files[i] && !is_ours(files[i])) {
            snprintf(out_error, error_size, "%s/results.jsonl: %s has a file '%.200s', which no run has", from, cs->name,
                     files[i]);
            return false;
        }
        if (*files[i] && !take_file(output, from, files[i], out_error, error_size))
            return false;
    }
    char *line = gn_results_case_encode(cs, &length);
    bool ok = line && append_line(output, line, length, out_error, error_size);
    if (!line)
        snprintf(out_error, error_size, "out of memory for the result of %s", cs->name);
    free(line);
    return ok;
}

bool gn_output_end(struct gn_output *output, const struct gn_results *results, char *out_error,
                   size_t error_size)
{
    static const struct {
        const char *name;
        bool (*write)(const struct gn_results *results, const char *path, char *out_error, size_t error_size);
    } reports[] = {{"results.csv", gn_results_csv_write}, {"junit.xml", gn_results_junit_write}};
    size_t length = 0;
    char error[1024];
    bool ok = true;
    char *line = gn_results_summary_encode(results, &length);
    if (!line || !append_line(output, line, length, error, sizeof error)) {
        snprintf(out_error, error_size, "%s", line ? error : "out of memory for the summary");
        ok = false;
    }
    free(line);
    for (size_t i = 0; i < sizeof reports / sizeof reports[0]; i++) {
        char *path = path_of(output->folder, reports[i].name);
        if (!reports[i].write(results, path, error, sizeof error)) {
            if (ok)
                snprintf(out_error, error_size, "%s", error);
            ok = false;
        }
        free(path);
    }
    char *path = path_of(output->folder, "report.html");
    if (!gn_results_html_write(results, output->folder, path, error, sizeof error)) {
        if (ok)
            snprintf(out_error, error_size, "%s", error);
        ok = false;
    }
    free(path);
    return ok;
}

void gn_output_close(struct gn_output *output)
{
    if (output->fd > 0)
        close(output->fd);
    output->fd = 0;
    if (output->lock > 0)
        close(output->lock);
    output->lock = 0;
}
