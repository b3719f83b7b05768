/* SPDX-License-Identifier: Apache-2.0 */
/* Results on disk: whole-file writes, results.csv, reading results.jsonl back. */
#include "cts/results.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

bool gn_folder_create(const char *path, char *out_error, size_t error_size)
{
    char *copy = strdup(path);
    bool ok = false;
    if (!copy) {
        snprintf(out_error, error_size, "out of memory");
        return false;
    }
    for (char *at = copy + 1; *at; at++) {
        if (*at != '/' || at[-1] == '/')
            continue;
        *at = 0;
        /* What is wrong with a folder above shows when the last one is made. */
        mkdir(copy, 0777);
        *at = '/';
    }
    struct stat info;
    if (mkdir(copy, 0777) != 0 && errno != EEXIST)
        snprintf(out_error, error_size, "cannot make the folder %s: %s", path, strerror(errno));
    else if (stat(copy, &info) != 0)
        snprintf(out_error, error_size, "cannot look at the folder %s: %s", path, strerror(errno));
    else if (!S_ISDIR(info.st_mode))
        snprintf(out_error, error_size, "%s is not a folder", path);
    else if (access(copy, W_OK | X_OK) != 0)
        snprintf(out_error, error_size, "cannot write to the folder %s: %s", path, strerror(errno));
    else
        ok = true;
    free(copy);
    return ok;
}

bool gn_file_write(const char *path, const void *data, size_t length, char *out_error, size_t error_size)
{
    size_t size = strlen(path) + 8;
    char *temporary = malloc(size);
    int fd = -1;
    bool ok = false;
    if (!temporary) {
        snprintf(out_error, error_size, "out of memory");
        return false;
    }
    snprintf(temporary, size, "%s.part", path);
    struct stat before;
    bool exists = stat(path, &before) == 0 && S_ISREG(before.st_mode);
    fd = open(temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (fd < 0) {
        snprintf(out_error, error_size, "cannot write %s: %s", path, strerror(errno));
        goto done;
    }
    /* Who may read the file is for its owner to say. */
    if (exists)
        (void)!fchmod(fd, before.st_mode & 0777);
    const char *bytes = data;
    while (length) {
        ssize_t n = write(fd, bytes, length);
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0) {
            snprintf(out_error, error_size, "cannot write %s: %s", path, strerror(n ? errno : ENOSPC));
            goto done;
        }
        bytes += n;
        length -= (size_t)n;
    }
    int closed = close(fd);
    fd = -1;
    if (closed != 0 || rename(temporary, path) != 0) {
        snprintf(out_error, error_size, "cannot write %s: %s", path, strerror(errno));
        goto done;
    }
    ok = true;
done:
    if (fd >= 0)
        close(fd);
    if (!ok)
        unlink(temporary);
    free(temporary);
    return ok;
}

bool gn_file_write_stream(const char *path, FILE *stream, char **text, const size_t *length, char *out_error, size_t error_size)
{
    bool ok = !ferror(stream);
    ok = fclose(stream) == 0 && ok;
    if (ok)
        ok = gn_file_write(path, *text, *length, out_error, error_size);
    else
        snprintf(out_error, error_size, "out of memory for %s", path);
    free(*text);
    return ok;
}

bool gn_file_read(const char *path, size_t limit, char **out_data, size_t *out_length, char *out_error,
                  size_t error_size)
{
    bool ok = false;
    char *data = NULL;
    size_t length = 0, capacity = 0;
    struct stat info;
    FILE *file = fopen(path, "rbe");
    if (!file) {
        snprintf(out_error, error_size, "cannot read %s: %s", path, strerror(errno));
        return false;
    }
    if (fstat(fileno(file), &info) == 0 && S_ISDIR(info.st_mode)) {
        snprintf(out_error, error_size, "cannot read %s: it is a folder", path);
        goto done;
    }
    for (;;) {
        if (capacity - length < 65536) {
            capacity = capacity ? capacity * 2 : 131072;
            char *grown = realloc(data, capacity);
            if (!grown) {
                snprintf(out_error, error_size, "out of memory while reading %s", path);
                goto done;
            }
            data = grown;
        }
        size_t n = fread(data + length, 1, capacity - length - 1, file);
        length += n;
        if (length > limit) {
            snprintf(out_error, error_size, "%s is larger than %zu bytes", path, limit);
            goto done;
        }
        if (n == 0)
            break;
    }
    if (ferror(file)) {
        snprintf(out_error, error_size, "cannot read %s: %s", path, strerror(errno));
        goto done;
    }
    data[length] = 0;
    ok = true;
done:
    fclose(file);
    if (!ok) {
        free(data);
        return false;
    }
    *out_data = data;
    *out_length = length;
    return true;
}

/* deqp-runner's words, with those it uses where there is a baseline. */
static const char *csv_status(const struct gn_results_case *cs)
{
    if (cs->outcome == GN_OUTCOME_EXPECTED_FAILURE)
        return strcmp(cs->expected, "Flake") == 0 ? "KnownFlake" : "ExpectedFail";
    if (cs->outcome == GN_OUTCOME_UNEXPECTED_PASS)
        return "UnexpectedImprovement(Pass)";
    return gn_case_status_deqp(cs->status);
}

bool gn_results_csv_write(const struct gn_results *results, const char *path, char *out_error,
                          size_t error_size)
{
    char *text = NULL;
    size_t length = 0;
    FILE *file = open_memstream(&text, &length);
    if (!file) {
        snprintf(out_error, error_size, "out of memory for %s", path);
        return false;
    }
    for (size_t i = 0; i < results->count; i++)
        fprintf(file, "%s,%s,%.6f\n", results->cases[i].name, csv_status(&results->cases[i]),
                results->cases[i].seconds);
    return gn_file_write_stream(path, file, &text, &length, out_error, error_size);
}

bool gn_results_jsonl_read(struct gn_results *results, const char *path, char *out_error, size_t error_size)
{
    char *data = NULL, error[256];
    size_t length = 0;
    if (access(path, F_OK) != 0 && errno == ENOENT)
        return true;
    if (!gn_file_read(path, (size_t)1 << 30, &data, &length, out_error, error_size))
        return false;
    bool ok = false;
    size_t line = 1;
    for (char *at = data, *end; (end = memchr(at, '\n', length - (size_t)(at - data)));
         at = end + 1, line++) {
        struct gn_results_case cs;
        if (!gn_results_case_decode(at, (size_t)(end - at), &results->arena, &cs, error, sizeof error)) {
            snprintf(out_error, error_size, "%s:%zu: %s", path, line, error);
            goto done;
        }
        if (strcmp(cs.name, "summary") != 0)
            gn_results_add(results, &cs);
    }
    ok = true;
done:
    free(data);
    return ok;
}
