/* SPDX-License-Identifier: Apache-2.0 */
/*
 * accuracy_fuzz_models: mutated model files through the reader and its child. Every one gives a model or an error that
 * names the file and a place in it; this process neither crashes nor hangs, whatever becomes of the child.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cts/accuracy_model.h"
#include "cts/random.h"
#include "cts/results.h"

enum { MOST = 1 << 16, BASES = 7 };

struct base {
    const char *ending;
    unsigned char data[MOST];
    size_t length;
};

static void append(struct base *base, const void *data, size_t length)
{
    if (base->length + length > MOST)
        abort();
    memcpy(base->data + base->length, data, length);
    base->length += length;
}

#define PRINT(base, ...)                                                                                     \
    do {                                                                                                     \
        char text_[4096];                                                                                    \
        int length_ = snprintf(text_, sizeof text_, __VA_ARGS__);                                            \
        append(base, text_, (size_t)length_);                                                                \
    } while (0)

enum { SIDE = 4, VERTICES = SIDE * SIDE, QUADS = (SIDE - 1) * (SIDE - 1) };

static void vertex_of(uint32_t i, float out[3])
{
    out[0] = (float)(i % SIDE);
    out[1] = (float)(i / SIDE);
    out[2] = 0.1f * (float)(i * 7 % 5);
}

static void quad_of(uint32_t i, uint32_t out[4])
{
    uint32_t a = i / (SIDE - 1) * SIDE + i % (SIDE - 1);
    out[0] = a;
    out[1] = a + 1;
    out[2] = a + SIDE + 1;
    out[3] = a + SIDE;
}

static void make_obj(struct base *base)
{
    base->ending = "obj";
    PRINT(base, "# a grid\nmtllib none.mtl\no grid\n");
    for (uint32_t i = 0; i < VERTICES; i++) {
        float p[3];
        vertex_of(i, p);
        PRINT(base, "v %g %g %g\n", (double)p[0], (double)p[1], (double)p[2]);
    }
    PRINT(base, "vn 0 0 1\nvt 0.5 0.5\ng first\nusemtl none\ns 1\n");
    for (uint32_t i = 0; i < QUADS; i++) {
        uint32_t q[4];
        quad_of(i, q);
        if (i % 3 == 0)
            PRINT(base, "f %u/1/1 %u/1/1 %u/1/1 %u/1/1\n", q[0] + 1, q[1] + 1, q[2] + 1, q[3] + 1);
        else if (i % 3 == 1)
            PRINT(base, "f %u//1 %u//1 %u//1\nf -1 -2 -6\n", q[0] + 1, q[1] + 1, q[2] + 1);
        else
            PRINT(base, "f %u %u %u\ng g%u\n", q[0] + 1, q[2] + 1, q[3] + 1, i);
    }
}

static void put_swapped(struct base *base, const void *data, size_t size, bool big)
{
    unsigned char bytes[8];
    memcpy(bytes, data, size);
    for (size_t i = 0; big && i < size / 2; i++) {
        unsigned char swapped = bytes[i];
        bytes[i] = bytes[size - 1 - i];
        bytes[size - 1 - i] = swapped;
    }
    append(base, bytes, size);
}

/* 0: text, 1: little-endian, 2: big-endian. */
static void make_ply(struct base *base, int kind)
{
    static const char *const formats[3] = {"ascii", "binary_little_endian", "binary_big_endian"};
    base->ending = "ply";
    PRINT(base, "ply\nformat %s 1.0\ncomment a grid\nelement vertex %d\nproperty float x\nproperty float y\nproperty float "
                "z\nproperty uchar red\nelement face %d\nproperty list uchar int vertex_indices\nend_header\n",
          formats[kind], VERTICES, QUADS);
    for (uint32_t i = 0; i < VERTICES; i++) {
        float p[3];
        unsigned char red = 200;
        vertex_of(i, p);
        if (kind == 0) {
            PRINT(base, "%g %g %g %u\n", (double)p[0], (double)p[1], (double)p[2], red);
            continue;
        }
        for (int c = 0; c < 3; c++)
            put_swapped(base, &p[c], 4, kind == 2);
        append(base, &red, 1);
    }
    for (uint32_t i = 0; i < QUADS; i++) {
        uint32_t q[4];
        unsigned char corners = 4;
        quad_of(i, q);
        if (kind == 0) {
            PRINT(base, "4 %u %u %u %u\n", q[0], q[1], q[2], q[3]);
            continue;
        }
        append(base, &corners, 1);
        for (int c = 0; c < 4; c++)
            put_swapped(base, &q[c], 4, kind == 2);
    }
}

