/* SPDX-License-Identifier: Apache-2.0 */
/* Measures a driver over the ways to build a scene: see accuracy_driver.h. */
#include "cts/accuracy_driver.h"

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cts/case.h"
#include "cts/progress.h"
#include "cts/statistics.h"

#define FAST_TRACE VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR
#define UPDATABLE (FAST_TRACE | VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR)

const struct gn_accuracy_setting gn_accuracy_settings[GN_ACCURACY_SETTING_COUNT] = {
    {.name = "fast_trace", .group = "flags", .about = "PREFER_FAST_TRACE, f32 vertices: the others are compared with it", .flags = FAST_TRACE},
    {.name = "no_preference", .group = "flags", .about = "no build flag"},
    {.name = "fast_build", .group = "flags", .about = "PREFER_FAST_BUILD",
     .flags = VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_BUILD_BIT_KHR},
    {.name = "low_memory", .group = "flags", .about = "LOW_MEMORY",
     .flags = VK_BUILD_ACCELERATION_STRUCTURE_LOW_MEMORY_BIT_KHR},
    {.name = "compacted", .group = "flags", .about = "PREFER_FAST_TRACE, compacted after the build",
     .flags = FAST_TRACE | VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR, .step = GN_CTS_STEP_COMPACT},
    {.name = "f16", .group = "format", .about = "R16G16B16A16_SFLOAT vertices, placed by the instance's transform",
     .flags = FAST_TRACE, .format = VK_FORMAT_R16G16B16A16_SFLOAT},
    {.name = "snorm16", .group = "format", .about = "R16G16B16A16_SNORM vertices, placed by the instance's transform",
     .flags = FAST_TRACE, .format = VK_FORMAT_R16G16B16A16_SNORM},
    {.name = "updatable", .group = "update", .about = "ALLOW_UPDATE, never updated", .flags = UPDATABLE},
    {.name = "rebuilt", .group = "update", .about = "rebuilt after a large motion", .flags = UPDATABLE,
     .step = GN_CTS_STEP_REBUILD, .motion = 0.5},
    {.name = "refitted_little", .group = "update", .about = "refitted after a small motion", .flags = UPDATABLE,
     .step = GN_CTS_STEP_REFIT, .motion = 0.01},
    {.name = "refitted_far", .group = "update", .about = "refitted after a large motion", .flags = UPDATABLE,
     .step = GN_CTS_STEP_REFIT, .motion = 0.5},
};

#define MOST_RUNS 15

/* By ray queries in a compute shader. */
static const struct gn_cts_route query = {.entry = GN_CTS_QUERY};

/* Memory that parent and child share. */
struct shared {
    bool done;
    int exit_status;
    char error[1024], stage[256];
    struct gn_accuracy_driver driver;
    struct gn_accuracy_driver_row rows[];
};

struct exact {
    struct gn_ref_hit hit;
    bool found;
};

struct measurement {
    const struct gn_accuracy *accuracy;
    const struct gn_accuracy_scene *scene;
    struct gn_device *device;
    struct gn_cts_ray *rays[GN_AIM_COUNT];
    struct gn_cts_ray *judged_rays; /* the first ones of each kind, one kind after the other */
    struct exact *exact; /* of those */
    uint32_t ray_count, judged_count; /* of each kind */
    struct gn_arena *arena; /* of the scene */
    const struct gn_cts_scene *plain_scene;
    struct gn_built_scene *plain;
    char error[512];
};

/* The box around a mesh's vertices, as its centre and half its extent along each axis (at least one of them not 0). */
static void frame_of(const struct gn_mesh *mesh, double centre[3], double half[3])
{
    double most = 0;
    for (int c = 0; c < 3; c++) {
        double low = INFINITY, high = -INFINITY;
        for (uint32_t v = 0; v < mesh->position_count; v++) {
            low = fmin(low, mesh->positions[v][c]);
            high = fmax(high, mesh->positions[v][c]);
        }
        centre[c] = (low + high) / 2;
        half[c] = (high - low) / 2;
        most = fmax(most, half[c]);
    }
    for (int c = 0; c < 3; c++)
        if (!(half[c] > 0))
            half[c] = most > 0 ? most : 1;
}

