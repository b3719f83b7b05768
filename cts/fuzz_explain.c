/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A scene file run again and explained: what the driver answers, and of each primitive every decision with its exact
 * value, worked out in rational numbers here and independently of the reference.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <gmp.h>

#include "cts/describe.h"
#include "cts/fuzz.h"
#include "cts/results.h"

enum { MOST_SHOWN = 24 };

typedef mpq_t vector[3];

static void vector_init(vector v)
{
    for (int a = 0; a < 3; a++)
        mpq_init(v[a]);
}

static void vector_clear(vector v)
{
    for (int a = 0; a < 3; a++)
        mpq_clear(v[a]);
}

static void vector_subtract(vector out, vector a, vector b)
{
    for (int i = 0; i < 3; i++)
        mpq_sub(out[i], a[i], b[i]);
}

/* out = m (3 rows of 4) applied to v; `scratch` is any number. */
static void vector_transform(vector out, const float m[12], vector v, mpq_t scratch)
{
    vector from;
    vector_init(from);
    for (int a = 0; a < 3; a++)
        mpq_set(from[a], v[a]);
    for (int r = 0; r < 3; r++) {
        mpq_set_d(out[r], (double)m[4 * r + 3]);
        for (int c = 0; c < 3; c++) {
            mpq_set_d(scratch, (double)m[4 * r + c]);
            mpq_mul(scratch, scratch, from[c]);
            mpq_add(out[r], out[r], scratch);
        }
    }
    vector_clear(from);
}

/* out = a . (b x c) */
static void triple(mpq_t out, vector a, vector b, vector c)
{
    mpq_t x, y;
    mpq_inits(x, y, NULL);
    mpq_set_ui(out, 0, 1);
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        mpq_mul(x, b[j], c[k]);
        mpq_mul(y, b[k], c[j]);
        mpq_sub(x, x, y);
        mpq_mul(x, x, a[i]);
        mpq_add(out, out, x);
    }
    mpq_clears(x, y, NULL);
}

/* The number as a fraction where that is short, and as a decimal. */
static void print_exact(const char *name, const mpq_t value)
{
    char text[64] = "";
    if (mpz_sizeinbase(mpq_numref(value), 10) < 20 && mpz_sizeinbase(mpq_denref(value), 10) < 20)
        gmp_snprintf(text, sizeof text, "%Qd", value);
    printf("      %-28s %c  %.17g%s%s\n", name, mpq_sgn(value) < 0 ? '-' : mpq_sgn(value) > 0 ? '+' : '0',
           mpq_get_d(value), *text ? " = " : "", text);
}

