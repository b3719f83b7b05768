/* SPDX-License-Identifier: Apache-2.0 */
/* Scene files: a trial as JSON, every number so that it reads back bit for bit. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <yyjson.h>

#include "cts/fuzz.h"

/* What a file may ask for: more is refused before memory is taken for it. */
enum { MOST_BLASES = 64, MOST_GEOMETRIES = 4096, MOST_PRIMITIVES = 1 << 20, MOST_INSTANCES = 1 << 16, MOST_RAYS = 1 << 16 };
/* Bytes before the data of a geometry. */
#define MOST_OFFSET 65536u

static const char *const program_names[GN_CTS_PROGRAM_COUNT] = {"committed", "candidates", "detail", "positions"};
static const char *const step_names[] = {"", "refit", "refit_copy", "rebuild", "compact", "clone", "serialize"};
enum { STEP_COUNT = sizeof step_names / sizeof step_names[0] };

/* Writing */

static yyjson_mut_val *real(yyjson_mut_doc *doc, double value)
{
    if (isfinite(value))
        return yyjson_mut_real(doc, value);
    return yyjson_mut_str(doc, isnan(value) ? "nan" : value > 0 ? "inf" : "-inf");
}

static void put_doubles(yyjson_mut_doc *doc, yyjson_mut_val *to, const char *key, const double *values, size_t count)
{
    if (!values)
        return;
    yyjson_mut_val *array = yyjson_mut_obj_add_arr(doc, to, key);
    for (size_t i = 0; i < count; i++)
        yyjson_mut_arr_append(array, real(doc, values[i]));
}

static void put_floats(yyjson_mut_doc *doc, yyjson_mut_val *to, const char *key, const float *values, size_t count)
{
    if (!values)
        return;
    yyjson_mut_val *array = yyjson_mut_obj_add_arr(doc, to, key);
    for (size_t i = 0; i < count; i++)
        yyjson_mut_arr_append(array, real(doc, (double)values[i]));
}

static void put_uint(yyjson_mut_doc *doc, yyjson_mut_val *to, const char *key, uint64_t value)
{
    if (value)
        yyjson_mut_obj_add_uint(doc, to, key, value);
}

static void put_steps(yyjson_mut_doc *doc, yyjson_mut_val *to, const uint8_t *steps)
{
    if (steps[0] == GN_CTS_STEP_END)
        return;
    yyjson_mut_val *array = yyjson_mut_obj_add_arr(doc, to, "steps");
    for (uint32_t i = 0; i < GN_CTS_MAX_STEPS && steps[i] != GN_CTS_STEP_END; i++)
        yyjson_mut_arr_add_str(doc, array, steps[i] < STEP_COUNT ? step_names[steps[i]] : "");
}

static void put_geometry(yyjson_mut_doc *doc, yyjson_mut_val *to, const struct gn_cts_geometry *from)
{
    put_uint(doc, to, "flags", from->flags);
    put_uint(doc, to, "primitive_offset", from->primitive_offset);
    if (from->type == GN_REF_AABBS) {
        put_floats(doc, to, "aabbs", (const float *)from->aabbs, 6 * (size_t)from->aabb_count);
        put_floats(doc, to, "initial_aabbs", (const float *)from->initial_aabbs, 6 * (size_t)from->aabb_count);
        put_uint(doc, to, "aabb_stride", from->aabb_stride);
        return;
    }
    put_doubles(doc, to, "positions", (const double *)from->positions, 3 * (size_t)from->position_count);
    put_doubles(doc, to, "initial_positions", (const double *)from->initial_positions, 3 * (size_t)from->position_count);
    yyjson_mut_val *triangles = yyjson_mut_obj_add_arr(doc, to, "triangles");
    for (uint32_t i = 0; i < 3 * from->triangle_count; i++)
        yyjson_mut_arr_add_uint(doc, triangles, from->triangles[i / 3][i % 3]);
    put_uint(doc, to, "vertex_format", from->vertex_format);
    put_uint(doc, to, "vertex_stride", from->vertex_stride);
    put_uint(doc, to, "vertex_offset", from->vertex_offset);
    put_uint(doc, to, "first_vertex", from->first_vertex);
    put_uint(doc, to, "index_none", from->index_none);
    put_uint(doc, to, "index_uint32", from->index_uint32);
    put_floats(doc, to, "transform", from->transform, 12);
    put_floats(doc, to, "initial_transform", from->initial_transform, 12);
    put_uint(doc, to, "transform_offset", from->transform_offset);
}

