/* SPDX-License-Identifier: Apache-2.0 */
/* Instrumented shaders on disk, a file each, named by what it was made of: the original words, the options, the version and the address of
 * the records. A file is written beside its place and moved there, so that other processes see all of it or nothing; one whose
 * checksum is wrong counts as missing. */
#include "layer/shader.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

/* Larger files are no results. */
#define MAX_BYTES ((off_t)1 << 30)

static char *path_of(const char *folder, uint64_t entry)
{
    char *path = NULL;
    return asprintf(&path, "%s/gnomon-shader-%016llx", folder, (unsigned long long)entry) < 0 ? NULL : path;
}

static bool read_all(int file, unsigned char *data, size_t size)
{
    while (size) {
        ssize_t got = read(file, data, size);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return false;
        data += got;
        size -= (size_t)got;
    }
    return true;
}

bool gn_shader_cache_usable(const char *folder, char *problem, size_t problem_size)
{
    struct stat about;
    int failure = mkdir(folder, 0777) != 0 && errno != EEXIST       ? errno
                  : stat(folder, &about) != 0                       ? errno
                  : !S_ISDIR(about.st_mode)                         ? ENOTDIR
                  : access(folder, R_OK | W_OK | X_OK) != 0         ? errno
                                                                    : 0;
    if (failure)
        snprintf(problem, problem_size, "shader_cache: cannot keep files in \"%s\": %s. Every run instruments shaders anew.", folder,
                 strerror(failure));
    return !failure;
}

bool gn_shader_cache_load(const char *folder, uint64_t entry, struct gn_spirv_result *out)
{
    char *path = path_of(folder, entry);
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    unsigned char *data = NULL;
    uint64_t sum;
    struct stat about;
    bool good = false;
    if (file < 0 || fstat(file, &about) != 0 || about.st_size <= (off_t)sizeof sum || about.st_size > MAX_BYTES)
        goto done;
    size_t size = (size_t)about.st_size;
    if (!(data = malloc(size)) || !read_all(file, data, size))
        goto done;
    memcpy(&sum, data + size - sizeof sum, sizeof sum);
    good = XXH3_64bits_withSeed(data, size - sizeof sum, entry) == sum && gn_spirv_result_read(data, size - sizeof sum, out);
done:
    free(data);
    if (file >= 0)
        close(file);
    free(path);
    return good;
}

static bool write_all(int file, const void *data, size_t size)
{
    const unsigned char *at = data;
    while (size) {
        ssize_t put = write(file, at, size);
        if (put < 0 && errno == EINTR)
            continue;
        if (put <= 0)
            return false;
        at += put;
        size -= (size_t)put;
    }
    return true;
}

void gn_shader_cache_store(const char *folder, uint64_t entry, const struct gn_spirv_result *result)
{
    size_t size;
    unsigned char *data = gn_spirv_result_write(result, &size);
    char *path = data ? path_of(folder, entry) : NULL, *beside = NULL;
    if (!path || asprintf(&beside, "%s.XXXXXX", path) < 0) {
        beside = NULL;
        goto done;
    }
    int file = mkostemp(beside, O_CLOEXEC);
    if (file < 0)
        goto done;
    uint64_t sum = XXH3_64bits_withSeed(data, size, entry);
    bool good = write_all(file, data, size) && write_all(file, &sum, sizeof sum);
    good &= close(file) == 0;
    if (!good || rename(beside, path) != 0)
        unlink(beside);
done:
    free(beside);
    free(path);
    free(data);
}
