/* SPDX-License-Identifier: Apache-2.0 */
/* The JSON Lines log, written with plain file descriptors: every line is in the file before the next command runs. */
#include "layer/log.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define COUNT_DIGITS 20

struct gn_log {
    int fd;
    bool seekable;
    int64_t end;
    dev_t device;
    ino_t inode;
    uint32_t references;
    pthread_mutex_t lock;
    struct gn_log *next;
};

/* Files this process writes. A file that was closed stays known, so that a later instance adds to it. */
static pthread_mutex_t files_lock = PTHREAD_MUTEX_INITIALIZER;
static struct gn_log *files;

struct gn_log *gn_log_open(const char *path, const char *setting, char *problem, size_t problem_size)
{
    struct gn_log *log = NULL;
    struct stat status;
    int fd = open(path, O_WRONLY | O_CREAT | O_CLOEXEC | O_NOCTTY, 0666);
    if (fd < 0 || fstat(fd, &status) != 0) {
        snprintf(problem, problem_size, "%s: cannot write \"%s\": %s. The file is left out.", setting, path, strerror(errno));
        goto fail;
    }
    pthread_mutex_lock(&files_lock);
    for (log = files; log; log = log->next)
        if (log->device == status.st_dev && log->inode == status.st_ino)
            break;
    /* A file that was removed may have left its number to a new one. */
    if (log && log->end > status.st_size)
        log->end = status.st_size;
    if (log && log->references++ == 0) {
        log->fd = fd;
        fd = -1;
    } else if (!log && (log = calloc(1, sizeof *log))) {
        *log = (struct gn_log){.fd = fd,
                               .seekable = S_ISREG(status.st_mode),
                               .device = status.st_dev,
                               .inode = status.st_ino,
                               .references = 1,
                               .next = files};
        pthread_mutex_init(&log->lock, NULL);
        if (log->seekable && ftruncate(fd, 0) != 0)
            log->end = status.st_size;
        files = log;
        fd = -1;
    }
    pthread_mutex_unlock(&files_lock);
    if (!log)
        snprintf(problem, problem_size, "%s: out of memory. The file is left out.", setting);
fail:
    if (fd >= 0)
        close(fd);
    return log;
}

void gn_log_close(struct gn_log *log)
{
    if (!log)
        return;
    pthread_mutex_lock(&files_lock);
    if (--log->references == 0) {
        close(log->fd);
        log->fd = -1;
    }
    pthread_mutex_unlock(&files_lock);
}

__attribute__((destructor)) static void forget_files(void)
{
    for (struct gn_log *log = files, *next; log; log = next) {
        next = log->next;
        if (log->references == 0) {
            pthread_mutex_destroy(&log->lock);
            free(log);
        }
    }
    files = NULL;
}

/* A full disk loses lines of the log; it must not end the application. */
static void write_all(struct gn_log *log, const char *data, size_t size, int64_t at)
{
    while (size) {
        ssize_t done = log->seekable ? pwrite(log->fd, data, size, at) : write(log->fd, data, size);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            return;
        data += done;
        size -= (size_t)done;
        at += done;
    }
}

static int64_t add_line(struct gn_log *log, const char *data, size_t size)
{
    pthread_mutex_lock(&log->lock);
    int64_t at = log->end;
    write_all(log, data, size, at);
    log->end += (int64_t)size;
    pthread_mutex_unlock(&log->lock);
    return log->seekable ? at : -1;
}

int64_t gn_log_insert(struct gn_log *log, const char *text, size_t size, const char *tail, size_t tail_size)
{
    if (!log->seekable)
        return -1;
    pthread_mutex_lock(&log->lock);
    int64_t at = log->end;
    write_all(log, text, size, at);
    write_all(log, tail, tail_size, at + (int64_t)size);
    log->end += (int64_t)size;
    pthread_mutex_unlock(&log->lock);
    return at;
}

void gn_log_line(struct gn_log *log, const char *text, size_t size)
{
    char *line = malloc(size + 1);
    if (!line)
        return;
    memcpy(line, text, size);
    line[size] = '\n';
    add_line(log, line, size + 1);
    free(line);
}