static void put_instances(yyjson_mut_doc *doc, yyjson_mut_val *to, const char *key, const struct gn_cts_instance *from,
                          uint32_t count)
{
    if (!from)
        return;
    yyjson_mut_val *array = yyjson_mut_obj_add_arr(doc, to, key);
    for (uint32_t i = 0; i < count; i++) {
        yyjson_mut_val *one = yyjson_mut_arr_add_obj(doc, array);
        put_floats(doc, one, "transform", from[i].transform, 12);
        put_uint(doc, one, "custom_index", from[i].custom_index);
        yyjson_mut_obj_add_uint(doc, one, "mask", from[i].mask);
        put_uint(doc, one, "sbt_offset", from[i].sbt_offset);
        put_uint(doc, one, "flags", from[i].flags);
        if (from[i].blas != GN_CTS_NO_BLAS)
            yyjson_mut_obj_add_uint(doc, one, "blas", from[i].blas);
    }
}

static void put_scene(yyjson_mut_doc *doc, yyjson_mut_val *to, const struct gn_cts_scene *from)
{
    yyjson_mut_val *blases = yyjson_mut_obj_add_arr(doc, to, "blases");
    for (uint32_t b = 0; b < from->blas_count; b++) {
        yyjson_mut_val *blas = yyjson_mut_arr_add_obj(doc, blases);
        put_uint(doc, blas, "build_flags", from->blases[b].build_flags);
        put_uint(doc, blas, "generic", from->blases[b].generic);
        put_steps(doc, blas, from->blases[b].steps);
        yyjson_mut_val *geometries = yyjson_mut_obj_add_arr(doc, blas, "geometries");
        for (uint32_t g = 0; g < from->blases[b].geometry_count; g++)
            put_geometry(doc, yyjson_mut_arr_add_obj(doc, geometries), &from->blases[b].geometries[g]);
    }
    yyjson_mut_val *tlas = yyjson_mut_obj_add_obj(doc, to, "tlas");
    put_uint(doc, tlas, "build_flags", from->tlas_build_flags);
    put_uint(doc, tlas, "generic", from->tlas_generic);
    put_steps(doc, tlas, from->tlas_steps);
    put_uint(doc, tlas, "array_of_pointers", from->array_of_pointers);
    put_uint(doc, tlas, "geometry_pointers", from->geometry_pointers);
    put_uint(doc, tlas, "keep_sources", from->keep_sources);
    put_uint(doc, tlas, "instance_offset", from->instance_offset);
    put_uint(doc, tlas, "separate_builds", from->separate_builds);
    put_instances(doc, tlas, "instances", from->instances, from->instance_count);
    put_instances(doc, tlas, "initial_instances", from->initial_instances, from->instance_count);
}

static void put_ray(yyjson_mut_doc *doc, yyjson_mut_val *to, const struct gn_cts_ray *from)
{
    put_floats(doc, to, "origin", from->ray.origin, 3);
    put_floats(doc, to, "direction", from->ray.direction, 3);
    yyjson_mut_obj_add_val(doc, to, "tmin", real(doc, (double)from->ray.tmin));
    yyjson_mut_obj_add_val(doc, to, "tmax", real(doc, (double)from->ray.tmax));
    put_uint(doc, to, "flags", from->ray.flags);
    yyjson_mut_obj_add_uint(doc, to, "cull_mask", from->ray.cull_mask);
    yyjson_mut_obj_add_uint(doc, to, "confirm_mask", from->policy.confirm_mask);
    put_uint(doc, to, "generate_mask", from->policy.generate_mask);
    yyjson_mut_obj_add_val(doc, to, "generate_t0", real(doc, (double)from->policy.generate_t0));
    yyjson_mut_obj_add_val(doc, to, "generate_step", real(doc, (double)from->policy.generate_step));
}

