/* SPDX-License-Identifier: Apache-2.0 */
/* Records that outlive the process: with the setting records_folder they lie in files that the device writes to directly, beside what it takes
 * to read them. A process that ends by itself removes its files; what one that was killed has left is told by the next that has the setting.
 *
 * A device has a folder of its own there, named after its process:
 *   index              an entry per shader with records; locked as long as the process lives
 *   piece-N            the memory itself, as shader_memory.c lays it out
 *   gnomon-shader-KEY  what was made of a shader, as in the cache */
#include "layer/shader.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#define PREFIX "gnomon-records-"
#define MAX_PIECES 1024u
#define MAX_ENTRIES 65536u

struct gn_left {
    char *folder;
    int index;
    pid_t owner; /* a child of fork has the files, but they are not its own */
    uint32_t pieces;
};

struct entry {
    uint64_t key;
    uint32_t piece, start, model, checks;
};

static char *join(const char *folder, const char *name)
{
    char *path = NULL;
    return asprintf(&path, "%s/%s", folder, name) < 0 ? NULL : path;
}

/* Only what bears the names above: the folder may be anything. */
static void folder_remove(const char *folder)
{
    DIR *list = opendir(folder);
    for (const struct dirent *item; list && (item = readdir(list));)
        if (strcmp(item->d_name, "index") == 0 || strcmp(item->d_name, "index.new") == 0 || strncmp(item->d_name, "piece-", 6) == 0 ||
            strncmp(item->d_name, "gnomon-shader-", 14) == 0)
            unlinkat(dirfd(list), item->d_name, 0);
    if (list)
        closedir(list);
    rmdir(folder);
}

static void left_free(struct gn_left *left)
{
    if (left->index >= 0)
        close(left->index);
    free(left->folder);
    free(left);
}

/* Under its name the index is always locked by whoever writes it. */
static bool index_create(struct gn_left *left)
{
    char *fresh = join(left->folder, "index.new"), *path = join(left->folder, "index");
    left->index = fresh ? open(fresh, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600) : -1;
    bool good = left->index >= 0 && path && flock(left->index, LOCK_EX | LOCK_NB) == 0 && rename(fresh, path) == 0;
    int problem = errno;
    free(fresh);
    free(path);
    errno = problem;
    return good;
}

struct gn_left *gn_left_begin(struct gn_instance *instance)
{
    const char *base = instance->settings.records_folder;
    struct gn_left *left = base ? calloc(1, sizeof *left) : NULL;
    char text[512];
    if (!left)
        return NULL;
    left->index = -1;
    left->owner = getpid();
    if (mkdir(base, 0777) != 0 && errno != EEXIST)
        goto fail;
    if (asprintf(&left->folder, "%s/" PREFIX "%ld-XXXXXX", base, (long)left->owner) < 0) {
        left->folder = NULL;
        goto fail;
    }
    if (!mkdtemp(left->folder) || !index_create(left))
        goto fail;
    return left;
fail:
    snprintf(text, sizeof text, "records_folder: cannot write in \"%s\": %s. The records of shaders do not outlive the process.", base,
             strerror(errno));
    gn_report_say(instance, GN_SEVERITY_WARNING, "settings", text);
    if (left->index >= 0)
        folder_remove(left->folder);
    left_free(left);
    return NULL;
}

int gn_left_piece(struct gn_left *left, size_t bytes, uint32_t *out_number)
{
    char name[32];
    snprintf(name, sizeof name, "piece-%u", left->pieces);
    char *path = left->pieces < MAX_PIECES ? join(left->folder, name) : NULL;
    int file = path ? open(path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600) : -1;
    free(path);
    if (file < 0)
        return -1;
    *out_number = left->pieces++;
    /* A page that has no room on the disk would end the process when it is written to. */
    if (posix_fallocate(file, 0, (off_t)bytes) == 0)
        return file;
    close(file);
    return -1;
}

void gn_left_shader(struct gn_left *left, const struct gn_shader *shader, uint32_t piece, size_t start)
{
    const struct entry entry = {shader->key, piece, (uint32_t)start, shader->model, shader->result.check_count};
    gn_shader_cache_store(left->folder, shader->key, &shader->result);
    /* What does not fit is not told; the reader takes whole entries only. */
    if (write(left->index, &entry, sizeof entry) < 0)
        return;
}