static size_t gltf_buffer(unsigned char out[1024])
{
    size_t length = 0;
    for (uint32_t i = 0; i < VERTICES; i++) {
        float p[3];
        vertex_of(i, p);
        memcpy(out + length, p, 12);
        length += 12;
    }
    for (uint32_t i = 0; i < QUADS; i++) {
        uint32_t q[4];
        quad_of(i, q);
        const uint16_t two[6] = {(uint16_t)q[0], (uint16_t)q[1], (uint16_t)q[2],
                                 (uint16_t)q[0], (uint16_t)q[2], (uint16_t)q[3]};
        memcpy(out + length, two, sizeof two);
        length += sizeof two;
    }
    return length;
}

static void put_gltf_text(struct base *base, const char *uri, size_t length)
{
    PRINT(base,
          "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0,2]}],\n\"nodes\":[{\"name\":\"turned\","
          "\"children\":[1],\"rotation\":[0,0,0.7071068,0.7071068]},\n{\"mesh\":0,\"translation\":[5,6,7],\"scale\":[1,-1,2]},\n"
          "{\"mesh\":0,\"matrix\":[1,0,0,0, 0,1,0,0, 0,0,1,0, 3,0,0,1]}],\n"
          "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1,\"mode\":4}]}],\n"
          "\"accessors\":[{\"bufferView\":0,\"byteOffset\":0,\"componentType\":5126,\"count\":%d,\"type\":\"VEC3\",\"min\":[0,0,"
          "0],\"max\":[3,3,0.4]},\n{\"bufferView\":1,\"componentType\":5123,\"count\":%d,\"type\":\"SCALAR\"}],\n"
          "\"bufferViews\":[{\"buffer\":0,\"byteOffset\":0,\"byteLength\":%d},\n{\"buffer\":0,\"byteOffset\":%d,"
          "\"byteLength\":%d}],\n\"buffers\":[{\"byteLength\":%zu%s%s%s}]}",
          VERTICES, QUADS * 6, VERTICES * 12, VERTICES * 12, QUADS * 12, length, uri ? ",\"uri\":\"" : "", uri ? uri : "",
          uri ? "\"" : "");
}

static void make_gltf(struct base *base)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    unsigned char data[1024];
    size_t length = gltf_buffer(data), at = 0; /* a multiple of three */
    char uri[2048];
    at = (size_t)snprintf(uri, sizeof uri, "data:application/octet-stream;base64,");
    for (size_t i = 0; i < length; i += 3) {
        unsigned word = (unsigned)data[i] << 16 | (unsigned)data[i + 1] << 8 | data[i + 2];
        for (int k = 0; k < 4; k++)
            uri[at++] = digits[word >> (18 - 6 * k) & 63];
    }
    uri[at] = 0;
    base->ending = "gltf";
    put_gltf_text(base, uri, length);
}

static void make_glb(struct base *base)
{
    unsigned char data[1024];
    size_t length = gltf_buffer(data);
    struct base json = {0};
    put_gltf_text(&json, NULL, length);
    while (json.length % 4)
        append(&json, " ", 1);
    const uint32_t head[5] = {0x46546C67, 2, (uint32_t)(12 + 8 + json.length + 8 + length), (uint32_t)json.length,
                              0x4E4F534A};
    const uint32_t chunk[2] = {(uint32_t)length, 0x004E4942};
    base->ending = "glb";
    append(base, head, sizeof head);
    append(base, json.data, json.length);
    append(base, chunk, sizeof chunk);
    append(base, data, length);
}

static void make_stl(struct base *base)
{
    base->ending = "stl";
    PRINT(base, "solid grid\n");
    for (uint32_t i = 0; i < QUADS; i++) {
        uint32_t q[4];
        quad_of(i, q);
        PRINT(base, "facet normal 0 0 1\n outer loop\n");
        for (int c = 0; c < 3; c++) {
            float p[3];
            vertex_of(q[c], p);
            PRINT(base, "  vertex %g %g %g\n", (double)p[0], (double)p[1], (double)p[2]);
        }
        PRINT(base, " endloop\nendfacet\n");
    }
    PRINT(base, "endsolid grid\n");
}