static void explain_triangle(const struct gn_cts_ray *ray, const struct gn_cts_instance *instance,
                             const struct gn_cts_geometry *geometry, const double (*positions)[3], double divisor,
                             uint32_t primitive)
{
    vector corner[3], direction, origin;
    mpq_t scratch, weight[3], sum, t, limit, m[3][3];
    mpq_inits(scratch, sum, t, limit, NULL);
    vector_init(direction);
    vector_init(origin);
    for (int c = 0; c < 3; c++) {
        mpq_init(weight[c]);
        vector_init(corner[c]);
    }
    const char *unusual = NULL;
    for (int c = 0; c < 3; c++) {
        const double *p = positions[geometry->triangles[primitive][c]];
        printf("      corner %d: %.9g %.9g %.9g\n", c, p[0] / divisor, p[1] / divisor, p[2] / divisor);
        if (isnan(p[0]))
            unusual = "inactive: the first component of a corner is NaN";
        else if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2]))
            unusual = "a corner is not finite";
    }
    if (unusual) {
        printf("      %s; no ray meets it\n", unusual);
        goto done;
    }
    for (int a = 0; a < 3; a++) {
        mpq_set_d(direction[a], (double)ray->ray.direction[a]);
        mpq_set_d(origin[a], (double)ray->ray.origin[a]);
    }
    mpq_set_d(limit, divisor);
    for (int c = 0; c < 3; c++) {
        for (int a = 0; a < 3; a++) {
            mpq_set_d(corner[c][a], positions[geometry->triangles[primitive][c]][a]);
            mpq_div(corner[c][a], corner[c][a], limit);
        }
        if (geometry->transform)
            vector_transform(corner[c], geometry->transform, corner[c], scratch);
        vector_transform(corner[c], instance->transform, corner[c], scratch);
        vector_subtract(corner[c], corner[c], origin);
    }
    mpq_set_ui(sum, 0, 1);
    int least = 1, most = -1;
    for (int c = 0; c < 3; c++) {
        static const char *const names[] = {"inside of the edge 1-2", "inside of the edge 2-0", "inside of the edge 0-1"};
        triple(weight[c], direction, corner[(c + 1) % 3], corner[(c + 2) % 3]);
        print_exact(names[c], weight[c]);
        mpq_add(sum, sum, weight[c]);
        least = mpq_sgn(weight[c]) < least ? mpq_sgn(weight[c]) : least;
        most = mpq_sgn(weight[c]) > most ? mpq_sgn(weight[c]) : most;
    }
    print_exact("their sum, d . n", sum);
    if (mpq_sgn(sum) == 0) {
        printf("      edge-on or degenerate: never met\n");
        goto done;
    }
    if (least < 0 && most > 0) {
        printf("      signs differ: the line passes by\n");
        goto done;
    }
    printf("      no two signs differ: the line meets it%s\n",
           mpq_sgn(weight[0]) && mpq_sgn(weight[1]) && mpq_sgn(weight[2]) ? "" : ", exactly on its boundary");
    triple(t, corner[0], corner[1], corner[2]);
    mpq_div(t, t, sum);
    print_exact("t", t);
    mpq_set_d(limit, (double)ray->ray.tmin);
    mpq_sub(scratch, t, limit);
    print_exact("t - tmin, to be above 0", scratch);
    if (isfinite(ray->ray.tmax)) {
        mpq_set_d(limit, (double)ray->ray.tmax);
        mpq_sub(scratch, limit, t);
        print_exact("tmax - t, to be above 0", scratch);
    }
    for (int c = 1; c < 3; c++) {
        mpq_div(scratch, weight[c], sum);
        print_exact(c == 1 ? "weight of corner 1" : "weight of corner 2", scratch);
    }
    for (int i = 0; i < 9; i++) {
        mpq_init(m[i / 3][i % 3]);
        mpq_set_d(m[i / 3][i % 3], (double)instance->transform[i / 3 * 4 + i % 3]);
    }
    triple(scratch, m[0], m[1], m[2]);
    print_exact("determinant of the instance", scratch);
    const bool flip = instance->flags & VK_GEOMETRY_INSTANCE_TRIANGLE_FLIP_FACING_BIT_KHR;
    const bool front = (mpq_sgn(scratch) * mpq_sgn(sum) < 0) != flip;
    printf("      facing: %s, as d . n and the determinant have %s signs%s\n", front ? "front" : "back",
           mpq_sgn(scratch) * mpq_sgn(sum) < 0 ? "different" : "the same", flip ? ", and FLIP_FACING turns it" : "");
    const bool disabled = instance->flags & VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR;
    if (ray->ray.flags & (front ? GN_REF_RAY_CULL_FRONT_FACING : GN_REF_RAY_CULL_BACK_FACING))
        printf("      culled by facing%s\n", disabled ? ", but the instance disables that" : "");
    for (int i = 0; i < 9; i++)
        mpq_clear(m[i / 3][i % 3]);
done:
    mpq_clears(scratch, sum, t, limit, NULL);
    vector_clear(direction);
    vector_clear(origin);
    for (int c = 0; c < 3; c++) {
        mpq_clear(weight[c]);
        vector_clear(corner[c]);
    }
}

