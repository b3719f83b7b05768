/* SPDX-License-Identifier: Apache-2.0 */
/* The child that reads a model with Assimp. It may crash or be killed at any point: the parent knows. */
#include "cts/accuracy_model.h"

#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

/* Nodes may be nested without end, and may be their own ancestors where a library is careless. */
#define DEEPEST 512

struct child {
    int fd;
    const char *data; /* the file's */
    size_t length;
    char *stage;
    size_t stage_size;
    const struct aiScene *scene;
    uint32_t *mesh_numbers; /* what each of the scene's meshes is called, UINT32_MAX: it has no triangles */
    struct gn_model_instance *instances;
    size_t instance_count, instance_capacity;
};

static void put(const struct child *child, const void *data, size_t size)
{
    const char *at = data;
    while (size) {
        ssize_t n = write(child->fd, at, size);
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            _exit(3);
        at += n;
        size -= (size_t)n;
    }
}

__attribute__((format(printf, 2, 3))) _Noreturn static void fail(const struct child *child,
                                                                 const char *format, ...)
{
    char text[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    struct gn_model_header header = {GN_MODEL_MAGIC, (uint32_t)strlen(text), 0, 0};
    put(child, &header, sizeof header);
    put(child, text, header.error_length);
    _exit(2);
}

_Noreturn static void fail_located(const struct child *child, const char *message)
{
    char text[1000];
    gn_model_locate(message, child->data, child->length, text, sizeof text);
    fail(child, "%s", text);
}

__attribute__((format(printf, 2, 3))) static void at(const struct child *child, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(child->stage, child->stage_size, format, arguments);
    va_end(arguments);
}

static void check_text(struct child *child, const char *path)
{
    char error[512];
    struct stat info;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0 || fstat(fd, &info) != 0 || info.st_size <= 0)
        fail(child, "%s", fd < 0 ? strerror(errno) : "the file is empty");
    char *data = mmap(NULL, (size_t)info.st_size, PROT_READ, MAP_PRIVATE, fd, 0);
    if (data == MAP_FAILED)
        fail(child, "%s", strerror(errno));
    if (!gn_model_check(path, data, (size_t)info.st_size, error, sizeof error))
        fail(child, "%s", error);
    child->data = data;
    child->length = (size_t)info.st_size;
    close(fd);
}

/* The library's functions, looked up by name: a program that reads no model does not load it. */
struct library {
    const struct aiScene *(*import)(const char *path, unsigned flags);
    const struct aiScene *(*process)(const struct aiScene *scene, unsigned flags);
    const char *(*error)(void);
};

static struct library load_library(const struct child *child)
{
    void *handle = dlopen(GNOMON_ASSIMP, RTLD_NOW | RTLD_LOCAL);
    if (!handle)
        fail(child, "models are read by %s, which is not installed here: %s", GNOMON_ASSIMP, dlerror());
    struct library library;
    void *import = dlsym(handle, "aiImportFile"), *process = dlsym(handle, "aiApplyPostProcessing");
    void *error = dlsym(handle, "aiGetErrorString");
    if (!import || !process || !error)
        fail(child, "%s lacks a function", GNOMON_ASSIMP);
    memcpy(&library.import, &import, sizeof import);
    memcpy(&library.process, &process, sizeof process);
    memcpy(&library.error, &error, sizeof error);
    return library;
}

/* Before anything works on the faces: the library's own steps take their indices for granted. */
static void check_mesh(const struct child *child, uint32_t number)
{
    const struct aiMesh *mesh = child->scene->mMeshes[number];
    if (!mesh || (mesh->mNumVertices && !mesh->mVertices) || (mesh->mNumFaces && !mesh->mFaces))
        fail(child, "mesh %u has no data", number);
    for (uint32_t i = 0; i < mesh->mNumVertices; i++) {
        struct aiVector3D v = mesh->mVertices[i];
        if (!isfinite(v.x) || !isfinite(v.y) || !isfinite(v.z))
            fail(child, "mesh %u, vertex %u: expected finite coordinates, found (%g, %g, %g)", number, i,
                 (double)v.x, (double)v.y, (double)v.z);
    }
    for (uint32_t i = 0; i < mesh->mNumFaces; i++) {
        const struct aiFace *face = &mesh->mFaces[i];
        if (face->mNumIndices && !face->mIndices)
            fail(child, "mesh %u, face %u has no data", number, i);
        for (uint32_t k = 0; k < face->mNumIndices; k++)
            if (face->mIndices[k] >= mesh->mNumVertices)
                fail(child, "mesh %u, face %u: expected an index below %u, found %u", number, i,
                     mesh->mNumVertices, face->mIndices[k]);
    }
}