static bool is_digit(unsigned char c)
{
    return (c >= '0' && c <= '9') || c == '-' || c == '.';
}

/* One change: bytes, a number, a part cut out, doubled, moved, or the end lost. */
static void mutate(struct gn_random *random, struct base *base)
{
    static const char *const numbers[] = {"nan", "-1", "0", "4294967295", "-2147483648", "1e39", "1e-50", "inf", "99999999999",
                                          "1e400", "65536", "0x10", "1.5", "", "--1", "18446744073709551615", "3"};
    static const char *const words[] = {"f 1 2 3\n", "v nan 0 0\n", "\n", "\\\n", "{", "}", "[", "\"", ",", "element vertex 5\n",
                                        "property list uchar int x\n", "end_header\n", "end\n", "\0\0\0\0", "f 0 0 0\n",
                                        "\"children\":[0]", "\"matrix\":[1]", "call x.obj\n", "data:,"};
    size_t at = gn_random_below(random, (uint32_t)base->length), length, end;
    const char *text;
    switch (gn_random_below(random, 9)) {
    case 0:
        base->data[at] ^= (unsigned char)(1u << gn_random_below(random, 8));
        break;
    case 1:
        base->data[at] = (unsigned char)gn_random_below(random, 256);
        break;
    case 2: /* another number */
        for (size_t i = 0; i < base->length && !is_digit(base->data[at]); i++)
            at = (at + 1) % base->length;
        end = at;
        while (end < base->length && is_digit(base->data[end]))
            end++;
        while (at > 0 && is_digit(base->data[at - 1]))
            at--;
        text = numbers[gn_random_below(random, sizeof numbers / sizeof numbers[0])];
        length = strlen(text);
        if (base->length - (end - at) + length > MOST)
            return;
        memmove(base->data + at + length, base->data + end, base->length - end);
        memcpy(base->data + at, text, length);
        base->length += length - (end - at);
        break;
    case 3: /* a part cut out */
        length = 1 + gn_random_below(random, 64);
        if (at + length >= base->length)
            return;
        memmove(base->data + at, base->data + at + length, base->length - at - length);
        base->length -= length;
        break;
    case 4: /* a part doubled */
        length = 1 + gn_random_below(random, 256);
        if (at + length > base->length || base->length + length > MOST)
            return;
        memmove(base->data + at + length, base->data + at, base->length - at);
        base->length += length;
        break;
    case 5:
        if (at)
            base->length = at;
        break;
    case 6: /* a word put in */
        text = words[gn_random_below(random, sizeof words / sizeof words[0])];
        length = strlen(text);
        if (base->length + length > MOST)
            return;
        memmove(base->data + at + length, base->data + at, base->length - at);
        memcpy(base->data + at, text, length);
        base->length += length;
        break;
    case 7: { /* four bytes of an extreme number */
        static const uint32_t extremes[] = {0, UINT32_MAX, 0x80000000u, 0x7F800000u, 0x7FC00000u, 0x7FFFFFFFu, 0x10000, 1};
        if (at + 4 <= base->length)
            memcpy(base->data + at, &extremes[gn_random_below(random, 8)], 4);
        break;
    }
    default: { /* two parts change places */
        size_t other = gn_random_below(random, (uint32_t)base->length);
        for (size_t i = 0; i < 16 && at + i < base->length && other + i < base->length; i++) {
            unsigned char byte = base->data[at + i];
            base->data[at + i] = base->data[other + i];
            base->data[other + i] = byte;
        }
    }
    }
}

/* A place: where in the file, or at what of it. */
static bool names_place(const char *error)
{
    static const char *const places[] = {"line ", "byte ", "mesh ", "vertex ", "face ", "node ", "triangle", "header",
                                         "accessor", "buffer", "in its ", "while "};
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++)
        if (strstr(error, places[i]))
            return true;
    return false;
}

struct tally {
    uint64_t files, models, errors, child_crashed, child_gave_up, hung, unnamed, unplaced;
};

