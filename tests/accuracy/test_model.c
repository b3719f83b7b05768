/* SPDX-License-Identifier: Apache-2.0 */
/* Model files: valid ones are read as they are, malformed ones give an error with file and place, never a
 * crash. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cts/accuracy_model.h"
#include "cts/progress.h"
#include "cts/results.h"

static char folder[] = "/tmp/gnomon-model-XXXXXX";

static const char *write_file(const char *name, const void *data, size_t length)
{
    static char path[256];
    char error[256];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    if (!gn_file_write(path, data, length, error, sizeof error))
        fail_msg("%s", error);
    return path;
}

/* A square of two triangles that share an edge, with a height that has no short decimal. */
static const char obj[] = "# a square\nv 0 0 0\nv 1 0 0\nv 1 1 0.1\nv 0 1 0\n\nf 1 2 3\nf 1 3 4\n";
static const char ply[] =
    "ply\nformat ascii 1.0\ncomment a square\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n1 1 0.1\n0 1 0\n3 0 1 2\n3 0 2 3\n";

/* The square once more, binary, and with two nodes that show it: one moved, one mirrored. */
static size_t make_gltf(char *out, size_t size, const char *second_scale, const char *indices_count)
{
    static const float positions[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0.1f, 0, 1, 0};
    static const uint16_t indices[6] = {0, 1, 2, 0, 2, 3};
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    unsigned char data[60];
    char base64[81];
    memcpy(data, positions, 48);
    memcpy(data + 48, indices, 12);
    for (int i = 0; i < 20; i++) {
        unsigned word = (unsigned)data[3 * i] << 16 | (unsigned)data[3 * i + 1] << 8 | data[3 * i + 2];
        for (int k = 0; k < 4; k++)
            base64[4 * i + k] = digits[word >> (18 - 6 * k) & 63];
    }
    base64[80] = 0;
    return (size_t)snprintf(
        out, size,
        "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0,1]}],\n"
        "\"nodes\":[{\"name\":\"moved\",\"mesh\":0,\"translation\":[5,6,7]},{\"name\":\"flat\",\"mesh\":0,"
        "\"scale\":[%s]}],\n"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}],\n"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\",\"min\":[0,0,"
        "0],\"max\":"
        "[1,1,0.1]},{\"bufferView\":1,\"componentType\":5123,\"count\":%s,\"type\":\"SCALAR\"}],\n"
        "\"bufferViews\":[{\"buffer\":0,\"byteOffset\":0,\"byteLength\":48},{\"buffer\":0,\"byteOffset\":48,"
        "\"byteLength\":12}],\n\"buffers\":[{\"byteLength\":60,\"uri\":\"data:application/"
        "octet-stream;base64,%s\"}]}\n",
        second_scale, indices_count, base64);
}

static size_t make_binary_ply(char out[1024])
{
    static const float positions[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0.1f, 0, 1, 0};
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    size_t length = (size_t)snprintf(
        out, 1024,
        "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n");
    memcpy(out + length, positions, sizeof positions);
    length += sizeof positions;
    for (int i = 0; i < 2; i++) {
        out[length] = 3;
        memcpy(out + length + 1, indices + 3 * i, 12);
        length += 13;
    }
    return length;
}

static void valid_files_are_read_as_they_are(void **state)
{
    (void)state;
    char gltf[4096], error[1024];
    char binary[1024];
    size_t gltf_length = make_gltf(gltf, sizeof gltf, "-1,1,1", "6"), binary_length = make_binary_ply(binary);
    const struct {
        const char *name, *data;
        size_t length;
        uint32_t instances;
    } rows[] = {{"square.obj", obj, sizeof obj - 1, 1},
                {"SQUARE.PLY", ply, sizeof ply - 1, 1},
                {"binary.ply", binary, binary_length, 1},
                {"square.gltf", gltf, gltf_length, 2}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_arena arena = {0};
        struct gn_model model;
        if (!gn_model_read(write_file(rows[i].name, rows[i].data, rows[i].length), 0, &arena, &model, error,
                           sizeof error))
            fail_msg("%s", error);
        assert_int_equal(model.mesh_count, 1);
        assert_int_equal(model.instance_count, rows[i].instances);
        assert_int_equal(model.meshes[0].triangle_count, 2);
        /* Shared vertices are one, whatever the format or its reader made of them. */
        assert_int_equal(model.meshes[0].position_count, 4);
        double highest = 0;
        for (int v = 0; v < 4; v++)
            highest = fmax(highest, model.meshes[0].positions[v][2]);
        assert_true(highest == (double)0.1f);
        if (rows[i].instances == 2) {
            assert_true(model.instances[0].transform[3] == 5 && model.instances[0].transform[7] == 6 &&
                        model.instances[0].transform[11] == 7);
            assert_true(model.instances[1].transform[0] == -1 && model.instances[1].transform[5] == 1);
        }
        gn_arena_finish(&arena);
    }
}