static uint64_t hash_of(const float *v)
{
    uint32_t bits[3];
    memcpy(bits, v, sizeof bits);
    uint64_t h = bits[0] * UINT64_C(0x9E3779B97F4A7C15);
    h = (h ^ (h >> 29) ^ bits[1]) * UINT64_C(0xBF58476D1CE4E5B9);
    h = (h ^ (h >> 32) ^ bits[2]) * UINT64_C(0x94D049BB133111EB);
    return h ^ (h >> 31);
}

/* Triangles whose corners are shared where the positions are bit for bit the same: formats that split
 * vertices by normal or texture would otherwise hide which edges are shared. */
static void put_mesh(const struct child *child, const struct aiMesh *mesh, uint32_t triangle_count)
{
    size_t slots = 16;
    while (slots < (size_t)mesh->mNumVertices * 2)
        slots *= 2;
    uint32_t *table = malloc(slots * sizeof *table),
             *names = malloc(((size_t)mesh->mNumVertices + 1) * sizeof *names);
    float(*positions)[3] = malloc(((size_t)mesh->mNumVertices + 1) * sizeof *positions);
    uint32_t(*triangles)[3] = malloc(triangle_count * sizeof *triangles);
    if (!table || !names || !positions || !triangles)
        fail(child, "a mesh of %u vertices and %u triangles exceeds the memory a model may take",
             mesh->mNumVertices, triangle_count);
    memset(table, 0xFF, slots * sizeof *table);
    memset(names, 0xFF, ((size_t)mesh->mNumVertices + 1) * sizeof *names);
    uint32_t position_count = 0, filled = 0;
    for (uint32_t i = 0; i < mesh->mNumFaces; i++) {
        if (mesh->mFaces[i].mNumIndices != 3)
            continue;
        for (int k = 0; k < 3; k++) {
            uint32_t index = mesh->mFaces[i].mIndices[k];
            if (names[index] == UINT32_MAX) {
                float v[3] = {mesh->mVertices[index].x, mesh->mVertices[index].y, mesh->mVertices[index].z};
                size_t slot = hash_of(v) & (slots - 1);
                while (table[slot] != UINT32_MAX && memcmp(positions[table[slot]], v, sizeof v) != 0)
                    slot = (slot + 1) & (slots - 1);
                if (table[slot] == UINT32_MAX) {
                    memcpy(positions[position_count], v, sizeof v);
                    table[slot] = position_count++;
                }
                names[index] = table[slot];
            }
            triangles[filled][k] = names[index];
        }
        filled++;
    }
    struct gn_model_mesh sizes = {position_count, filled};
    put(child, &sizes, sizeof sizes);
    put(child, positions, position_count * sizeof *positions);
    put(child, triangles, filled * sizeof *triangles);
    free(table);
    free(names);
    free(positions);
    free(triangles);
}

static void multiply(const double a[12], const struct aiMatrix4x4 *m, double out[12])
{
    const float *b = &m->a1;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            out[4 * r + c] = a[4 * r] * (double)b[c] + a[4 * r + 1] * (double)b[4 + c] +
                             a[4 * r + 2] * (double)b[8 + c] + (c == 3 ? a[4 * r + 3] : 0);
}

static void add_instance(struct child *child, const struct aiNode *node, const double world[12],
                         uint32_t mesh)
{
    if (child->instance_count == child->instance_capacity) {
        size_t capacity = child->instance_capacity ? 2 * child->instance_capacity : 64;
        struct gn_model_instance *grown =
            capacity <= GN_MODEL_MOST_INSTANCES ? realloc(child->instances, capacity * sizeof *grown) : NULL;
        if (!grown)
            fail(child, "more than %zu instances", child->instance_count);
        child->instances = grown;
        child->instance_capacity = capacity;
    }
    struct gn_model_instance *instance = &child->instances[child->instance_count++];
    instance->mesh = mesh;
    for (int k = 0; k < 12; k++) {
        instance->transform[k] = (float)world[k];
        if (!isfinite(instance->transform[k]))
            fail(child, "node '%.64s': its transform is not finite", node->mName.data);
    }
    const double *m = world;
    double cofactor[3] = {m[5] * m[10] - m[6] * m[9], m[6] * m[8] - m[4] * m[10], m[4] * m[9] - m[5] * m[8]};
    if (m[0] * cofactor[0] + m[1] * cofactor[1] + m[2] * cofactor[2] == 0)
        fail(child, "node '%.64s': its transform is singular (its meshes are flattened to nothing)",
             node->mName.data);
}