static void read_one(const char *folder, const struct base *base, struct tally *tally, bool verbose)
{
    char path[512], error[2048] = "";
    struct gn_arena arena = {0};
    struct gn_model model;
    snprintf(path, sizeof path, "%s/m.%s", folder, base->ending);
    if (!gn_file_write(path, base->data, base->length, error, sizeof error)) {
        fprintf(stderr, "%s\n", error);
        exit(3);
    }
    tally->files++;
    if (gn_model_read(path, 20, &arena, &model, error, sizeof error)) {
        tally->models++;
        /* What is given is whole: every index and coordinate is looked at. */
        double sum = 0;
        for (uint32_t m = 0; m < model.mesh_count; m++)
            for (uint32_t t = 0; t < model.meshes[m].triangle_count; t++)
                for (int k = 0; k < 3; k++)
                    sum += model.meshes[m].positions[model.meshes[m].triangles[t][k]][k];
        for (uint32_t i = 0; i < model.instance_count; i++)
            sum += (double)model.instances[i].transform[0] + model.meshes[model.instances[i].mesh].position_count;
        if (sum != sum)
            abort();
    } else {
        tally->errors++;
        tally->child_crashed += strstr(error, "crashed") != NULL;
        tally->child_gave_up += strstr(error, "gave up") != NULL;
        tally->hung += strstr(error, "not read within") != NULL;
        bool named = strstr(error, path) != NULL, placed = names_place(error);
        tally->unnamed += !named;
        tally->unplaced += !placed;
        if (verbose || !named || !placed)
            printf("%s%s\n", named && placed ? "" : "NO FILE OR PLACE: ", error);
    }
    gn_arena_finish(&arena);
}

int main(int argc, char **argv)
{
    uint64_t count = 300, seed = 1;
    bool verbose = false;
    char folder[] = "/tmp/gnomon-fuzz-XXXXXX", command[256];
    static struct base bases[BASES];
    struct tally tally = {0};
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--verbose") == 0) {
            verbose = true;
        } else if (i + 1 < argc && strcmp(argv[i], "--count") == 0) {
            count = strtoull(argv[++i], NULL, 0);
        } else if (i + 1 < argc && strcmp(argv[i], "--seed") == 0) {
            seed = strtoull(argv[++i], NULL, 0);
        } else {
            fprintf(stderr, "usage: accuracy_fuzz_models [--count N] [--seed S] [--verbose]\n");
            return 2;
        }
    }
    if (!mkdtemp(folder))
        return 3;
    make_obj(&bases[0]);
    for (int kind = 0; kind < 3; kind++)
        make_ply(&bases[1 + kind], kind);
    make_gltf(&bases[4]);
    make_glb(&bases[5]);
    make_stl(&bases[6]);
    for (int b = 0; b < BASES; b++)
        read_one(folder, &bases[b], &tally, verbose);
    if (tally.models != BASES) {
        printf("a file that is not mutated is refused\n");
        return 1;
    }
    tally = (struct tally){0};
    for (uint64_t i = 0; i < count; i++) {
        struct gn_random random = {seed * 0x9E3779B97F4A7C15u + i};
        static struct base mutated;
        mutated = bases[i % BASES];
        uint32_t changes = 1 + gn_random_below(&random, i % 5 == 0 ? 12 : 2);
        for (uint32_t k = 0; k < changes; k++)
            mutate(&random, &mutated);
        read_one(folder, &mutated, &tally, verbose);
    }
    printf("%llu files: %llu models, %llu errors; the child crashed on %llu, gave up on %llu, was too slow on %llu; %llu errors "
           "without the file's name, %llu without a place\n",
           (unsigned long long)tally.files, (unsigned long long)tally.models, (unsigned long long)tally.errors,
           (unsigned long long)tally.child_crashed, (unsigned long long)tally.child_gave_up,
           (unsigned long long)tally.hung, (unsigned long long)tally.unnamed, (unsigned long long)tally.unplaced);
    snprintf(command, sizeof command, "rm -rf -- '%s'", folder);
    if (system(command) != 0)
        return 3;
    return tally.unnamed || tally.unplaced || !tally.models || !tally.errors ? 1 : 0;
}