/* Where the vertices were at the first build: twisted about an axis, the more the farther along it. */
static double (*moved_positions(struct gn_arena *arena, const struct gn_mesh *mesh, double motion))[3]
{
    double(*out)[3] = gn_arena_alloc(arena, mesh->position_count + 1, sizeof *out), centre[3], half[3];
    frame_of(mesh, centre, half);
    for (uint32_t v = 0; v < mesh->position_count; v++) {
        const double *p = mesh->positions[v];
        double angle = motion * M_PI * (p[0] - centre[0]) / half[0];
        double y = p[1] - centre[1], z = p[2] - centre[2];
        out[v][0] = (float)(p[0] + motion * half[0] * sin(3 * y / half[1]));
        out[v][1] = (float)(centre[1] + y * cos(angle) - z * sin(angle));
        out[v][2] = (float)(centre[2] + y * sin(angle) + z * cos(angle));
    }
    return out;
}

/* As the setting has it, or (not `updated`) as its first build leaves it. */
static void make_scene(const struct measurement *m, const struct gn_accuracy_setting *setting, bool updated,
                       struct gn_arena *arena, struct gn_cts_scene *out)
{
    const struct gn_model *model = &m->scene->model;
    struct gn_cts_blas *blases = GN_NEW(arena, struct gn_cts_blas, model->mesh_count);
    struct gn_cts_instance *instances = GN_NEW(arena, struct gn_cts_instance, model->instance_count);
    double(*centres)[3] = gn_arena_alloc(arena, model->mesh_count, sizeof *centres);
    double(*halves)[3] = gn_arena_alloc(arena, model->mesh_count, sizeof *halves);
    for (uint32_t i = 0; i < model->mesh_count; i++) {
        const struct gn_mesh *mesh = &model->meshes[i];
        struct gn_cts_geometry *geometry = GN_NEW(arena, struct gn_cts_geometry, 1);
        *geometry = gn_geometry_of_mesh(mesh);
        geometry->flags = GN_REF_GEOMETRY_OPAQUE;
        geometry->vertex_format = setting->format;
        for (int c = 0; c < 3; c++) {
            centres[i][c] = 0;
            halves[i][c] = 1;
        }
        if (setting->format != VK_FORMAT_UNDEFINED) {
            double(*scaled)[3] = gn_arena_alloc(arena, mesh->position_count + 1, sizeof *scaled);
            frame_of(mesh, centres[i], halves[i]);
            for (uint32_t v = 0; v < mesh->position_count; v++)
                for (int c = 0; c < 3; c++)
                    scaled[v][c] = (mesh->positions[v][c] - centres[i][c]) / halves[i][c];
            geometry->positions = (const double(*)[3])scaled;
        }
        const double(*moved)[3] = NULL;
        if (setting->motion > 0)
            moved = (const double(*)[3])moved_positions(arena, mesh, setting->motion);
        if (moved && updated)
            geometry->initial_positions = moved;
        else if (moved)
            geometry->positions = moved;
        blases[i] = (struct gn_cts_blas){
            .geometries = geometry, .geometry_count = 1, .build_flags = setting->flags,
            .steps = {updated ? setting->step : GN_CTS_STEP_END}};
    }
    for (uint32_t i = 0; i < model->instance_count; i++) {
        uint32_t mesh = model->instances[i].mesh;
        const float *from = model->instances[i].transform;
        instances[i] = gn_instance_of(mesh, from);
        instances[i].custom_index = i & 0xFFFFFF;
        for (int r = 0; r < 3; r++) {
            double translation = from[4 * r + 3];
            for (int c = 0; c < 3; c++) {
                instances[i].transform[4 * r + c] = (float)((double)from[4 * r + c] * halves[mesh][c]);
                translation += (double)from[4 * r + c] * centres[mesh][c];
            }
            instances[i].transform[4 * r + 3] = (float)translation;
        }
    }
    *out = (struct gn_cts_scene){.blases = blases,
                                 .blas_count = model->mesh_count,
                                 .instances = instances,
                                 .instance_count = model->instance_count,
                                 .tlas_build_flags =
                                     setting->flags & ~(VkFlags)VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR};
}

static bool is_ok(struct measurement *m, enum gn_device_status status, const char *doing)
{
    if (status != GN_DEVICE_OK)
        snprintf(m->error, sizeof m->error, "scene %.64s, %s: %.400s", m->scene->name, doing, gn_device_message(m->device));
    return status == GN_DEVICE_OK;
}

