/* SPDX-License-Identifier: Apache-2.0 */
/* The parent's side of a worker: starting it, its pipes, what it prints, its end. */
#include "cts/worker.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "cts/driver.h"

/* A line longer than this is no result: a picture of 16 million rays is a tenth of it. */
#define MAX_LINE ((size_t)256 << 20)
/* How much of what a driver printed is kept, and beyond what size its file is emptied. */
#define NOISE_KEPT 4000
#define NOISE_MOST ((off_t)16 << 20)

static void close_all(struct gn_process *process)
{
    int *fds[] = {&process->to, &process->from, &process->noise};
    for (size_t i = 0; i < sizeof fds / sizeof fds[0]; i++) {
        if (*fds[i] >= 0)
            close(*fds[i]);
        *fds[i] = -1;
    }
    free(process->buffer);
    process->buffer = NULL;
    process->used = process->capacity = 0;
}

/* Between fork and exec: only what is safe there. */
static void become_worker(const char *program, char *const *arguments, int in, int out, int noise, int null, pid_t parent)
{
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent)
        _exit(3);
    static const int handled[] = {SIGINT, SIGTERM, SIGHUP, SIGPIPE, SIGXFSZ, SIGCHLD};
    for (size_t i = 0; i < sizeof handled / sizeof handled[0]; i++)
        signal(handled[i], SIG_DFL);
    sigset_t none;
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, NULL);
    /* The descriptors are all above 9 (see high()), so that none is overwritten before it is copied. */
    if (dup2(null, 0) < 0 || dup2(noise, 1) < 0 || dup2(noise, 2) < 0 || dup2(in, 3) < 0 || dup2(out, 4) < 0)
        _exit(3);
    execv(program, arguments);
    static const char message[] = "gnomon: cannot start the worker's program\n";
    if (write(2, message, sizeof message - 1) < 0)
        _exit(3);
    _exit(3);
}

/* Moves a descriptor above those that the worker uses. */
static int high(int fd)
{
    if (fd < 0)
        return fd;
    int moved = fcntl(fd, F_DUPFD_CLOEXEC, 10);
    close(fd);
    return moved;
}

bool gn_process_start(struct gn_process *process, const char *icd, uint64_t seed, double scale,
                      char *out_error, size_t error_size)
{
    int in[2] = {-1, -1}, out[2] = {-1, -1}, null = -1;
    char seed_text[32], scale_text[64];
    *process = (struct gn_process){0, -1, -1, -1, NULL, 0, 0};
    snprintf(seed_text, sizeof seed_text, "%" PRIu64, seed);
    snprintf(scale_text, sizeof scale_text, "%a", scale);
    struct gn_arena arena = {0};
    struct gn_driver_loader loader = gn_driver_loader(icd, &arena);
    const char *own = "/proc/self/exe", *arguments[16];
    char own_path[PATH_MAX];
    size_t argument_count = 0;
    arguments[argument_count++] = "gnomon";
    if (loader.loader) {
        /* The loader would take /proc/self/exe for itself. */
        ssize_t length = readlink(own, own_path, sizeof own_path - 1);
        own_path[length > 0 ? length : 0] = 0;
        arguments[argument_count++] = "--library-path";
        arguments[argument_count++] = loader.libraries;
        arguments[argument_count++] = own_path;
    }
    arguments[argument_count++] = "worker";
    arguments[argument_count++] = icd;
    arguments[argument_count++] = seed_text;
    arguments[argument_count++] = scale_text;
    arguments[argument_count] = NULL;

    null = high(open("/dev/null", O_RDWR | O_CLOEXEC));
    /* Opened by its name in /proc for an append mode of its own: the worker's prints then survive our
     * truncation. */
    int memory = memfd_create("gnomon-worker-output", MFD_CLOEXEC);
    if (memory >= 0) {
        char path[64];
        snprintf(path, sizeof path, "/proc/self/fd/%d", memory);
        process->noise = high(open(path, O_RDWR | O_APPEND | O_CLOEXEC));
        close(memory);
    }
    if (null < 0 || process->noise < 0 || pipe2(in, O_CLOEXEC) != 0 || pipe2(out, O_CLOEXEC) != 0) {
        snprintf(out_error, error_size, "cannot start a worker: no more files: %s", strerror(errno));
        goto fail;
    }
    for (int i = 0; i < 2; i++) {
        in[i] = high(in[i]);
        out[i] = high(out[i]);
    }
    if (in[0] < 0 || in[1] < 0 || out[0] < 0 || out[1] < 0) {
        snprintf(out_error, error_size, "cannot start a worker: no more files: %s", strerror(errno));
        goto fail;
    }
    pid_t parent = getpid();
    pid_t pid = fork();
    if (pid < 0) {
        snprintf(out_error, error_size, "cannot start a worker: %s", strerror(errno));
        goto fail;
    }
    if (pid == 0)
        become_worker(loader.loader ? loader.loader : own, (char *const *)(uintptr_t)arguments, in[0], out[1], process->noise, null, parent);
    setpgid(pid, pid);
    process->pid = pid;
    process->to = in[1];
    process->from = out[0];
    close(in[0]);
    close(out[1]);
    close(null);
    fcntl(process->from, F_SETFL, O_NONBLOCK);
    gn_arena_finish(&arena);
    return true;
fail:
    gn_arena_finish(&arena);
    for (int i = 0; i < 2; i++) {
        if (in[i] >= 0)
            close(in[i]);
        if (out[i] >= 0)
            close(out[i]);
    }
    if (null >= 0)
        close(null);
    close_all(process);
    return false;
}

