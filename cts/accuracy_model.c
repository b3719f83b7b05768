/* SPDX-License-Identifier: Apache-2.0 */
/* The parent's side of reading a model: starts the child, believes nothing it sends, ends it. */
#include "cts/accuracy_model.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cts/progress.h"
#include "cts/results.h"

#define STAGE_SIZE 256

bool gn_model_is_file_name(const char *name)
{
    static const char *const endings[] = {".obj", ".ply", ".gltf", ".glb", ".stl"};
    size_t length = strlen(name);
    for (size_t i = 0; i < sizeof endings / sizeof endings[0]; i++) {
        size_t size = strlen(endings[i]);
        if (length > size && strcasecmp(name + length - size, endings[i]) == 0)
            return true;
    }
    return false;
}

/* What comes through the pipe until the deadline. */
struct source {
    int fd;
    double deadline;
    bool late, ended;
};

static bool take(struct source *source, void *out, size_t size)
{
    char *at = out;
    while (size) {
        double left = source->deadline - gn_clock();
        if (left <= 0) {
            source->late = true;
            return false;
        }
        struct pollfd wait = {source->fd, POLLIN, 0};
        int ready = poll(&wait, 1, left > 1 ? 1000 : 1 + (int)(left * 1000));
        if (ready < 0 && errno != EINTR)
            return false;
        if (ready <= 0)
            continue;
        ssize_t n = read(source->fd, at, size < ((size_t)1 << 20) ? size : (size_t)1 << 20);
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0) {
            source->ended = true;
            return false;
        }
        at += n;
        size -= (size_t)n;
    }
    return true;
}

/* Arrays grow with what has arrived, so a child that promises much and sends nothing costs nothing. */
static void *take_array(struct source *source, size_t count, size_t size)
{
    size_t bytes = count * size, done = 0, capacity = 0;
    char *data = NULL;
    do {
        size_t next = capacity ? capacity * 2 : (size_t)1 << 20;
        capacity = next < bytes ? next : bytes;
        char *grown = realloc(data, capacity ? capacity : 1);
        if (!grown || !take(source, grown + done, capacity - done)) {
            free(grown ? grown : data);
            return NULL;
        }
        data = grown;
        done = capacity;
    } while (done < bytes);
    return data;
}

static bool take_mesh(struct source *source, struct gn_arena *arena, struct gn_mesh *out,
                      uint64_t *inout_triangles, char *out_error, size_t error_size)
{
    struct gn_model_mesh mesh;
    float(*positions)[3] = NULL;
    uint32_t(*triangles)[3] = NULL;
    bool ok = false;
    if (!take(source, &mesh, sizeof mesh))
        goto done;
    *inout_triangles += mesh.triangle_count;
    if (!mesh.triangle_count || *inout_triangles > GN_MODEL_MOST_TRIANGLES ||
        mesh.position_count / 3 > mesh.triangle_count || !mesh.position_count) {
        snprintf(out_error, error_size, "the reader sent a mesh of %u vertices and %u triangles",
                 mesh.position_count, mesh.triangle_count);
        goto done;
    }
    positions = take_array(source, mesh.position_count, sizeof *positions);
    triangles = positions ? take_array(source, mesh.triangle_count, sizeof *triangles) : NULL;
    if (!triangles)
        goto done;
    *out = (struct gn_mesh){
        gn_arena_alloc(arena, mesh.position_count, sizeof *out->positions), mesh.position_count,
        gn_arena_alloc(arena, mesh.triangle_count, sizeof *out->triangles), mesh.triangle_count};
    for (uint32_t i = 0; i < mesh.position_count; i++) {
        for (int c = 0; c < 3; c++) {
            if (!isfinite(positions[i][c])) {
                snprintf(out_error, error_size, "the reader sent a vertex that is not finite");
                goto done;
            }
            out->positions[i][c] = (double)positions[i][c];
        }
    }
    for (uint32_t i = 0; i < mesh.triangle_count; i++) {
        for (int k = 0; k < 3; k++) {
            if (triangles[i][k] >= mesh.position_count) {
                snprintf(out_error, error_size, "the reader sent an index out of range");
                goto done;
            }
            out->triangles[i][k] = triangles[i][k];
        }
    }
    ok = true;
done:
    free(positions);
    free(triangles);
    return ok;
}