/* Seconds per ray, or a negative number. */
static double time_rays(struct measurement *m, struct gn_built_scene *built, int aim)
{
    double least = m->accuracy->options.quick ? 0.002 : 0.02, seconds = 0;
    uint32_t times = 0;
    do {
        struct gn_arena arena = {0};
        struct gn_cts_answers answers;
        double start = gn_clock();
        bool ok = is_ok(m, gn_scene_trace(built, &query, GN_CTS_COMMITTED, m->rays[aim], m->ray_count, &arena, &answers),
                        "tracing");
        seconds += gn_clock() - start;
        gn_arena_finish(&arena);
        if (!ok)
            return -1;
    } while (++times < 100 && seconds < least);
    return fmax(seconds, 1e-9) / ((double)times * m->ray_count);
}

/* Whether the exact t of the two are equal and the given one is met at all. */
static bool is_tied(const struct measurement *m, const struct gn_ref_ray *ray, const struct gn_ref_hit *right,
                    const struct gn_ref_answer *given)
{
    struct gn_ref_hit hits[64];
    int64_t count = gn_ref_trace_all_exact(m->scene->reference, ray, hits, 64);
    for (int64_t i = 0; i < count && i < 64; i++)
        if (hits[i].instance == given->instance && hits[i].geometry == given->geometry &&
            hits[i].primitive == given->primitive)
            return gn_ref_compare_t_exact(m->scene->reference, ray, right, &hits[i]) == 0;
    return false;
}

static double error_in_ulp(double t, double exact)
{
    int exponent;
    frexp(exact, &exponent);
    return fabs(ldexp(t - exact, FLT_MANT_DIG - (exponent < FLT_MIN_EXP ? FLT_MIN_EXP : exponent)));
}

/* Against the scene as it was meant. */
static void compare_answers(const struct measurement *m, int aim, const struct gn_ref_answer *answers,
                            struct gn_accuracy_driver_row *row, double *errors)
{
    for (uint32_t i = 0; i < m->judged_count; i++) {
        uint32_t at = (uint32_t)aim * m->judged_count + i;
        const struct exact *exact = &m->exact[at];
        const struct gn_ref_answer *given = &answers[at];
        bool hit = given->kind == GN_REF_ANSWER_TRIANGLE;
        if (!hit && !exact->found)
            continue;
        if (!hit)
            row->lost++;
        else if (!exact->found)
            row->invented++;
        else if ((given->instance == exact->hit.instance && given->primitive == exact->hit.primitive) ||
                 is_tied(m, &m->judged_rays[at].ray, &exact->hit, given))
            errors[row->hits++] = error_in_ulp((double)given->t, exact->hit.t);
        else if (gn_accuracy_neighbours(&m->scene->model, given->instance, given->primitive, exact->hit.instance,
                                        exact->hit.primitive))
            row->neighbour++;
        else
            row->other++;
    }
    row->t_error_max = row->t_error_median = (double)NAN;
    if (row->hits) {
        row->t_error_median = gn_median(errors, (uint32_t)row->hits);
        row->t_error_max = errors[row->hits - 1];
    }
}

/* Judges the first rays of all kinds; rows[aim] of each. */
static bool judge(struct measurement *m, const struct gn_cts_scene *scene, struct gn_built_scene *built,
                  struct gn_accuracy_driver_row *rows)
{
    static const struct gn_case self = {.name = "accuracy"};
    const uint32_t count = GN_AIM_COUNT * m->judged_count;
    struct gn_arena arena = {0};
    struct gn_cts_answers answers;
    struct gn_case_run run;
    bool ok = false;
    gn_case_run_begin(&self, m->device, 0, 1, &run);
    if (!is_ok(m, gn_scene_trace(built, &query, GN_CTS_COMMITTED, m->judged_rays, count, &arena, &answers), "tracing"))
        goto done;
    gn_case_judge(&run, scene, GN_CTS_COMMITTED, m->judged_rays, count, 0, &answers);
    if (run.result.status == GN_CASE_ERROR || !run.result.image) {
        snprintf(m->error, sizeof m->error, "scene %.64s, judging: %.400s", m->scene->name,
                 run.result.message[0] ? run.result.message : "out of memory");
        goto done;
    }
    double *errors = GN_NEW(&arena, double, m->judged_count);
    for (int aim = 0; aim < GN_AIM_COUNT; aim++) {
        struct gn_accuracy_driver_row *row = &rows[aim];
        row->rays = m->judged_count;
        /* The picture has a byte per ray: its verdict, and whether the ideal answer is a miss. */
        for (uint32_t i = 0; i < m->judged_count; i++)
            row->class_counts[run.result.image[(uint32_t)aim * m->judged_count + i] & 0x7F]++;
        compare_answers(m, aim, answers.committed, row, errors);
    }
    ok = true;
done:
    gn_case_run_finish(&run);
    gn_arena_finish(&arena);
    return ok;
}