char *gn_fuzz_encode(const struct gn_fuzz_file *file, size_t *out_length)
{
    yyjson_mut_doc *doc = yyjson_mut_doc_new(NULL);
    if (!doc)
        return NULL;
    yyjson_mut_val *root = yyjson_mut_obj(doc);
    yyjson_mut_doc_set_root(doc, root);
    yyjson_mut_obj_add_str(doc, root, "scene_file", "gnomon");
    yyjson_mut_obj_add_str(doc, root, "kind", file->kind);
    yyjson_mut_obj_add_str(doc, root, "message", file->message);
    yyjson_mut_obj_add_str(doc, root, "driver", file->driver);
    yyjson_mut_obj_add_str(doc, root, "device", file->device);
    yyjson_mut_obj_add_uint(doc, root, "seed", file->seed);
    yyjson_mut_obj_add_uint(doc, root, "number", file->number);
    yyjson_mut_obj_add_str(doc, root, "backend", gn_case_backend_name(file->trial.backend));
    yyjson_mut_obj_add_str(doc, root, "program", program_names[file->trial.program]);
    put_scene(doc, yyjson_mut_obj_add_obj(doc, root, "scene"), &file->trial.scene);
    yyjson_mut_val *rays = yyjson_mut_obj_add_arr(doc, root, "rays");
    for (uint32_t i = 0; i < file->trial.ray_count; i++)
        put_ray(doc, yyjson_mut_arr_add_obj(doc, rays), &file->trial.rays[i]);
    char *text = yyjson_mut_write(doc, YYJSON_WRITE_PRETTY_TWO_SPACES, out_length);
    yyjson_mut_doc_free(doc);
    return text;
}

/* Reading: the first thing that is wrong is told, and everything after it is skipped. */

struct reader {
    struct gn_arena *arena;
    char *error;
    size_t error_size;
    bool failed;
};