/* The message stays empty where the pipe ended or the time did: then the child's end tells why. */
static bool take_model(struct source *source, struct gn_arena *arena, struct gn_model *out, char *out_error,
                       size_t error_size)
{
    struct gn_model_header header;
    if (!take(source, &header, sizeof header))
        return false;
    if (header.magic != GN_MODEL_MAGIC || header.error_length > 4096) {
        snprintf(out_error, error_size, "the reader sent no model");
        return false;
    }
    if (header.error_length) {
        char text[4097];
        if (!take(source, text, header.error_length))
            return false;
        text[header.error_length] = 0;
        gn_text_clean(text);
        snprintf(out_error, error_size, "%s", text);
        return false;
    }
    if (!header.mesh_count || header.mesh_count > GN_MODEL_MOST_TRIANGLES || !header.instance_count ||
        header.instance_count > GN_MODEL_MOST_INSTANCES) {
        snprintf(out_error, error_size, "the reader sent %u meshes and %u instances", header.mesh_count,
                 header.instance_count);
        return false;
    }
    *out = (struct gn_model){GN_NEW(arena, struct gn_mesh, header.mesh_count), header.mesh_count,
                             GN_NEW(arena, struct gn_model_instance, header.instance_count),
                             header.instance_count};
    uint64_t triangles = 0;
    for (uint32_t i = 0; i < header.mesh_count; i++)
        if (!take_mesh(source, arena, &out->meshes[i], &triangles, out_error, error_size))
            return false;
    if (!take(source, out->instances, header.instance_count * sizeof *out->instances))
        return false;
    for (uint32_t i = 0; i < header.instance_count; i++) {
        bool good = out->instances[i].mesh < header.mesh_count;
        for (int k = 0; k < 12; k++)
            good = good && isfinite(out->instances[i].transform[k]);
        if (!good) {
            snprintf(out_error, error_size, "the reader sent an instance that is not valid");
            return false;
        }
    }
    return true;
}

static uint64_t address_space_in_use(void)
{
    unsigned long long pages = 0;
    FILE *file = fopen("/proc/self/statm", "re");
    if (file) {
        if (fscanf(file, "%llu", &pages) != 1)
            pages = 0;
        fclose(file);
    }
    return (uint64_t)pages * (uint64_t)sysconf(_SC_PAGESIZE);
}

_Noreturn static void become_child(const char *path, int fd, char *stage, double seconds, pid_t parent)
{
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent)
        _exit(3);
    /* Relative to what is mapped already: sanitizers map terabytes that they never touch. */
    rlim_t space = (rlim_t)(address_space_in_use() + GN_MODEL_BYTES), time = (rlim_t)seconds + 2;
    setrlimit(RLIMIT_AS, &(struct rlimit){space, space});
    setrlimit(RLIMIT_CPU, &(struct rlimit){time, time});
    setrlimit(RLIMIT_CORE, &(struct rlimit){0, 0});
    setrlimit(RLIMIT_FSIZE, &(struct rlimit){0, 0});
    static const int handled[] = {SIGSEGV, SIGABRT, SIGBUS,  SIGFPE, SIGILL,
                                  SIGPIPE, SIGINT,  SIGTERM, SIGXCPU};
    for (size_t i = 0; i < sizeof handled / sizeof handled[0]; i++)
        signal(handled[i], SIG_DFL);
    int null = open("/dev/null", O_RDWR);
    if (null >= 0) {
        dup2(null, 0);
        dup2(null, 1);
        dup2(null, 2);
    }
    gn_model_child(path, fd, stage, STAGE_SIZE);
}