static void explain_box(const struct gn_cts_geometry *geometry, uint32_t primitive)
{
    const float *box = geometry->aabbs[primitive];
    printf("      from %.9g %.9g %.9g to %.9g %.9g %.9g%s\n", (double)box[0], (double)box[1], (double)box[2],
           (double)box[3], (double)box[4], (double)box[5], isnan(box[0]) ? ": inactive" : "");
}

static void explain_primitives(const struct gn_fuzz_trial *trial, const struct gn_cts_ray *ray, struct gn_arena *arena)
{
    const struct gn_cts_scene *scene = &trial->scene;
    uint32_t shown = 0;
    printf("\n3. Each primitive, exactly (signs and values; d is the ray's direction, n the normal)\n");
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct gn_cts_instance *instance = &scene->instances[i];
        if (instance->blas == GN_CTS_NO_BLAS) {
            printf("   instance %u: a null reference, inactive\n", i);
            continue;
        }
        const bool admitted = instance->mask & ray->ray.cull_mask & 0xFF;
        printf("   instance %u: BLAS %u, mask 0x%02X and 0x%02X %s, flags 0x%X\n", i, instance->blas, instance->mask,
               ray->ray.cull_mask & 0xFF, admitted ? "meet" : "have no bit in common: not visible", instance->flags);
        const struct gn_cts_blas *blas = &scene->blases[instance->blas];
        for (uint32_t g = 0; g < blas->geometry_count && admitted; g++) {
            const struct gn_cts_geometry *geometry = &blas->geometries[g];
            const bool triangles = geometry->type == GN_REF_TRIANGLES;
            const double(*positions)[3] = NULL;
            double divisor = 1;
            if (triangles && !gn_geometry_decoded_positions(geometry, arena, &positions, &divisor))
                continue;
            const uint32_t count = triangles ? geometry->triangle_count : geometry->aabb_count;
            for (uint32_t p = 0; p < count && shown < MOST_SHOWN; p++, shown++) {
                printf("    geometry %u (flags 0x%X), %s %u\n", g, geometry->flags, triangles ? "triangle" : "box", p);
                if (triangles)
                    explain_triangle(ray, instance, geometry, positions, divisor, p);
                else
                    explain_box(geometry, p);
            }
        }
    }
    if (shown == MOST_SHOWN)
        printf("    (and more)\n");
}

static void print_matrix(const char *name, const float *found, const double *exact, const double *sizes)
{
    printf("   %s\n      %-17s%-17s%-17s%-17s%s\n", name, "driver", "", "", "", exact ? "exact, then the units of 2^-24 between" : "");
    for (int r = 0; r < 3; r++) {
        printf("     ");
        for (int c = 0; c < 4; c++)
            printf(" %-16.9g", (double)found[4 * r + c]);
        printf("\n");
        for (int c = 0; c < 4 && exact; c++) {
            const double off = fabs((double)found[4 * r + c] - exact[4 * r + c]);
            printf("      column %d: %.17g  %.4g\n", c, exact[4 * r + c],
                   sizes && sizes[4 * r + c] > 0 ? off / (sizes[4 * r + c] * 0x1p-24) : off);
        }
    }
}