static void wrong(struct reader *reader, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void wrong(struct reader *reader, const char *format, ...)
{
    if (reader->failed)
        return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(reader->error, reader->error_size, format, arguments);
    va_end(arguments);
    reader->failed = true;
}

static uint32_t get_uint(struct reader *reader, yyjson_val *from, const char *key, uint32_t most)
{
    yyjson_val *value = yyjson_obj_get(from, key);
    if (!value)
        return 0;
    if (!yyjson_is_uint(value) || yyjson_get_uint(value) > most) {
        wrong(reader, "\"%s\": expected a whole number from 0 to %u", key, most);
        return 0;
    }
    return (uint32_t)yyjson_get_uint(value);
}

static double get_number(struct reader *reader, yyjson_val *value, const char *key)
{
    const char *text = yyjson_get_str(value);
    if (yyjson_is_num(value))
        return yyjson_get_num(value);
    if (text && strcmp(text, "nan") == 0)
        return (double)NAN;
    if (text && (strcmp(text, "inf") == 0 || strcmp(text, "-inf") == 0))
        return text[0] == '-' ? -HUGE_VAL : HUGE_VAL;
    wrong(reader, "\"%s\": expected a number, \"nan\", \"inf\" or \"-inf\"", key);
    return 0;
}

/* Numbers in groups of `group`; NULL where there are none. A count other than `wanted` is wrong unless that is UINT32_MAX. */
static double *get_doubles(struct reader *reader, yyjson_val *from, const char *key, uint32_t group, uint32_t wanted,
                           uint32_t *out_groups)
{
    yyjson_val *array = yyjson_obj_get(from, key);
    const size_t count = yyjson_arr_size(array);
    if (!array)
        return NULL;
    if (!yyjson_is_arr(array) || count % group || count / group > MOST_PRIMITIVES ||
        (wanted != UINT32_MAX && count / group != wanted)) {
        wrong(reader, "\"%s\": expected an array of %u numbers for each of what it is of", key, group);
        return NULL;
    }
    double *values = GN_NEW(reader->arena, double, count + 1);
    size_t i, max;
    yyjson_val *value;
    yyjson_arr_foreach(array, i, max, value) values[i] = get_number(reader, value, key);
    if (out_groups)
        *out_groups = (uint32_t)(count / group);
    return values;
}

static float *get_floats(struct reader *reader, yyjson_val *from, const char *key, uint32_t group, uint32_t wanted,
                         uint32_t *out_groups)
{
    uint32_t groups = 0;
    const double *values = get_doubles(reader, from, key, group, wanted, &groups);
    if (!values)
        return NULL;
    float *out = GN_NEW(reader->arena, float, (size_t)groups * group + 1);
    for (size_t i = 0; i < (size_t)groups * group; i++)
        out[i] = (float)values[i];
    if (out_groups)
        *out_groups = groups;
    return out;
}

static void get_steps(struct reader *reader, yyjson_val *from, uint8_t steps[GN_CTS_MAX_STEPS])
{
    size_t i, max;
    yyjson_val *value, *array = yyjson_obj_get(from, "steps");
    if (yyjson_arr_size(array) > GN_CTS_MAX_STEPS) {
        wrong(reader, "\"steps\": expected at most %d", GN_CTS_MAX_STEPS);
        return;
    }
    yyjson_arr_foreach(array, i, max, value) {
        const char *name = yyjson_get_str(value);
        for (uint8_t s = 1; name && s < STEP_COUNT; s++)
            if (strcmp(step_names[s], name) == 0)
                steps[i] = s;
        if (!steps[i])
            wrong(reader, "\"steps\": expected refit, refit_copy, rebuild, compact, clone or serialize");
    }
}

static void get_geometry(struct reader *reader, yyjson_val *from, struct gn_cts_geometry *out)
{
    out->flags = get_uint(reader, from, "flags", 0x7);
    out->primitive_offset = get_uint(reader, from, "primitive_offset", MOST_OFFSET);
    if (yyjson_obj_get(from, "aabbs")) {
        out->type = GN_REF_AABBS;
        out->aabbs = (const float(*)[6])get_floats(reader, from, "aabbs", 6, UINT32_MAX, &out->aabb_count);
        out->initial_aabbs = (const float(*)[6])get_floats(reader, from, "initial_aabbs", 6, out->aabb_count, NULL);
        out->aabb_stride = get_uint(reader, from, "aabb_stride", 4096);
        if (out->aabb_stride % 8 || (out->aabb_stride && out->aabb_stride < 24))
            wrong(reader, "\"aabb_stride\": expected a multiple of 8, 24 or more");
        return;
    }
    out->positions = (const double(*)[3])get_doubles(reader, from, "positions", 3, UINT32_MAX, &out->position_count);
    out->initial_positions =
        (const double(*)[3])get_doubles(reader, from, "initial_positions", 3, out->position_count, NULL);
    yyjson_val *triangles = yyjson_obj_get(from, "triangles"), *value;
    size_t i, max;
    if (!out->positions || !yyjson_is_arr(triangles) || yyjson_arr_size(triangles) % 3 ||
        yyjson_arr_size(triangles) / 3 > MOST_PRIMITIVES) {
        wrong(reader, "a geometry: expected \"aabbs\", or \"positions\" and \"triangles\" of three indices each");
        return;
    }
    out->triangle_count = (uint32_t)(yyjson_arr_size(triangles) / 3);
    uint32_t(*indices)[3] = gn_arena_alloc(reader->arena, out->triangle_count, sizeof *indices);
    yyjson_arr_foreach(triangles, i, max, value) {
        if (!yyjson_is_uint(value) || yyjson_get_uint(value) >= out->position_count)
            wrong(reader, "\"triangles\": expected indices below %u", out->position_count);
        else
            indices[i / 3][i % 3] = (uint32_t)yyjson_get_uint(value);
    }
    out->triangles = (const uint32_t(*)[3])indices;
    out->vertex_format = (VkFormat)get_uint(reader, from, "vertex_format", 200);
    out->vertex_stride = get_uint(reader, from, "vertex_stride", 4096);
    out->vertex_offset = get_uint(reader, from, "vertex_offset", MOST_OFFSET);
    out->first_vertex = get_uint(reader, from, "first_vertex", 65536);
    out->index_none = get_uint(reader, from, "index_none", 1);
    out->index_uint32 = get_uint(reader, from, "index_uint32", 1);
    out->transform = get_floats(reader, from, "transform", 12, 1, NULL);
    out->initial_transform = get_floats(reader, from, "initial_transform", 12, 1, NULL);
    out->transform_offset = get_uint(reader, from, "transform_offset", MOST_OFFSET);
    if (out->transform_offset % 16)
        wrong(reader, "\"transform_offset\": expected a multiple of 16");
}

static struct gn_cts_instance *get_instances(struct reader *reader, yyjson_val *from, const char *key, uint32_t blas_count,
                                             uint32_t *out_count)
{
    yyjson_val *array = yyjson_obj_get(from, key), *value;
    size_t i, max;
    if (yyjson_arr_size(array) > MOST_INSTANCES) {
        wrong(reader, "\"%s\": expected at most %d", key, MOST_INSTANCES);
        return NULL;
    }
    *out_count = (uint32_t)yyjson_arr_size(array);
    struct gn_cts_instance *out = GN_NEW(reader->arena, struct gn_cts_instance, *out_count);
    yyjson_arr_foreach(array, i, max, value) {
        const float *transform = get_floats(reader, value, "transform", 12, 1, NULL);
        if (!transform) {
            wrong(reader, "\"%s\": expected a \"transform\" of 12 numbers", key);
            return NULL;
        }
        memcpy(out[i].transform, transform, sizeof out[i].transform);
        out[i].custom_index = get_uint(reader, value, "custom_index", 0xFFFFFF);
        out[i].mask = get_uint(reader, value, "mask", 0xFF);
        out[i].sbt_offset = get_uint(reader, value, "sbt_offset", 0xFFFFFF);
        out[i].flags = get_uint(reader, value, "flags", 0xF);
        out[i].blas = GN_CTS_NO_BLAS;
        if (yyjson_obj_get(value, "blas")) {
            out[i].blas = get_uint(reader, value, "blas", MOST_BLASES);
            if (out[i].blas >= blas_count)
                wrong(reader, "\"blas\": expected a number below %u", blas_count);
        }
    }
    return out;
}

static void get_scene(struct reader *reader, yyjson_val *from, struct gn_cts_scene *out)
{
    yyjson_val *blases = yyjson_obj_get(from, "blases"), *tlas = yyjson_obj_get(from, "tlas"), *value, *one;
    size_t i, max, g, g_max;
    if (!yyjson_is_arr(blases) || yyjson_arr_size(blases) > MOST_BLASES || !yyjson_is_obj(tlas)) {
        wrong(reader, "\"scene\": expected \"blases\", at most %d, and \"tlas\"", MOST_BLASES);
        return;
    }
    out->blas_count = (uint32_t)yyjson_arr_size(blases);
    struct gn_cts_blas *list = GN_NEW(reader->arena, struct gn_cts_blas, out->blas_count);
    out->blases = list;
    yyjson_arr_foreach(blases, i, max, value) {
        yyjson_val *geometries = yyjson_obj_get(value, "geometries");
        if (yyjson_arr_size(geometries) > MOST_GEOMETRIES) {
            wrong(reader, "\"geometries\": expected at most %d", MOST_GEOMETRIES);
            return;
        }
        list[i].build_flags = get_uint(reader, value, "build_flags", 0xFFFF);
        list[i].generic = get_uint(reader, value, "generic", 1);
        get_steps(reader, value, list[i].steps);
        list[i].geometry_count = (uint32_t)yyjson_arr_size(geometries);
        struct gn_cts_geometry *parts = GN_NEW(reader->arena, struct gn_cts_geometry, list[i].geometry_count);
        list[i].geometries = parts;
        yyjson_arr_foreach(geometries, g, g_max, one) get_geometry(reader, one, &parts[g]);
    }
    uint32_t initial_count = 0;
    out->tlas_build_flags = get_uint(reader, tlas, "build_flags", 0xFFFF);
    out->tlas_generic = get_uint(reader, tlas, "generic", 1);
    get_steps(reader, tlas, out->tlas_steps);
    out->array_of_pointers = get_uint(reader, tlas, "array_of_pointers", 1);
    out->geometry_pointers = get_uint(reader, tlas, "geometry_pointers", 1);
    out->keep_sources = get_uint(reader, tlas, "keep_sources", 1);
    out->instance_offset = get_uint(reader, tlas, "instance_offset", MOST_OFFSET);
    out->separate_builds = get_uint(reader, tlas, "separate_builds", 1);
    out->instances = get_instances(reader, tlas, "instances", out->blas_count, &out->instance_count);
    if (yyjson_obj_get(tlas, "initial_instances")) {
        out->initial_instances = get_instances(reader, tlas, "initial_instances", out->blas_count, &initial_count);
        if (initial_count != out->instance_count)
            wrong(reader, "\"initial_instances\": expected %u, as there are instances", out->instance_count);
    }
}

static void get_ray(struct reader *reader, yyjson_val *from, struct gn_cts_ray *out)
{
    const float *origin = get_floats(reader, from, "origin", 3, 1, NULL);
    const float *direction = get_floats(reader, from, "direction", 3, 1, NULL);
    if (!origin || !direction) {
        wrong(reader, "\"rays\": expected \"origin\" and \"direction\" of 3 numbers each");
        return;
    }
    memcpy(out->ray.origin, origin, sizeof out->ray.origin);
    memcpy(out->ray.direction, direction, sizeof out->ray.direction);
    out->ray.tmin = (float)get_number(reader, yyjson_obj_get(from, "tmin"), "tmin");
    out->ray.tmax = (float)get_number(reader, yyjson_obj_get(from, "tmax"), "tmax");
    out->ray.flags = get_uint(reader, from, "flags", 0x3FF);
    out->ray.cull_mask = get_uint(reader, from, "cull_mask", UINT32_MAX);
    out->policy.confirm_mask = get_uint(reader, from, "confirm_mask", UINT32_MAX);
    out->policy.generate_mask = get_uint(reader, from, "generate_mask", UINT32_MAX);
    out->policy.generate_t0 = (float)get_number(reader, yyjson_obj_get(from, "generate_t0"), "generate_t0");
    out->policy.generate_step = (float)get_number(reader, yyjson_obj_get(from, "generate_step"), "generate_step");
    bool valid = out->ray.tmin >= 0 && out->ray.tmin <= out->ray.tmax && isfinite(out->ray.tmin);
    for (int a = 0; a < 3; a++)
        valid = valid && isfinite(origin[a]) && isfinite(direction[a]);
    if (!valid || (direction[0] == 0 && direction[1] == 0 && direction[2] == 0))
        wrong(reader, "\"rays\": expected finite numbers, a direction other than 0, and 0 <= tmin <= tmax");
}

static const char *get_text(struct reader *reader, yyjson_val *from, const char *key)
{
    const char *text = yyjson_get_str(yyjson_obj_get(from, key));
    return gn_arena_printf(reader->arena, "%s", text ? text : "");
}

bool gn_fuzz_decode(const char *text, size_t length, struct gn_arena *arena, struct gn_fuzz_file *out, char *out_error,
                    size_t error_size)
{
    struct reader reader = {arena, out_error, error_size, false};
    memset(out, 0, sizeof *out);
    yyjson_read_err problem;
    yyjson_doc *doc = yyjson_read_opts((char *)(uintptr_t)text, length, 0, NULL, &problem);
    yyjson_val *root = yyjson_doc_get_root(doc), *value;
    if (!doc) {
        snprintf(out_error, error_size, "not JSON: %s at byte %zu", problem.msg, problem.pos);
        return false;
    }
    if (!yyjson_obj_get(root, "scene_file"))
        wrong(&reader, "expected a scene file with \"scene_file\", \"scene\" and \"rays\"");
    out->kind = get_text(&reader, root, "kind");
    out->message = get_text(&reader, root, "message");
    out->driver = get_text(&reader, root, "driver");
    out->device = get_text(&reader, root, "device");
    out->seed = yyjson_get_uint(yyjson_obj_get(root, "seed"));
    out->number = yyjson_get_uint(yyjson_obj_get(root, "number"));
    const char *program = get_text(&reader, root, "program");
    out->trial.program = GN_CTS_PROGRAM_COUNT;
    for (uint32_t p = 0; p < GN_CTS_PROGRAM_COUNT; p++)
        if (strcmp(program_names[p], program) == 0)
            out->trial.program = (enum gn_cts_program)p;
    if (out->trial.program == GN_CTS_PROGRAM_COUNT)
        wrong(&reader, "\"program\": expected committed, candidates, detail or positions");
    out->trial.backend =
        strcmp(get_text(&reader, root, "backend"), "pipeline") == 0 ? GN_CASE_PIPELINE : GN_CASE_QUERY;
    get_scene(&reader, yyjson_obj_get(root, "scene"), &out->trial.scene);
    yyjson_val *rays = yyjson_obj_get(root, "rays");
    if (!yyjson_is_arr(rays) || !yyjson_arr_size(rays) || yyjson_arr_size(rays) > MOST_RAYS)
        wrong(&reader, "\"rays\": expected from 1 to %d", MOST_RAYS);
    if (!reader.failed) {
        size_t i, max;
        out->trial.ray_count = (uint32_t)yyjson_arr_size(rays);
        out->trial.rays = GN_NEW(arena, struct gn_cts_ray, out->trial.ray_count);
        yyjson_arr_foreach(rays, i, max, value) get_ray(&reader, value, &out->trial.rays[i]);
    }
    yyjson_doc_free(doc);
    return !reader.failed;
}