void gn_left_end(struct gn_left *left)
{
    if (!left)
        return;
    if (left->owner == getpid())
        folder_remove(left->folder);
    left_free(left);
}

/* What a dead process has left */

struct mapping {
    uint32_t *words;
    size_t bytes;
};

static struct mapping piece_map(const char *folder, uint32_t number)
{
    struct mapping mapping = {NULL, 0};
    struct stat about;
    char name[32];
    snprintf(name, sizeof name, "piece-%u", number);
    char *path = join(folder, name);
    int file = path ? open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW) : -1;
    if (file >= 0 && fstat(file, &about) == 0 && S_ISREG(about.st_mode) && about.st_size >= (off_t)(GN_ROOT_HEADER * 4)) {
        void *words = mmap(NULL, (size_t)about.st_size, PROT_READ | PROT_WRITE, MAP_PRIVATE, file, 0);
        if (words != MAP_FAILED)
            mapping = (struct mapping){words, (size_t)about.st_size};
    }
    if (file >= 0)
        close(file);
    free(path);
    return mapping;
}

static void entry_tell(const struct gn_records_teller *teller, const char *folder, const struct entry *entry,
                       const struct mapping *piece, struct gn_findings *findings)
{
    struct gn_shader shader = {.key = entry->key, .model = entry->model};
    size_t room = piece->bytes / 4, words = gn_record_words(entry->checks);
    if (!piece->words || entry->start % 4 || entry->start > room || !words || room - entry->start < words ||
        !gn_shader_cache_load(folder, entry->key, &shader.result))
        return;
    if (shader.result.check_count == entry->checks) {
        gn_record_memory_lay(&shader, piece->words + entry->start);
        gn_shader_collect(teller, &shader, findings);
    }
    gn_spirv_result_finish(&shader.result);
}

static void folder_tell(struct gn_instance *instance, const char *folder, long process)
{
    char *path = join(folder, "index"), remark[128];
    int index = path ? open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW) : -1;
    struct mapping pieces[MAX_PIECES] = {{NULL, 0}};
    struct gn_findings findings;
    struct entry entry;
    free(path);
    /* Its process lives, or another tells it. */
    if (index < 0 || flock(index, LOCK_EX | LOCK_NB) != 0)
        goto done;
    snprintf(remark, sizeof remark, "Left by process %ld, which ended without reading it.", process);
    pieces[0] = piece_map(folder, 0);
    const struct gn_records_teller teller = {
        .instance = instance, .remark = remark, .last = true, .launch_unsure = pieces[0].words && pieces[0].words[GN_ROOT_UNSURE]};
    gn_findings_init(&findings);
    for (uint32_t i = 0; i < MAX_ENTRIES && read(index, &entry, sizeof entry) == (ssize_t)sizeof entry; i++) {
        if (entry.piece >= MAX_PIECES)
            continue;
        if (!pieces[entry.piece].words)
            pieces[entry.piece] = piece_map(folder, entry.piece);
        entry_tell(&teller, folder, &entry, &pieces[entry.piece], &findings);
    }
    gn_report_flush(instance, &findings);
    folder_remove(folder);
done:
    for (uint32_t i = 0; i < MAX_PIECES; i++)
        if (pieces[i].words)
            munmap(pieces[i].words, pieces[i].bytes);
    if (index >= 0)
        close(index);
}

void gn_left_tell(struct gn_instance *instance)
{
    const char *base = instance->settings.records_folder;
    DIR *list = base ? opendir(base) : NULL;
    for (const struct dirent *item; list && (item = readdir(list));) {
        long process;
        if (strncmp(item->d_name, PREFIX, strlen(PREFIX)) != 0 || sscanf(item->d_name + strlen(PREFIX), "%ld", &process) != 1)
            continue;
        char *folder = join(base, item->d_name);
        if (folder)
            folder_tell(instance, folder, process);
        free(folder);
    }
    if (list)
        closedir(list);
}