static void polygons_become_triangles(void **state)
{
    (void)state;
    static const char text[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nl 1 2\np 3\n";
    struct gn_arena arena = {0};
    struct gn_model model;
    char error[1024];
    if (!gn_model_read(write_file("quad.obj", text, sizeof text - 1), 0, &arena, &model, error, sizeof error))
        fail_msg("%s", error);
    assert_int_equal(model.mesh_count, 1);
    assert_int_equal(model.meshes[0].triangle_count, 2);
    gn_arena_finish(&arena);
}

#define PLY_HEAD(vertices, faces)                                                                            \
    "ply\nformat ascii 1.0\nelement vertex " vertices                                                        \
    "\nproperty float x\nproperty float y\nproperty float z\n"                                               \
    "element face " faces "\nproperty list uchar int vertex_indices\nend_header\n"

static void malformed_files_are_told_with_their_place(void **state)
{
    (void)state;
    char singular[4096], beyond[4096];
    make_gltf(singular, sizeof singular, "0,1,1", "6");
    make_gltf(beyond, sizeof beyond, "1,1,1", "4000000000");
    const struct {
        const char *what, *name, *data, *expected; /* after the file's name */
    } rows[] = {
        {"nan in OBJ", "a.obj", "v 0 0 0\nv 1 nan 0\nv 1 1 0\nf 1 2 3\n", "line 2: expected finite numbers"},
        {"inf in OBJ", "a.obj", "v 0 0 0\nv 1 0 0\nv 1 -inf 0\nf 1 2 3\n", "line 3: expected finite numbers"},
        {"beyond f32 in OBJ", "a.obj", "v 0 0 0\nv 1e39 0 0\nv 1 1 0\nf 1 2 3\n",
         "line 2: expected finite numbers"},
        {"two coordinates", "a.obj", "v 0 0 0\nv 1 0\nv 1 1 0\nf 1 2 3\n", "line 2: expected 3 numbers"},
        {"an index too large", "a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 4\n",
         "line 4: the face names vertex 4"},
        {"index 0", "a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 0 1 2\n", "line 4: the face names vertex 0"},
        {"an index too negative", "a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -1 -2 -4\n",
         "line 4: the face names vertex -4"},
        {"a word as index", "a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf one 2 3\n", "line 4: expected the number"},
        {"points only", "a.obj", "v 0 0 0\nv 1 0 0\n", ""},
        {"no PLY", "a.ply", "plx\n", "line 1: expected 'ply'"},
        {"header without end", "a.ply", "ply\nformat ascii 1.0\nelement vertex 3\n",
         "line 4: expected 'end_header'"},
        {"a huge count", "a.ply", PLY_HEAD("4294967295", "1") "0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n",
         "line 3: 4294967295 elements"},
        {"a count beyond 64 bits", "a.ply", PLY_HEAD("99999999999999999999999", "1") "0 0 0\n", "line 3: "},
        {"a negative count", "a.ply", PLY_HEAD("-1", "1") "0 0 0\n", "line 3: expected 'element NAME COUNT'"},
        {"an index out of range in PLY", "a.ply", PLY_HEAD("3", "1") "0 0 0\n1 0 0\n1 1 0\n3 0 1 7\n", ""},
        {"nan in PLY", "a.ply", PLY_HEAD("3", "1") "0 0 0\nnan 0 0\n1 1 0\n3 0 1 2\n", ""},
        {"an unknown type", "a.ply",
         "ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\nend_header\n0\n",
         "line 4: expected a property"},
        {"no JSON", "a.gltf", "{\"asset\":\n{,}}", "line 2 (byte 11): its JSON is not well-formed"},
        {"no object", "a.gltf", "[]", "byte 0: expected a JSON object"},
        {"an empty object", "a.gltf", "{}", ""},
        {"a singular node", "a.gltf", singular, "node 'flat': its transform is singular"},
        {"more indices than the buffer has", "a.gltf", beyond, ""},
        {"no binary glTF", "a.glb", "glTF", "byte 0: expected the header"},
        {"no STL", "a.stl", "solid\nfacet normal 0 0", ""},
        {"a torn header", "a.stl", "STL", "byte 0: expected 'solid' or a header"},
        {"a torn STL", "a.stl",
         "01234567890123456789012345678901234567890123456789012345678901234567890123456789aaaabbbb",
         "byte 80: 1633771873 triangles of 50 bytes, but 4 bytes follow"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct gn_arena arena = {0};
        struct gn_model model;
        char error[1024] = "", expected[512];
        const char *path = write_file(rows[i].name, rows[i].data, strlen(rows[i].data));
        bool ok = gn_model_read(path, 20, &arena, &model, error, sizeof error);
        snprintf(expected, sizeof expected, "%s: %s", path, rows[i].expected);
        if (ok || strncmp(error, expected, strlen(expected)) != 0 || strlen(error) <= strlen(path) + 2)
            fail_msg("%s: expected '%s...', found %s '%s'", rows[i].what, expected, ok ? "a model" : "",
                     error);
        gn_arena_finish(&arena);
    }
}

/* A chain of nodes that is valid, and deeper than the library's recursion. */
static void a_file_that_the_reader_dies_of_is_not_called_malformed(void **state)
{
    (void)state;
    enum { NODES = 20000 };
    char *text = malloc(NODES * 32 + 256), error[1024] = "";
    struct gn_arena arena = {0};
    struct gn_model model;
    assert_non_null(text);
    size_t length = (size_t)sprintf(text, "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[");
    for (int i = 1; i < NODES; i++)
        length += (size_t)sprintf(text + length, "{\"children\":[%d]},", i);
    length += (size_t)sprintf(text + length, "{}]}");
    assert_false(gn_model_read(write_file("deep.gltf", text, length), 0, &arena, &model, error, sizeof error));
    if (!strstr(error, "deep.gltf: the reader crashed on it (") || strstr(error, "malformed"))
        fail_msg("expected that the reader crashed, found '%s'", error);
    free(text);
    gn_arena_finish(&arena);
}

static void what_is_no_model_file_is_refused(void **state)
{
    (void)state;
    char path[300], error[1024];
    struct gn_arena arena = {0};
    struct gn_model model;
    snprintf(path, sizeof path, "%s/missing.obj", folder);
    assert_false(gn_model_read(path, 0, &arena, &model, error, sizeof error));
    assert_non_null(strstr(error, "No such file"));
    snprintf(path, sizeof path, "%s/folder.obj", folder);
    assert_int_equal(mkdir(path, 0777), 0);
    assert_false(gn_model_read(path, 0, &arena, &model, error, sizeof error));
    assert_non_null(strstr(error, "expected a file, found a folder"));
    rmdir(path);
    snprintf(path, sizeof path, "%s/fifo.ply", folder);
    assert_int_equal(mkfifo(path, 0666), 0);
    assert_false(gn_model_read(path, 0, &arena, &model, error, sizeof error));
    unlink(path);
    assert_false(gn_model_read(write_file("empty.ply", "", 0), 0, &arena, &model, error, sizeof error));
    assert_non_null(strstr(error, "empty"));
    assert_false(
        gn_model_read(write_file("model.txt", obj, sizeof obj - 1), 0, &arena, &model, error, sizeof error));
    assert_non_null(strstr(error, ".gltf"));
    /* One that takes too long, for which a microsecond is enough. */
    assert_false(gn_model_read(write_file("slow.obj", obj, sizeof obj - 1), 1e-6, &arena, &model, error,
                               sizeof error));
    assert_non_null(strstr(error, "slow.obj: not read within 1e-06 seconds"));
    gn_arena_finish(&arena);
}

static void read_any(const char *name, const char *data, size_t length, unsigned *inout_read)
{
    struct gn_arena arena = {0};
    struct gn_model model;
    char error[1024] = "";
    double start = gn_clock();
    const char *path = write_file(name, data, length);
    bool ok = gn_model_read(path, 10, &arena, &model, error, sizeof error);
    if (!ok && (length ? strncmp(error, path, strlen(path)) != 0 : !error[0]))
        fail_msg("%s: an error that does not name the file: '%s'", name, error);
    for (uint32_t m = 0; ok && m < model.mesh_count; m++)
        for (uint32_t t = 0; t < model.meshes[m].triangle_count; t++)
            for (int k = 0; k < 3; k++)
                assert_true(model.meshes[m].triangles[t][k] < model.meshes[m].position_count);
    if (gn_clock() - start > 15)
        fail_msg("%s: took %g seconds", name, gn_clock() - start);
    *inout_read += ok;
    if (getenv("GNOMON_TEST_VERBOSE") && !ok)
        print_message("%s\n", error);
    gn_arena_finish(&arena);
}

/* Some prefixes of each, and a hundred mutations: bytes changed, runs dropped, doubled, numbers made huge. */
static void mutated_files_never_crash(void **state)
{
    (void)state;
    static const char *const huge[] = {"4294967295", "-1", "99999999999", "1e999", "nan", "2147483648",
                                       "",           "0"};
    char gltf[4096], binary[1024], stl[184] = "binary";
    size_t gltf_length = make_gltf(gltf, sizeof gltf, "-1,1,1", "6"), binary_length = make_binary_ply(binary);
    /* Two triangles of 50 bytes behind a header of 80 and their number. */
    memcpy(stl + 80, &(uint32_t){2}, 4);
    memcpy(stl + 84 + 12, (const float[9]){0, 0, 0, 1, 0, 0, 1, 1, 0.1f}, 36);
    memcpy(stl + 134 + 12, (const float[9]){0, 0, 0, 1, 1, 0.1f, 0, 1, 0}, 36);
    const struct {
        const char *name, *data;
        size_t length;
    } seeds[] = {{"m.obj", obj, sizeof obj - 1},
                 {"m.ply", ply, sizeof ply - 1},
                 {"m.gltf", gltf, gltf_length},
                 {"b.ply", binary, binary_length},
                 {"m.stl", stl, sizeof stl}};
    struct gn_random random = {7};
    unsigned read = 0, all_read = 0, tried = 0;
    for (size_t s = 0; s < sizeof seeds / sizeof seeds[0]; s++) {
        read_any(seeds[s].name, seeds[s].data, seeds[s].length, &read);
        if (read != 1)
            fail_msg("%s: expected to be read unmutated", seeds[s].name);
        read = 0;
        for (size_t length = 1; length < seeds[s].length; length += 1 + seeds[s].length / 12, tried++)
            read_any(seeds[s].name, seeds[s].data, length, &read);
        const char *more = getenv("GNOMON_TEST_MUTATIONS");
        for (int i = 0, count = more ? atoi(more) : 100; i < count; i++, tried++) {
            char data[8192];
            size_t length = seeds[s].length;
            memcpy(data, seeds[s].data, length);
            for (uint32_t change = 1 + gn_random_below(&random, 3); change && length > 16; change--) {
                size_t at = gn_random_below(&random, (uint32_t)length - 8),
                       run = 1 + gn_random_below(&random, 7);
                switch (gn_random_below(&random, 4)) {
                case 0:
                    data[at] = (char)gn_random_below(&random, 256);
                    break;
                case 1:
                    memmove(data + at, data + at + run, length - at - run);
                    length -= run;
                    break;
                case 2:
                    memmove(data + at + run, data + at, length - at);
                    length += run;
                    break;
                default: {
                    /* A number in place of the next one. */
                    const char *number = huge[gn_random_below(&random, sizeof huge / sizeof huge[0])];
                    size_t size = strlen(number), end;
                    while (at < length && !(data[at] >= '0' && data[at] <= '9'))
                        at++;
                    for (end = at; end < length && data[end] >= '0' && data[end] <= '9';)
                        end++;
                    memmove(data + at + size, data + end, length - end);
                    memcpy(data + at, number, size);
                    length = length - (end - at) + size;
                }
                }
            }
            read_any(seeds[s].name, data, length, &read);
        }
        all_read += read;
        read = 0;
    }
    print_message("%u mutated files, of which %u still were models\n", tried, all_read);
    /* All refused or none would mean that the mutations test nothing. */
    assert_true(all_read > tried / 50 && all_read < tried - tried / 10);
}

static int setup(void **state)
{
    (void)state;
    return mkdtemp(folder) ? 0 : -1;
}

static int teardown(void **state)
{
    (void)state;
    char command[300];
    snprintf(command, sizeof command, "rm -rf -- '%s'", folder);
    return system(command);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(valid_files_are_read_as_they_are),
        cmocka_unit_test(polygons_become_triangles),
        cmocka_unit_test(malformed_files_are_told_with_their_place),
        cmocka_unit_test(a_file_that_the_reader_dies_of_is_not_called_malformed),
        cmocka_unit_test(what_is_no_model_file_is_refused),
        cmocka_unit_test(mutated_files_never_crash),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