static bool check_file(const char *path, char *out_error, size_t error_size)
{
    struct stat info;
    if (stat(path, &info) != 0) {
        snprintf(out_error, error_size, "%s: %s", path, strerror(errno));
    } else if (!S_ISREG(info.st_mode)) {
        snprintf(out_error, error_size, "%s: expected a file, found %s", path,
                 S_ISDIR(info.st_mode) ? "a folder" : "something else");
    } else if (!gn_model_is_file_name(path)) {
        snprintf(out_error, error_size,
                 "%s: expected a model whose name ends in .obj, .ply, .gltf, .glb or .stl", path);
    } else if (access(path, R_OK) != 0) {
        snprintf(out_error, error_size, "%s: %s", path, strerror(errno));
    } else if (info.st_size == 0) {
        snprintf(out_error, error_size, "%s: the file is empty", path);
    } else if (info.st_size > GN_MODEL_MOST_FILE) {
        snprintf(out_error, error_size, "%s: %lld bytes, but models of at most %lld are read", path,
                 (long long)info.st_size, (long long)GN_MODEL_MOST_FILE);
    } else {
        return true;
    }
    return false;
}

bool gn_model_size_check(const char *path, const double low[3], const double high[3], char *out_error, size_t error_size)
{
    double size = 0;
    for (int c = 0; c < 3; c++)
        size = fmax(size, high[c] - low[c]);
    if (size > 1e-30 && size < 1e17 && fabs(low[0]) + fabs(low[1]) + fabs(low[2]) < 1e17)
        return true;
    snprintf(out_error, error_size,
             "%s: it is %g in size, from %g %g %g on; expected a size between 1e-30 and 1e17, and no coordinate beyond "
             "1e17: Embree sees nothing there",
             path, size, low[0], low[1], low[2]);
    return false;
}

bool gn_model_read(const char *path, double seconds, struct gn_arena *arena, struct gn_model *out,
                   char *out_error, size_t error_size)
{
    int ends[2] = {-1, -1}, status = 0;
    pid_t pid = -1;
    bool ok = false;
    char why[4200] = "";
    if (!(seconds > 0))
        seconds = GN_MODEL_SECONDS;
    if (!check_file(path, out_error, error_size))
        return false;
    char *stage = mmap(NULL, STAGE_SIZE, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (stage == MAP_FAILED || pipe2(ends, O_CLOEXEC) != 0) {
        snprintf(out_error, error_size, "%s: cannot start its reader: %s", path, strerror(errno));
        goto done;
    }
    fflush(NULL);
    pid_t parent = getpid();
    pid = fork();
    if (pid < 0) {
        snprintf(out_error, error_size, "%s: cannot start its reader: %s", path, strerror(errno));
        goto done;
    }
    if (pid == 0) {
        close(ends[0]);
        become_child(path, ends[1], stage, seconds, parent);
    }
    close(ends[1]);
    ends[1] = -1;
    struct source source = {ends[0], gn_clock() + seconds, false, false};
    ok = take_model(&source, arena, out, why, sizeof why);
    /* A child that closed its pipe is about to end, and how is wanted; any other has to. */
    if (!source.ended)
        kill(pid, SIGKILL);
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    pid = -1;
    if (ok)
        goto done;
    stage[STAGE_SIZE - 1] = 0;
    char doing[STAGE_SIZE];
    snprintf(doing, sizeof doing, "%s", stage[0] ? stage : "starting");
    gn_text_clean(doing);
    if (why[0])
        snprintf(out_error, error_size, "%s: %s", path, why);
    else if (source.late || (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU))
        snprintf(out_error, error_size, "%s: not read within %g seconds; it was %s", path, seconds, doing);
    else if (WIFSIGNALED(status))
        snprintf(out_error, error_size, "%s: the reader crashed on it (%s) while %s", path,
                 strsignal(WTERMSIG(status)), doing);
    else
        snprintf(out_error, error_size, "%s: malformed: its reader gave up while %s", path, doing);
done:
    if (pid > 0) {
        kill(pid, SIGKILL);
        while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
        }
    }
    for (int i = 0; i < 2; i++)
        if (ends[i] >= 0)
            close(ends[i]);
    if (stage != MAP_FAILED)
        munmap(stage, STAGE_SIZE);
    return ok;
}