static void walk(struct child *child, const struct aiNode *node, const double parent[12], int depth)
{
    double world[12];
    if (!node || depth > DEEPEST)
        fail(child, "%s", node ? "nodes are nested too deeply" : "a node is missing");
    multiply(parent, &node->mTransformation, world);
    for (uint32_t i = 0; i < node->mNumMeshes; i++) {
        if (node->mMeshes[i] >= child->scene->mNumMeshes)
            fail(child, "node '%.64s': expected a mesh below %u, found %u", node->mName.data,
                 child->scene->mNumMeshes, node->mMeshes[i]);
        uint32_t mesh = child->mesh_numbers[node->mMeshes[i]];
        if (mesh != UINT32_MAX)
            add_instance(child, node, world, mesh);
    }
    for (uint32_t i = 0; i < node->mNumChildren; i++)
        walk(child, node->mChildren[i], world, depth + 1);
}

_Noreturn void gn_model_child(const char *path, int fd, char *stage, size_t stage_size)
{
    struct child child = {.fd = fd, .stage = stage, .stage_size = stage_size};
    at(&child, "checking its text");
    check_text(&child, path);
    at(&child, "loading the library that reads it");
    struct library library = load_library(&child);
    at(&child, "the library was reading it");
    child.scene = library.import(path, 0);
    if (!child.scene)
        fail_located(&child, library.error());
    if (!child.scene->mRootNode || !child.scene->mNumMeshes || !child.scene->mMeshes)
        fail_located(&child, "it has no mesh");
    at(&child, "checking %u meshes", child.scene->mNumMeshes);
    for (uint32_t i = 0; i < child.scene->mNumMeshes; i++)
        check_mesh(&child, i);
    at(&child, "the library was cutting polygons into triangles");
    child.scene = library.process(child.scene, aiProcess_Triangulate);
    if (!child.scene)
        fail(&child, "polygons cannot be cut into triangles: %.800s", library.error());
    at(&child, "checking the triangles");
    child.mesh_numbers = malloc(child.scene->mNumMeshes * sizeof *child.mesh_numbers);
    uint32_t *counts = calloc(child.scene->mNumMeshes, sizeof *counts);
    if (!child.mesh_numbers || !counts)
        fail(&child, "too many meshes: %u", child.scene->mNumMeshes);
    uint32_t mesh_count = 0;
    uint64_t triangles = 0;
    for (uint32_t i = 0; i < child.scene->mNumMeshes; i++) {
        check_mesh(&child, i);
        for (uint32_t f = 0; f < child.scene->mMeshes[i]->mNumFaces; f++)
            counts[i] += child.scene->mMeshes[i]->mFaces[f].mNumIndices == 3;
        triangles += counts[i];
        child.mesh_numbers[i] = counts[i] ? mesh_count++ : UINT32_MAX;
    }
    if (!triangles)
        fail(&child, "it has no triangle");
    if (triangles > GN_MODEL_MOST_TRIANGLES)
        fail(&child, "%llu triangles, but at most %llu are read", (unsigned long long)triangles,
             (unsigned long long)GN_MODEL_MOST_TRIANGLES);
    at(&child, "placing the meshes");
    walk(&child, child.scene->mRootNode, (const double[12]){1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, 0);
    if (!child.instance_count)
        fail(&child, "no node shows any of its meshes");
    at(&child, "handing over the triangles");
    struct gn_model_header header = {GN_MODEL_MAGIC, 0, mesh_count, (uint32_t)child.instance_count};
    put(&child, &header, sizeof header);
    for (uint32_t i = 0; i < child.scene->mNumMeshes; i++)
        if (counts[i])
            put_mesh(&child, child.scene->mMeshes[i], counts[i]);
    put(&child, child.instances, child.instance_count * sizeof *child.instances);
    _exit(0);
}