int64_t gn_log_finding(struct gn_log *log, const struct gn_finding *finding, uint64_t count)
{
    int64_t place = -1;
    struct gn_text text = {0};
    gn_text_add(&text, "{\"rule\":");
    gn_text_add_string(&text, finding->rule->id);
    gn_text_add(&text, ",\"severity\":\"%s\",\"count\":", gn_severity_name(finding->severity));
    size_t count_at = text.size;
    gn_text_add(&text, "%-*llu,\"message\":", COUNT_DIGITS, (unsigned long long)count);
    gn_text_add_string(&text, finding->message);
    gn_text_add(&text, ",\"remedy\":");
    gn_text_add_string(&text, finding->rule->remedy);
    gn_text_add(&text, ",\"objects\":[");
    for (uint32_t i = 0; i < finding->object_count; i++) {
        const struct gn_object *object = &finding->objects[i];
        gn_text_add(&text, "%s{\"type\":\"%s\",\"handle\":\"0x%llx\",\"name\":", i ? "," : "",
                    gn_object_kind_name(object->kind), (unsigned long long)object->handle);
        if (object->name)
            gn_text_add_string(&text, object->name);
        else
            gn_text_add(&text, "null");
        gn_text_add(&text, "}");
    }
    gn_text_add(&text, "],\"source\":[");
    for (uint32_t i = 0; finding->rule->sources[i]; i++)
        gn_text_add(&text, "%s\"%s\"", i ? "," : "", finding->rule->sources[i]);
    gn_text_add(&text, "]}\n");
    if (!text.failed) {
        place = add_line(log, text.data, text.size);
        if (place >= 0)
            place += (int64_t)count_at;
    }
    gn_text_finish(&text);
    return place;
}

void gn_log_recount(struct gn_log *log, int64_t place, uint64_t count)
{
    char digits[COUNT_DIGITS + 1];
    if (place < 0)
        return;
    snprintf(digits, sizeof digits, "%-*llu", COUNT_DIGITS, (unsigned long long)count);
    pthread_mutex_lock(&log->lock);
    write_all(log, digits, COUNT_DIGITS, place);
    pthread_mutex_unlock(&log->lock);
}

void gn_text_finish(struct gn_text *text)
{
    free(text->data);
    *text = (struct gn_text){0};
}

static bool reserve(struct gn_text *text, size_t more)
{
    if (text->failed)
        return false;
    if (text->capacity - text->size > more)
        return true;
    size_t capacity = (text->size + more) * 2 + 256;
    char *data = realloc(text->data, capacity);
    if (!data) {
        text->failed = 1;
        return false;
    }
    text->data = data;
    text->capacity = capacity;
    return true;
}

void gn_text_add(struct gn_text *text, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    int size = vsnprintf(NULL, 0, format, arguments);
    va_end(arguments);
    if (size < 0 || !reserve(text, (size_t)size + 1))
        return;
    va_start(arguments, format);
    vsnprintf(text->data + text->size, (size_t)size + 1, format, arguments);
    va_end(arguments);
    text->size += (size_t)size;
}

void gn_text_add_all(struct gn_text *text, const char *data, size_t size)
{
    if (!reserve(text, size + 1))
        return;
    memcpy(text->data + text->size, data, size);
    text->size += size;
    text->data[text->size] = '\0';
}

/* The length of the UTF-8 sequence at `s`; 0 when it is not one (overlong, surrogate, cut off). */
static size_t sequence(const unsigned char *s)
{
    static const uint32_t least[] = {0, 0, 0x80, 0x800, 0x10000};
    size_t length = s[0] < 0x80 ? 1 : s[0] >= 0xC2 && s[0] < 0xE0 ? 2 : (s[0] & 0xF0) == 0xE0 ? 3 : (s[0] & 0xF8) == 0xF0 ? 4 : 0;
    if (length < 2)
        return length;
    uint32_t code = s[0] & (0x7Fu >> length);
    for (size_t i = 1; i < length; i++) {
        if ((s[i] & 0xC0) != 0x80)
            return 0;
        code = code << 6 | (s[i] & 0x3F);
    }
    return code < least[length] || code > 0x10FFFF || (code >= 0xD800 && code < 0xE000) ? 0 : length;
}

void gn_text_add_string(struct gn_text *text, const char *string)
{
    gn_text_add(text, "\"");
    for (const unsigned char *s = (const unsigned char *)string; *s;) {
        size_t length = sequence(s);
        if (length == 0) {
            gn_text_add(text, "\\ufffd");
            s++;
        } else if (*s == '"' || *s == '\\') {
            gn_text_add(text, "\\%c", *s++);
        } else if (*s < 0x20) {
            gn_text_add(text, "\\u%04x", *s++);
        } else {
            gn_text_add(text, "%.*s", (int)length, (const char *)s);
            s += length;
        }
    }
    gn_text_add(text, "\"");
}