int gn_process_read(struct gn_process *process)
{
    if (process->capacity - process->used < 65536) {
        size_t capacity = process->capacity ? process->capacity * 2 : 131072;
        char *grown = capacity <= MAX_LINE ? realloc(process->buffer, capacity) : NULL;
        if (!grown)
            return 0;
        process->buffer = grown;
        process->capacity = capacity;
    }
    ssize_t n = read(process->from, process->buffer + process->used, process->capacity - process->used);
    if (n < 0)
        return errno == EAGAIN || errno == EINTR ? -1 : 0;
    process->used += (size_t)n;
    return n > 0;
}

char *gn_process_line(struct gn_process *process, size_t *inout_position, size_t *out_length)
{
    if (!process->buffer)
        return NULL;
    char *line = process->buffer + *inout_position;
    char *end = memchr(line, '\n', process->used - *inout_position);
    if (!end)
        return NULL;
    *end = 0;
    *out_length = (size_t)(end - line);
    *inout_position += *out_length + 1;
    return line;
}

void gn_process_consume(struct gn_process *process, size_t position)
{
    memmove(process->buffer, process->buffer + position, process->used - position);
    process->used -= position;
}

bool gn_process_send(struct gn_process *process, const char *name)
{
    /* A name fits into the pipe's buffer, so this does not block. */
    char line[600];
    int length = snprintf(line, sizeof line, "%s\n", name);
    return length > 0 && (size_t)length < sizeof line && write(process->to, line, (size_t)length) == length;
}

void gn_process_noise_reset(struct gn_process *process)
{
    struct stat info;
    if (process->noise >= 0 && fstat(process->noise, &info) == 0 && info.st_size > 0)
        (void)!ftruncate(process->noise, 0);
}

void gn_process_noise_limit(struct gn_process *process)
{
    struct stat info;
    if (process->noise >= 0 && fstat(process->noise, &info) == 0 && info.st_size > NOISE_MOST)
        (void)!ftruncate(process->noise, 0);
}

char *gn_process_noise(struct gn_process *process)
{
    struct stat info;
    char *text = malloc(NOISE_KEPT + 1);
    if (!text)
        return NULL;
    text[0] = 0;
    if (process->noise < 0 || fstat(process->noise, &info) != 0)
        return text;
    off_t start = info.st_size > NOISE_KEPT ? info.st_size - NOISE_KEPT : 0;
    ssize_t n = pread(process->noise, text, NOISE_KEPT, start);
    text[n > 0 ? n : 0] = 0;
    /* Zero bytes would hide what follows them. */
    for (ssize_t i = 0; i < n; i++)
        if (!text[i])
            text[i] = '?';
    gn_text_clean(text);
    while (n > 0 && (text[n - 1] == '\n' || text[n - 1] == ' '))
        text[--n] = 0;
    return text;
}

void gn_process_end_input(struct gn_process *process)
{
    if (process->to >= 0)
        close(process->to);
    process->to = -1;
}

int gn_process_reap(struct gn_process *process)
{
    int status = 0;
    struct timespec nap = {0, 5 * 1000 * 1000};
    if (process->pid <= 0)
        return 0;
    for (int i = 0; i < 400; i++) {
        if (waitpid(process->pid, &status, WNOHANG) != 0)
            goto gone;
        nanosleep(&nap, NULL);
    }
    kill(-process->pid, SIGKILL);
    while (waitpid(process->pid, &status, 0) < 0 && errno == EINTR) {
    }
gone:
    /* Whatever the driver started in the group goes with its worker. */
    kill(-process->pid, SIGKILL);
    process->pid = 0;
    return status;
}

void gn_process_end(struct gn_process *process, bool kill_it)
{
    if (process->pid > 0 && kill_it)
        kill(-process->pid, SIGKILL);
    gn_process_reap(process);
    close_all(process);
}