/* What a hit reads back, beside what it should. */
static void explain_read_back(struct gn_case_run *run, const struct gn_fuzz_trial *trial, struct gn_device *device,
                              const struct gn_cts_ray *ray)
{
    struct gn_built_scene *built = NULL;
    struct gn_cts_answers answers = {0};
    struct gn_ref_scene *reference = NULL;
    struct gn_ref_judge *judge = NULL;
    struct gn_ref_object_ray exact;
    const struct gn_cts_route route = run->route;
    if (gn_scene_build(device, &trial->scene, &built) != GN_DEVICE_OK ||
        gn_scene_trace(built, &route, trial->program, ray, 1, &run->arena, &answers) != GN_DEVICE_OK)
        goto done;
    const struct gn_ref_answer *answer = &answers.committed[0];
    reference = gn_case_reference(run, &trial->scene);
    judge = reference ? gn_ref_judge_create(reference) : NULL;
    if (answers.details && answer->kind != GN_REF_ANSWER_NONE && judge &&
        gn_ref_judge_object_ray(judge, &ray->ray, answer->instance, &exact)) {
        const struct gn_cts_detail *detail = &answers.details[0];
        printf("\n4. What the hit on instance %u reads back\n", answer->instance);
        print_matrix("world from object", detail->world_from_object, NULL, NULL);
        print_matrix("object from world", detail->object_from_world, exact.object_from_world,
                     exact.size_object_from_world);
        for (int a = 0; a < 3; a++)
            printf("   object-space ray, component %d: origin %.9g (exact %.17g), direction %.9g (exact %.17g)\n", a,
                   (double)detail->object_origin[a], exact.origin[a], (double)detail->object_direction[a],
                   exact.direction[a]);
    }
    double vertices[3][3], sizes[3][3];
    bool copied;
    if (answers.positions && answer->kind == GN_REF_ANSWER_TRIANGLE && judge &&
        gn_ref_judge_vertices(judge, answer->instance, answer->geometry, answer->primitive, vertices, sizes, &copied)) {
        printf("\n4. The positions that the hit reads back\n");
        for (int c = 0; c < 3; c++)
            for (int a = 0; a < 3; a++)
                printf("   corner %d component %d: driver %.9g, exact %.17g\n", c, a,
                       (double)answers.positions[0][3 * c + a], vertices[c][a]);
    }
done:
    gn_ref_judge_destroy(judge);
    gn_ref_scene_destroy(reference);
    gn_built_scene_destroy(built);
}

/* How a geometry is given to the driver, where that is not the plainest way. */
static void print_given(uint32_t g, const struct gn_cts_geometry *geometry)
{
    const struct {
        const char *name;
        uint32_t value;
    } numbers[] = {
        {"firstVertex", geometry->first_vertex},
        {"primitiveOffset", geometry->primitive_offset},
        {"vertex stride", geometry->vertex_stride},
        {"box stride", geometry->aabb_stride},
        {"bytes before the vertices", geometry->vertex_offset},
        {"bytes before the indices or boxes", geometry->data_offset},
        {"transformOffset", geometry->transform ? geometry->transform_offset : 0},
    };
    const bool triangles = geometry->type == GN_REF_TRIANGLES;
    const uint32_t count = triangles ? geometry->triangle_count : geometry->aabb_count;
    printf("   geometry %u: %u %s", g, count, triangles ? (count == 1 ? "triangle" : "triangles") : count == 1 ? "box" : "boxes");
    if (triangles && geometry->vertex_format)
        printf(", VkFormat %d", (int)geometry->vertex_format);
    if (triangles)
        printf(", %s",
               geometry->index_none                               ? "no indices"
               : geometry->index_type == VK_INDEX_TYPE_UINT8_KHR ? "8-bit indices"
               : geometry->index_uint32                           ? "32-bit indices"
                                                                  : "16-bit indices where they fit");
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++)
        if (numbers[i].value)
            printf(", %s %u", numbers[i].name, numbers[i].value);
    if (geometry->transform)
        printf(", with a transform");
    if (geometry->initial_positions || geometry->initial_aabbs || geometry->initial_transform)
        printf(", first built from other data");
    printf("\n");
}

/* The kind is named by what the whole scene needed; what was reduced may need less. */
static void print_left_behind(const struct gn_fuzz_file *file)
{
    struct gn_arena arena = {0};
    const char *separator = "its name has what the whole scene needed; reduced, it is without ";
    for (uint32_t i = 0; i < GN_FUZZ_INGREDIENT_COUNT; i++) {
        struct gn_fuzz_trial without;
        const char *name = gn_fuzz_ingredient_name((enum gn_fuzz_ingredient)i), *place = strchr(file->kind, '.');
        const size_t length = strlen(name);
        /* A word of the list behind the dot. */
        while (place && (place = strstr(place + 1, name)) && place[length] && place[length] != '+') {
        }
        if (!place || gn_fuzz_without(&arena, &file->trial, (enum gn_fuzz_ingredient)i, &without))
            continue;
        printf("%s%s", separator, name);
        separator = ", ";
    }
    if (separator[0] == ',')
        printf("\n");
    gn_arena_finish(&arena);
}