/* Builds several times, in turns with the plain scene; the last one stays. Gives the medians of time and ratio. */
static struct gn_built_scene *build(struct measurement *m, const struct gn_cts_scene *scene, double *out_seconds,
                                    double *out_ratio, bool *out_unsupported)
{
    struct gn_built_scene *built = NULL, *plain = NULL;
    double seconds[MOST_RUNS], ratios[MOST_RUNS];
    uint32_t builds = 0;
    for (uint32_t run = 0; run < m->accuracy->options.runs; run++) {
        gn_built_scene_destroy(built);
        built = NULL;
        enum gn_device_status status = gn_scene_build(m->device, scene, &built);
        *out_unsupported = status == GN_DEVICE_UNSUPPORTED;
        if (!is_ok(m, status, "building"))
            return NULL;
        seconds[run] = gn_built_scene_info(built).build_seconds;
        ratios[run] = 1;
        if (m->plain_scene) {
            if (!is_ok(m, gn_scene_build(m->device, m->plain_scene, &plain), "building")) {
                gn_built_scene_destroy(built);
                return NULL;
            }
            ratios[run] = seconds[run] / gn_built_scene_info(plain).build_seconds;
            gn_built_scene_destroy(plain);
        }
        builds++;
        /* Of a large scene once has to do. */
        if (seconds[run] > 1)
            break;
    }
    *out_seconds = gn_median(seconds, builds);
    *out_ratio = gn_median(ratios, builds);
    return built;
}

/* What the first build takes of a setting that is updated after it. */
static bool time_first_build(struct measurement *m, const struct gn_accuracy_setting *setting, double *out_seconds)
{
    struct gn_arena arena = {0};
    struct gn_cts_scene scene;
    double ratio;
    bool unsupported;
    make_scene(m, setting, false, &arena, &scene);
    struct gn_built_scene *built = build(m, &scene, out_seconds, &ratio, &unsupported);
    gn_built_scene_destroy(built);
    gn_arena_finish(&arena);
    return built != NULL;
}

static bool measure_setting(struct measurement *m, uint32_t number, struct gn_accuracy_driver *out)
{
    const struct gn_accuracy_setting *setting = &gn_accuracy_settings[number];
    const uint32_t runs = m->accuracy->options.runs;
    struct gn_accuracy_driver_row *rows = out->rows + out->row_count;
    struct gn_arena own = {0}, *arena = number == GN_ACCURACY_SETTING_PLAIN ? m->arena : &own;
    struct gn_cts_scene *scene = GN_NEW(arena, struct gn_cts_scene, 1);
    double build_seconds, build_ratio, first_seconds = (double)NAN;
    bool unsupported = false, ok = false;
    struct gn_built_scene *built = NULL;
    if (setting->format != VK_FORMAT_UNDEFINED && !gn_device_has_vertex_format(m->device, setting->format)) {
        unsupported = true;
        snprintf(m->error, sizeof m->error, "no such vertex format");
        goto done;
    }
    if (number == GN_ACCURACY_SETTING_PLAIN && !time_first_build(m, setting, &first_seconds))
        goto done; /* that was to warm up */
    make_scene(m, setting, true, arena, scene);
    built = build(m, scene, &build_seconds, &build_ratio, &unsupported);
    if (!built || (setting->motion > 0 && !time_first_build(m, setting, &first_seconds)))
        goto done;
    const struct gn_built_info info = gn_built_scene_info(built);
    for (int aim = 0; aim < GN_AIM_COUNT; aim++)
        rows[aim] = (struct gn_accuracy_driver_row){
            .scene = (uint32_t)(m->scene - m->accuracy->scenes),
            .setting = number,
            .aim = (enum gn_aim)aim,
            .build_seconds = build_seconds,
            .build_ratio = build_ratio,
            .update_seconds = setting->motion > 0 ? build_seconds - first_seconds : (double)NAN,
            .bytes = info.blas_bytes + info.tlas_bytes};
    if (!judge(m, scene, built, rows))
        goto done;
    if (number == GN_ACCURACY_SETTING_PLAIN) {
        m->plain = built;
        m->plain_scene = scene;
        built = NULL;
    }
    struct gn_built_scene *both[2] = {m->plain, built ? built : m->plain};
    for (int aim = 0; aim < GN_AIM_COUNT; aim++) {
        double speeds[MOST_RUNS], ratios[MOST_RUNS];
        for (uint32_t run = 0; run < runs; run++) {
            double seconds[2] = {0, 0};
            /* In turns, and each run the other one first. */
            for (uint32_t k = 0; k < 2; k++) {
                uint32_t which = (k + run) % 2;
                if ((seconds[which] = time_rays(m, both[which], aim)) < 0)
                    goto done;
            }
            speeds[run] = 1e-6 / seconds[1];
            ratios[run] = number == GN_ACCURACY_SETTING_PLAIN ? 1 : seconds[0] / seconds[1];
        }
        rows[aim].mrays_per_s = gn_median(speeds, runs);
        rows[aim].ratio_to_plain = gn_median(ratios, runs);
    }
    out->row_count += GN_AIM_COUNT;
    ok = true;
done:
    if (!ok && unsupported && number != GN_ACCURACY_SETTING_PLAIN) {
        size_t used = strlen(out->left_out);
        snprintf(out->left_out + used, sizeof out->left_out - used, "%s%s, %s: %.200s", used ? "; " : "", m->scene->name,
                 setting->name, m->error);
        ok = true;
    }
    gn_built_scene_destroy(built);
    gn_arena_finish(&own);
    return ok;
}

