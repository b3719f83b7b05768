/* SPDX-License-Identifier: Apache-2.0 */
/* Drivers by name: where their manifests lie, and how to start this program with libraries of theirs. */
#include "cts/driver.h"

#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <yyjson.h>

#include "cts/results.h"

/* Whether a file is what the loader takes for a driver; the loader's own message would come late and be
 * unclear. */
static bool check_icd(const char *path, char *out_error, size_t error_size)
{
    char *data = NULL;
    size_t length = 0;
    if (!gn_file_read(path, 1 << 20, &data, &length, out_error, error_size))
        return false;
    yyjson_doc *doc = yyjson_read(data, length, YYJSON_READ_NOFLAG);
    yyjson_val *icd = yyjson_obj_get(yyjson_doc_get_root(doc), "ICD");
    bool ok = yyjson_is_str(yyjson_obj_get(icd, "library_path"));
    if (!ok)
        snprintf(out_error, error_size,
                 "%s is not a Vulkan driver's ICD file: expected JSON with \"ICD\": {\"library_path\": ...}",
                 path);
    yyjson_doc_free(doc);
    free(data);
    return ok;
}

/* The first file that matches the pattern, or NULL. */
static const char *first_match(const char *pattern, struct gn_arena *arena)
{
    glob_t found;
    if (glob(pattern, 0, NULL, &found) != 0)
        return NULL;
    const char *path = gn_arena_printf(arena, "%s", found.gl_pathv[0]);
    globfree(&found);
    return path;
}

static const char *find_lavapipe(struct gn_arena *arena, char *out_error, size_t error_size)
{
    static const char *const places[] = {"/usr/share/vulkan/icd.d/lvp_icd*.json",
                                         "/etc/vulkan/icd.d/lvp_icd*.json",
                                         "/usr/local/share/vulkan/icd.d/lvp_icd*.json"};
    const char *given = getenv("GNOMON_LAVAPIPE_ICD");
    if (given && *given)
        return check_icd(given, out_error, error_size) ? gn_arena_printf(arena, "%s", given) : NULL;
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        const char *path = first_match(places[i], arena);
        if (path)
            return check_icd(path, out_error, error_size) ? path : NULL;
    }
    snprintf(out_error, error_size,
             "the driver lavapipe was not found: expected GNOMON_LAVAPIPE_ICD or a file %s; Debian and "
             "Ubuntu have "
             "it in the package mesa-vulkan-drivers",
             places[0]);
    return NULL;
}

const char *gn_driver_resolve(const char *name, struct gn_arena *arena, char *out_error, size_t error_size)
{
    if (!name && getenv("GNOMON_ANY_DRIVER"))
        return "";
    if (!name) {
        const char *files = getenv("VK_DRIVER_FILES"), *old = getenv("VK_ICD_FILENAMES");
        return (files && *files) || (old && *old) ? "" : find_lavapipe(arena, out_error, error_size);
    }
    if (strcmp(name, "lavapipe") == 0)
        return find_lavapipe(arena, out_error, error_size);
    size_t length = strlen(name);
    bool is_path = strchr(name, '/') || (length > 5 && strcmp(name + length - 5, ".json") == 0);
    if (!is_path) {
        const char *folder = getenv("GNOMON_DRIVERS");
        const char *path =
            folder && *name != '.'
                ? first_match(gn_arena_printf(arena, "%s/%s/icd.d/lvp_icd*.json", folder, name), arena)
                : NULL;
        if (path)
            return check_icd(path, out_error, error_size) ? path : NULL;
        snprintf(out_error, error_size,
                 "no driver is named '%s': expected lavapipe, a name that `gnomon driver list` shows, or the path of "
                 "a driver's ICD file (.json)",
                 name);
        return NULL;
    }
    if (!check_icd(name, out_error, error_size))
        return NULL;
    /* The loader takes a relative path from where the worker runs; that is here, but say it in full in
     * reports. */
    char *full = realpath(name, NULL);
    const char *path = gn_arena_printf(arena, "%s", full ? full : name);
    free(full);
    return path;
}

struct gn_driver_loader gn_driver_loader(const char *icd, struct gn_arena *arena)
{
    struct gn_driver_loader none = {NULL, NULL};
    const char *folder = getenv("GNOMON_DRIVERS"), *own = getenv("LD_LIBRARY_PATH");
    size_t length = folder ? strlen(folder) : 0;
    if (!length || strncmp(icd, folder, length) != 0 || icd[length] != '/')
        return none;
    int name = (int)strcspn(icd + length + 1, "/");
    const char *loader = first_match(
        gn_arena_printf(arena, "%s/%.*s/root/usr/lib/*-linux-gnu/ld-linux*.so*", folder, name, icd + length + 1), arena);
    if (!loader)
        return none;
    int libraries = (int)(strrchr(loader, '/') - loader);
    return (struct gn_driver_loader){
        loader, gn_arena_printf(arena, "%.*s%s%s", libraries, loader, own && *own ? ":" : "", own ? own : "")};
}