int gn_fuzz_explain(const struct gn_fuzz_file *file, struct gn_device *device)
{
    static const char *const steps[] = {"", "refit", "refit into another", "rebuild", "compact", "clone", "serialize"};
    const struct gn_fuzz_trial *trial = &file->trial;
    const struct gn_device_info *info = gn_device_info(device);
    struct gn_case_run run;
    char text[512];
    printf("%s: trial %" PRIu64 " of seed %" PRIu64 ", reduced\n", file->kind, file->number, file->seed);
    printf("recorded on %s: %s\nnow on %s, %s %s, through %s\n", file->device, file->message, info->name,
           info->driver_name, info->driver_info, gn_case_backend_name(trial->backend));
    print_left_behind(file);
    fflush(stdout);
    for (uint32_t b = 0; b < trial->scene.blas_count; b++) {
        const struct gn_cts_blas *blas = &trial->scene.blases[b];
        printf("BLAS %u: %u geometr%s, build flags 0x%X", b, blas->geometry_count, blas->geometry_count == 1 ? "y" : "ies",
               blas->build_flags);
        for (uint32_t s = 0; s < GN_CTS_MAX_STEPS && blas->steps[s] != GN_CTS_STEP_END; s++)
            printf(", then %s", steps[blas->steps[s]]);
        printf("\n");
        for (uint32_t g = 0; g < blas->geometry_count; g++)
            print_given(g, &blas->geometries[g]);
    }
    printf("TLAS: %u instance%s, build flags 0x%X", trial->scene.instance_count, trial->scene.instance_count == 1 ? "" : "s",
           trial->scene.tlas_build_flags);
    for (uint32_t s = 0; s < GN_CTS_MAX_STEPS && trial->scene.tlas_steps[s] != GN_CTS_STEP_END; s++)
        printf(", then %s", steps[trial->scene.tlas_steps[s]]);
    printf("\n");
    gn_fuzz_execute(trial, device, &run);
    const struct gn_case_result *result = &run.result;
    const bool failed = gn_case_status_is_failure(result->status);
    const struct gn_cts_ray *ray = result->has_offender ? &result->offender.ray : &trial->rays[0];
    printf("\n1. The ray%s\n   origin    %.9g %.9g %.9g\n   direction %.9g %.9g %.9g\n   from %.9g to %.9g, flags 0x%X: %s\n",
           trial->ray_count > 1 ? " that is answered worst" : "", (double)ray->ray.origin[0], (double)ray->ray.origin[1],
           (double)ray->ray.origin[2], (double)ray->ray.direction[0], (double)ray->ray.direction[1],
           (double)ray->ray.direction[2], (double)ray->ray.tmin, (double)ray->ray.tmax, ray->ray.flags,
           gn_describe_ray_flags(ray->ray.flags, text, sizeof text));
    if (result->has_offender) {
        printf("\n2. The driver's answer\n   %s\n", gn_describe_answer(&result->offender.answer, text, sizeof text));
        printf("   The right answer\n   %s\n", gn_describe_ideal(&result->offender.verdict, text, sizeof text));
    }
    explain_primitives(trial, ray, &run.arena);
    if (trial->program == GN_CTS_DETAIL || trial->program == GN_CTS_POSITIONS)
        explain_read_back(&run, trial, device, ray);
    printf("\n5. The verdict: %s%s%s\n", failed ? "it still fails" : "it does not fail", *result->message ? ": " : "",
           result->message);
    const int exit_status = result->status == GN_CASE_ERROR ? 3 : result->status == GN_CASE_SKIP ? 4 : failed;
    gn_case_run_finish(&run);
    return fflush(stdout) == 0 ? exit_status : 3;
}