static bool measure_scene(struct measurement *m, struct gn_accuracy_driver *out)
{
    struct gn_arena *arena = m->arena;
    const struct gn_accuracy_options *options = &m->accuracy->options;
    const uint32_t judged = m->judged_count;
    struct gn_ref_ray *bare = GN_NEW(arena, struct gn_ref_ray, m->ray_count);
    struct gn_ref_hit *hits = GN_NEW(arena, struct gn_ref_hit, judged);
    int8_t *found = GN_NEW(arena, int8_t, judged);
    m->judged_rays = GN_NEW(arena, struct gn_cts_ray, GN_AIM_COUNT * judged);
    m->exact = GN_NEW(arena, struct exact, GN_AIM_COUNT * judged);
    for (int aim = 0; aim < GN_AIM_COUNT; aim++) {
        gn_accuracy_rays(m->scene, (enum gn_aim)aim, options->seed, bare, m->ray_count);
        m->rays[aim] = GN_NEW(arena, struct gn_cts_ray, m->ray_count);
        for (uint32_t i = 0; i < m->ray_count; i++)
            m->rays[aim][i].ray = bare[i];
        memcpy(m->judged_rays + (uint32_t)aim * judged, m->rays[aim], judged * sizeof *m->judged_rays);
        gn_ref_trace_closest_triangles_exact(m->scene->reference, bare, judged, hits, found);
        for (uint32_t i = 0; i < judged; i++) {
            if (found[i] < 0) {
                snprintf(m->error, sizeof m->error, "scene %.64s: out of memory", m->scene->name);
                return false;
            }
            m->exact[(uint32_t)aim * judged + i] = (struct exact){hits[i], found[i] == 1};
        }
    }
    for (uint32_t s = 0; s < GN_ACCURACY_SETTING_COUNT; s++)
        if (!measure_setting(m, s, out))
            return false;
    return true;
}

/* The child's part. */
static void measure_all(const struct gn_accuracy *accuracy, struct shared *shared)
{
    const struct gn_device_options options = {shared->driver.icd[0] ? shared->driver.icd : NULL, -1};
    struct gn_accuracy_driver *driver = &shared->driver;
    struct gn_device *device = gn_device_create(&options, shared->error, sizeof shared->error);
    shared->exit_status = 2;
    if (!device)
        return;
    const struct gn_device_info *info = gn_device_info(device);
    snprintf(driver->device, sizeof driver->device, "%s", info->name);
    snprintf(driver->about, sizeof driver->about, "%.250s %.250s", info->driver_name, info->driver_info);
    shared->exit_status = 3;
    for (uint32_t i = 0; i < accuracy->scene_count; i++) {
        struct gn_arena arena = {0};
        struct gn_accuracy_scene *scene = &accuracy->scenes[i];
        struct measurement m = {.accuracy = accuracy, .scene = scene, .device = device, .arena = &arena, .ray_count = accuracy->options.rays};
        m.judged_count = m.ray_count < GN_ACCURACY_DRIVER_JUDGED ? m.ray_count : GN_ACCURACY_DRIVER_JUDGED;
        snprintf(shared->stage, sizeof shared->stage, "%.200s", scene->name);
        fprintf(stderr, "[%u/%u] the driver on %s\n", i + 1, accuracy->scene_count, scene->name);
        bool ok = gn_accuracy_scene_commit(scene, m.error, sizeof m.error) && measure_scene(&m, driver);
        gn_built_scene_destroy(m.plain);
        gn_accuracy_scene_finish(scene);
        gn_arena_finish(&arena);
        if (!ok) {
            snprintf(shared->error, sizeof shared->error, "%s", m.error);
            return;
        }
    }
    gn_device_destroy(device);
    shared->done = true;
}

bool gn_accuracy_driver_sum(const struct gn_accuracy_driver *driver, uint32_t scene, uint32_t setting,
                            struct gn_accuracy_driver_point *out)
{
    double time = 0, build = 0, size = 0, update = 0;
    double medians[256];
    uint32_t count = 0, updates = 0, hit = 0;
    *out = (struct gn_accuracy_driver_point){.update = (double)NAN, .t_error_max = (double)NAN, .t_error_median = (double)NAN};
    for (size_t i = 0; i < driver->row_count; i++) {
        const struct gn_accuracy_driver_row *row = &driver->rows[i], *plain = NULL, *rebuilt = NULL;
        if (row->setting != setting || (scene != GN_ACCURACY_ALL_SCENES && row->scene != scene))
            continue;
        for (size_t k = 0; k < driver->row_count; k++) {
            const struct gn_accuracy_driver_row *other = &driver->rows[k];
            if (other->scene != row->scene || other->aim != row->aim)
                continue;
            if (other->setting == GN_ACCURACY_SETTING_PLAIN)
                plain = other;
            if (other->setting == GN_ACCURACY_SETTING_REBUILT)
                rebuilt = other;
        }
        count++;
        time -= log(row->ratio_to_plain);
        build += log(row->build_ratio);
        size += log((double)row->bytes / (double)plain->bytes);
        if (rebuilt && row->update_seconds > 0 && rebuilt->update_seconds > 0) {
            update += log(row->update_seconds / rebuilt->update_seconds);
            updates++;
        }
        out->rays += row->rays;
        out->gross += row->lost + row->invented + row->other;
        out->wrong += row->lost + row->invented + row->other + row->neighbour;
        out->left += row->class_counts[GN_REF_LEAK] + row->class_counts[GN_REF_DOUBLE_HIT] + row->class_counts[GN_REF_WRONG];
        if (row->hits) {
            out->t_error_max = fmax(out->t_error_max, row->t_error_max);
            if (hit < 256)
                medians[hit++] = row->t_error_median;
        }
    }
    if (!count)
        return false;
    out->time = exp(time / count);
    out->build = exp(build / count);
    out->size = exp(size / count);
    if (updates)
        out->update = exp(update / updates);
    if (hit)
        out->t_error_median = gn_median(medians, hit);
    return true;
}

bool gn_accuracy_driver_measure(const struct gn_accuracy *accuracy, const char *icd, struct gn_arena *arena,
                                struct gn_accuracy_driver *out, int *out_exit_status, char *out_error, size_t error_size)
{
    size_t most = (size_t)accuracy->scene_count * GN_ACCURACY_SETTING_COUNT * GN_AIM_COUNT;
    size_t size = sizeof(struct shared) + most * sizeof(struct gn_accuracy_driver_row);
    struct shared *shared = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    bool ok = false;
    int status = 0;
    *out_exit_status = 3;
    if (shared == MAP_FAILED) {
        snprintf(out_error, error_size, "out of memory for the driver's measurements");
        return false;
    }
    shared->driver.icd = icd;
    shared->driver.rows = shared->rows;
    fflush(NULL);
    pid_t pid = fork();
    if (pid == 0) {
        measure_all(accuracy, shared);
        _exit(0);
    }
    if (pid < 0) {
        snprintf(out_error, error_size, "cannot start a process: %s", strerror(errno));
        goto done;
    }
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
    }
    if (shared->done && WIFEXITED(status)) {
        *out = shared->driver;
        out->rows = GN_NEW(arena, struct gn_accuracy_driver_row, most);
        memcpy(out->rows, shared->rows, out->row_count * sizeof *out->rows);
        ok = true;
    } else if (WIFSIGNALED(status)) {
        snprintf(out_error, error_size, "the driver crashed on scene %s: signal %d (%s)",
                 shared->stage[0] ? shared->stage : "(none yet)", WTERMSIG(status), strsignal(WTERMSIG(status)));
    } else {
        *out_exit_status = shared->exit_status;
        snprintf(out_error, error_size, "%s", shared->error[0] ? shared->error : "the driver ended the process");
    }
done:
    munmap(shared, size);
    return ok;
}
