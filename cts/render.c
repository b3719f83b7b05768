/* SPDX-License-Identifier: Apache-2.0 */
/* Wave by wave: all rays of one depth are traced at once, what they meet is shaded, and new rays make the next wave. */
#include "cts/render.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "cts/generate.h"
#include "cts/progress.h"
#include "cts/table.h"

enum { MOST_HITS = 64, SQUARES = 8 };

/* How far a new ray begins above the surface, as the scenes' unit is about 1. */
#define LIFT 1e-3
#define FARTHEST 1e4f

static const float pink[3] = {0.95f, 0.18f, 0.95f};

const char *gn_render_effect_name(enum gn_render_effect effect)
{
    static const char *const names[] = {"hard-shadows", "soft-shadows", "reflection", "refraction",
                                        "dispersion",   "transparency", "procedural"};
    return names[effect];
}

const char *gn_render_effect_counted(enum gn_render_effect effect)
{
    static const char *const names[] = {"shadow rays to points", "shadow rays to lights with extent", "reflected rays",
                                        "refracted rays",        "rays of one colour",                "candidates asked about",
                                        "spheres worked out"};
    return names[effect];
}

/* A ray on its way, and what becomes of the light it finds. */
struct path {
    double origin[3], direction[3];
    float weight[3];
    uint32_t pixel;
};

struct wave {
    struct path *list;
    size_t count, capacity;
};

/* A ray to a light: several of them decide about one contribution. */
struct shadow {
    double origin[3], direction[3], distance;
    uint32_t owner; /* in `lit` */
};
struct lit {
    float light[3]; /* what arrives when nothing is in the way */
    uint32_t pixel, samples, open;
};

struct hit {
    bool found;
    uint32_t instance, geometry, primitive;
    double t, beta, gamma;
    bool sphere;
};

struct painter {
    const struct gn_render_scene *scene;
    const struct gn_render_options *options;
    struct gn_render_plan plan;
    struct gn_render_result *result;
    struct gn_arena *arena;
    bool lists; /* all candidates are asked for: something has holes or is a sphere, or that is forced */
    /* One of the two: */
    struct gn_case_run *run;
    struct gn_ref_scene *reference;
    struct gn_built_scene *built;
    const struct gn_cts_scene *traced; /* the scene with the record offsets that the route needs */
    bool judged;
};

static bool active(const struct painter *painter, enum gn_render_effect effect)
{
    return (painter->plan.called | painter->options->forced) >> effect & 1;
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void normalize(double v[3])
{
    const double length = sqrt(dot(v, v));
    for (int i = 0; i < 3 && length > 0; i++)
        v[i] /= length;
}

static void along(const double origin[3], const double direction[3], double t, double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = origin[i] + t * direction[i];
}

void gn_render_plan(const struct gn_render_scene *scene, struct gn_render_plan *out)
{
    static const char *const missing[GN_RENDER_EFFECT_COUNT] = {
        "no light is a point",      "no light has extent",  "nothing is mirrored or of glass", "nothing is of glass",
        "no glass parts colours",   "nothing has holes",    "there are no spheres"};
    memset(out, 0, sizeof *out);
    for (int e = 0; e < GN_RENDER_EFFECT_COUNT; e++)
        snprintf(out->why[e], sizeof out->why[e], "%s", missing[e]);
#define CALL(effect, ...)                                                                                    \
    (out->called |= 1u << (effect), snprintf(out->why[effect], sizeof out->why[effect], __VA_ARGS__))
    for (uint32_t l = 0; l < scene->light_count; l++) {
        if (scene->lights[l].radius > 0)
            CALL(GN_RENDER_SOFT_SHADOWS, "light %u has a radius of %g", l, scene->lights[l].radius);
        else
            CALL(GN_RENDER_HARD_SHADOWS, "light %u is a point", l);
    }
    for (uint32_t i = 0; i < scene->scene.instance_count; i++) {
        const uint32_t number = scene->scene.instances[i].custom_index;
        const struct gn_render_material *material = &scene->materials[number];
        if (material->mirror > 0)
            CALL(GN_RENDER_REFLECTION, "instance %u reflects %g of the light", i, (double)material->mirror);
        if (material->glass) {
            CALL(GN_RENDER_REFLECTION, "instance %u is of glass", i);
            CALL(GN_RENDER_REFRACTION, "instance %u is of glass, index %g", i, (double)material->index);
        }
        if (material->glass && material->spread > 0)
            CALL(GN_RENDER_DISPERSION, "the glass of instance %u parts colours by %g", i, (double)material->spread);
        if (material->holes)
            CALL(GN_RENDER_TRANSPARENCY, "instance %u has holes", i);
        const struct gn_cts_blas *blas = &scene->scene.blases[scene->scene.instances[i].blas];
        if (blas->geometry_count && blas->geometries[0].type == GN_REF_AABBS)
            CALL(GN_RENDER_PROCEDURAL, "instance %u is made of spheres", i);
    }
#undef CALL
}

static const struct gn_cts_geometry *geometry_of(const struct painter *painter, uint32_t instance, uint32_t geometry)
{
    const struct gn_cts_scene *scene = &painter->scene->scene;
    return &scene->blases[scene->instances[instance].blas].geometries[geometry];
}

static const struct gn_render_material *material_of(const struct painter *painter, uint32_t instance)
{
    return &painter->scene->materials[painter->scene->scene.instances[instance].custom_index];
}

/* Where a ray meets the sphere inside of a box, the nearer side that lies ahead; false when it does not. */
static bool sphere_meet(const struct painter *painter, const struct gn_ref_ray *ray, uint32_t instance,
                        uint32_t geometry, uint32_t primitive, double *out_t)
{
    const float *m = painter->scene->scene.instances[instance].transform;
    const float *box = geometry_of(painter, instance, geometry)->aabbs[primitive];
    double from[3], origin[3], toward[3], direction[3], radius = 0;
    for (int a = 0; a < 3; a++) {
        from[a] = (double)ray->origin[a] - (double)m[4 * a + 3];
        toward[a] = (double)ray->direction[a];
    }
    gn_transform_inverse_apply(m, from, false, origin);
    gn_transform_inverse_apply(m, toward, false, direction);
    for (int a = 0; a < 3; a++) {
        origin[a] -= ((double)box[a] + (double)box[a + 3]) / 2;
        radius = fmax(radius, ((double)box[a + 3] - (double)box[a]) / 2);
    }
    const double qa = dot(direction, direction), qb = dot(origin, direction), qc = dot(origin, origin) - radius * radius;
    const double root = qb * qb - qa * qc;
    if (root < 0)
        return false;
    const double t[2] = {(-qb - sqrt(root)) / qa, (-qb + sqrt(root)) / qa};
    for (int i = 0; i < 2; i++)
        if (t[i] > (double)ray->tmin && t[i] < (double)ray->tmax) {
            *out_t = t[i];
            return true;
        }
    return false;
}

/* Squares by the weights of the second and third corner. */
static bool in_hole(double beta, double gamma)
{
    return (((int)(SQUARES * beta) + (int)(SQUARES * gamma)) & 1) != 0;
}

/* Takes a candidate into account as the shaders of its material would. */
static void candidate(struct painter *painter, const struct gn_ref_ray *ray, const struct hit *one, struct hit *nearest)
{
    struct hit hit = *one;
    if (hit.sphere) {
        painter->result->rays[GN_RENDER_PROCEDURAL]++;
        if (!sphere_meet(painter, ray, hit.instance, hit.geometry, hit.primitive, &hit.t))
            return;
    } else if (!(geometry_of(painter, hit.instance, hit.geometry)->flags & VK_GEOMETRY_OPAQUE_BIT_KHR) ||
               painter->options->forced >> GN_RENDER_TRANSPARENCY & 1) {
        painter->result->rays[GN_RENDER_TRANSPARENCY]++;
        if (material_of(painter, hit.instance)->holes && in_hole(hit.beta, hit.gamma))
            return;
    }
    if (!nearest->found || hit.t < nearest->t)
        *nearest = hit;
}

static struct hit hit_of_answer(const struct gn_ref_answer *answer)
{
    return (struct hit){answer->kind != GN_REF_ANSWER_NONE, answer->instance, answer->geometry, answer->primitive,
                        (double)answer->t, (double)answer->barycentrics[0], (double)answer->barycentrics[1],
                        answer->kind == GN_REF_ANSWER_GENERATED};
}

static bool trace_driver(struct painter *painter, const struct gn_cts_ray *rays, uint32_t count, struct hit *out)
{
    struct gn_case_run *run = painter->run;
    struct gn_cts_answers answers = {0};
    const enum gn_cts_program program = painter->lists ? GN_CTS_CANDIDATES : GN_CTS_COMMITTED;
    const enum gn_device_status status =
        gn_scene_trace(painter->built, &run->route, program, rays, count, &run->arena, &answers);
    if (status != GN_DEVICE_OK) {
        if (status == GN_DEVICE_UNSUPPORTED)
            gn_case_skip(run, "%s", gn_device_message(run->device));
        else
            gn_case_fail(run, "%s", gn_device_message(run->device));
        return false;
    }
    if (painter->judged)
        gn_case_judge(run, painter->traced, program, rays, count, painter->options->width, &answers);
    for (uint32_t i = 0; i < count; i++) {
        out[i] = hit_of_answer(&answers.committed[i]);
        const struct gn_cts_candidates *candidates = painter->lists ? &answers.candidates[i] : NULL;
        if (candidates && candidates->count > GN_CTS_MAX_CANDIDATES) {
            gn_case_skip(run, "a ray meets %u candidates, more than the %u that are recorded", candidates->count,
                         GN_CTS_MAX_CANDIDATES);
            return false;
        }
        for (uint32_t c = 0; candidates && c < candidates->count; c++) {
            const struct hit one = hit_of_answer(&candidates->list[c]);
            candidate(painter, &rays[i].ray, &one, &out[i]);
        }
    }
    return true;
}

static bool trace_reference(struct painter *painter, const struct gn_cts_ray *rays, uint32_t count, struct hit *out)
{
    struct gn_ref_hit hits[MOST_HITS];
    for (uint32_t i = 0; i < count; i++) {
        int64_t found = painter->lists
                            ? gn_ref_trace_all_exact(painter->reference, &rays[i].ray, hits, MOST_HITS)
                            : gn_ref_trace_closest_triangle_exact(painter->reference, &rays[i].ray, hits);
        if (found < 0)
            return false;
        out[i] = (struct hit){0};
        for (int64_t h = 0; h < found && h < MOST_HITS; h++) {
            const struct hit one = {true,        hits[h].instance, hits[h].geometry, hits[h].primitive, hits[h].t,
                                    hits[h].beta, hits[h].gamma,    hits[h].type == GN_REF_AABBS};
            const struct hit before = out[i];
            if (painter->lists)
                candidate(painter, &rays[i].ray, &one, &out[i]);
            else
                out[i] = one;
            /* The list is in the order of exact t, which its numbers need not keep where that is close or the same. */
            if (before.found && !before.sphere && !one.sphere)
                out[i] = before;
        }
    }
    return true;
}

/* The list of what a ray meets and the nearest of it may give t with other bits: what is shaded has the nearest f64 of the exact one. */
static void sharpen(const struct painter *painter, const struct gn_ref_ray *ray, struct hit *inout)
{
    struct gn_ref_hit hit = {.instance = inout->instance, .geometry = inout->geometry, .primitive = inout->primitive};
    if (gn_ref_hit_refine_exact(painter->reference, ray, &hit))
        inout->t = hit.t;
}

static struct gn_cts_ray ray_make(const struct painter *painter, const double origin[3], const double direction[3],
                                  double tmax)
{
    struct gn_cts_ray ray = {.ray = {.tmin = 0, .tmax = (float)tmax, .cull_mask = 0xFF},
                             .policy = {.confirm_mask = UINT32_MAX}};
    for (int a = 0; a < 3; a++) {
        ray.ray.origin[a] = (float)origin[a];
        ray.ray.direction[a] = (float)direction[a];
    }
    if (painter->options->forced >> GN_RENDER_TRANSPARENCY & 1)
        ray.ray.flags = GN_REF_RAY_NO_OPAQUE;
    return ray;
}

static bool trace(struct painter *painter, const struct gn_cts_ray *rays, uint32_t count, struct hit *out)
{
    painter->result->traced += count;
    return painter->run ? trace_driver(painter, rays, count, out) : trace_reference(painter, rays, count, out);
}

static void wave_add(struct wave *wave, const struct path *path)
{
    if (wave->count == wave->capacity) {
        wave->capacity = wave->capacity ? 2 * wave->capacity : 4096;
        wave->list = realloc(wave->list, wave->capacity * sizeof *wave->list);
        if (!wave->list)
            abort();
    }
    wave->list[wave->count++] = *path;
}

static void pixel_add(struct painter *painter, uint32_t pixel, const float weight[3], const float light[3])
{
    for (int c = 0; c < 3; c++)
        painter->result->pixels[pixel][c] += weight[c] * light[c];
}

/* The point and the unit normal, turned towards where the ray came from; *out_inside where that is the back. */
static void surface(const struct painter *painter, const struct path *path, const struct hit *hit, double point[3],
                    double normal[3], bool *out_inside)
{
    const struct gn_cts_geometry *geometry = geometry_of(painter, hit->instance, hit->geometry);
    const float *m = painter->scene->scene.instances[hit->instance].transform;
    double local[3];
    along(path->origin, path->direction, hit->t, point);
    if (hit->sphere) {
        double from[3], object[3];
        const float *box = geometry->aabbs[hit->primitive];
        for (int a = 0; a < 3; a++)
            from[a] = point[a] - (double)m[4 * a + 3];
        gn_transform_inverse_apply(m, from, false, object);
        for (int a = 0; a < 3; a++)
            local[a] = object[a] - ((double)box[a] + (double)box[a + 3]) / 2;
    } else {
        const uint32_t *corners = geometry->triangles[hit->primitive];
        double e[3], f[3];
        for (int a = 0; a < 3; a++) {
            e[a] = geometry->positions[corners[1]][a] - geometry->positions[corners[0]][a];
            f[a] = geometry->positions[corners[2]][a] - geometry->positions[corners[0]][a];
        }
        for (int a = 0; a < 3; a++)
            local[a] = e[(a + 1) % 3] * f[(a + 2) % 3] - e[(a + 2) % 3] * f[(a + 1) % 3];
    }
    gn_transform_inverse_apply(m, local, true, normal);
    normalize(normal);
    *out_inside = dot(normal, path->direction) > 0;
    for (int a = 0; a < 3 && *out_inside; a++)
        normal[a] = -normal[a];
}

/* Points on a light's disc of the same pattern for every point: a spiral. */
static void light_sample(const struct gn_render_light *light, const double toward[3], uint32_t sample, uint32_t count,
                         double out[3])
{
    double u[3] = {toward[1], -toward[0], 0}, v[3];
    if (fabs(toward[2]) > 0.9) {
        u[0] = 0;
        u[1] = toward[2];
        u[2] = -toward[1];
    }
    normalize(u);
    for (int a = 0; a < 3; a++)
        v[a] = toward[(a + 1) % 3] * u[(a + 2) % 3] - toward[(a + 2) % 3] * u[(a + 1) % 3];
    const double radius = light->radius * sqrt((sample + 0.5) / count), angle = 2.399963229728653 * sample;
    for (int a = 0; a < 3; a++)
        out[a] = light->position[a] + radius * (cos(angle) * u[a] + sin(angle) * v[a]);
}

struct lights {
    struct shadow *shadows;
    size_t shadow_count, shadow_capacity;
    struct lit *lit;
    size_t lit_count, lit_capacity;
};

static void *grown(void *list, size_t count, size_t *inout_capacity, size_t size)
{
    if (count < *inout_capacity)
        return list;
    *inout_capacity = *inout_capacity ? 2 * *inout_capacity : 4096;
    list = realloc(list, *inout_capacity * size);
    if (!list)
        abort();
    return list;
}

/* Light that the surface scatters: by the ambient, and by each light that it faces and that will be found open. */
static void shade(struct painter *painter, const struct path *path, const struct gn_render_material *material,
                  const double point[3], const double normal[3], struct lights *lights)
{
    const struct gn_render_scene *scene = painter->scene;
    float weight[3];
    double below[3]; /* on a face of a square, rounding would decide the colour */
    along(point, normal, -LIFT, below);
    const bool dark = material->checkered && ((int)floor(below[0]) + (int)floor(below[1]) + (int)floor(below[2])) & 1;
    for (int c = 0; c < 3; c++)
        weight[c] = path->weight[c] * (1 - material->mirror) * material->colour[c] * (dark ? 0.35f : 1);
    pixel_add(painter, path->pixel, weight, scene->ambient);
    for (uint32_t l = 0; l < scene->light_count; l++) {
        const struct gn_render_light *light = &scene->lights[l];
        double toward[3], from[3];
        along(point, normal, LIFT, from);
        for (int a = 0; a < 3; a++)
            toward[a] = light->position[a] - point[a];
        normalize(toward);
        const double facing = dot(normal, toward);
        /* A surface that is turned away needs no ray. */
        if (facing <= 0)
            continue;
        const bool soft = light->radius > 0 || painter->options->forced >> GN_RENDER_SOFT_SHADOWS & 1;
        const uint32_t samples = soft ? painter->options->samples : 1;
        lights->lit = grown(lights->lit, lights->lit_count, &lights->lit_capacity, sizeof *lights->lit);
        struct lit *lit = &lights->lit[lights->lit_count++];
        *lit = (struct lit){.pixel = path->pixel, .samples = samples};
        for (int c = 0; c < 3; c++)
            lit->light[c] = weight[c] * light->colour[c] * (float)facing / (float)scene->light_count;
        for (uint32_t s = 0; s < samples; s++) {
            lights->shadows =
                grown(lights->shadows, lights->shadow_count, &lights->shadow_capacity, sizeof *lights->shadows);
            struct shadow *shadow = &lights->shadows[lights->shadow_count++];
            double target[3];
            light_sample(light, toward, s, samples, target);
            memcpy(shadow->origin, from, sizeof from);
            for (int a = 0; a < 3; a++)
                shadow->direction[a] = target[a] - from[a];
            shadow->distance = sqrt(dot(shadow->direction, shadow->direction));
            normalize(shadow->direction);
            shadow->owner = (uint32_t)(lights->lit_count - 1);
            painter->result->rays[soft ? GN_RENDER_SOFT_SHADOWS : GN_RENDER_HARD_SHADOWS]++;
        }
    }
}

static bool shadows_trace(struct painter *painter, struct lights *lights)
{
    struct gn_arena arena = {0};
    struct gn_cts_ray *rays = GN_NEW(&arena, struct gn_cts_ray, lights->shadow_count);
    struct hit *hits = GN_NEW(&arena, struct hit, lights->shadow_count);
    for (size_t i = 0; i < lights->shadow_count; i++)
        rays[i] = ray_make(painter, lights->shadows[i].origin, lights->shadows[i].direction, lights->shadows[i].distance);
    const bool ok = !lights->shadow_count || trace(painter, rays, (uint32_t)lights->shadow_count, hits);
    for (size_t i = 0; i < lights->shadow_count && ok; i++)
        lights->lit[lights->shadows[i].owner].open += !hits[i].found;
    for (size_t i = 0; i < lights->lit_count && ok; i++) {
        const struct lit *lit = &lights->lit[i];
        const float share = (float)lit->open / (float)lit->samples;
        pixel_add(painter, lit->pixel, (const float[]){share, share, share}, lit->light);
    }
    lights->shadow_count = lights->lit_count = 0;
    gn_arena_finish(&arena);
    return ok;
}

/* The next ray, unless that would be too deep. */
static void spawn(struct painter *painter, struct wave *next, uint32_t depth, const struct path *path,
                  const double point[3], const double normal[3], double side, const double direction[3],
                  const float weight[3], enum gn_render_effect effect)
{
    if (depth + 1 >= painter->options->depth) {
        painter->result->pink++;
        pixel_add(painter, path->pixel, weight, pink);
        return;
    }
    struct path ray = {.pixel = path->pixel};
    along(point, normal, side * LIFT, ray.origin);
    memcpy(ray.direction, direction, sizeof ray.direction);
    memcpy(ray.weight, weight, sizeof ray.weight);
    painter->result->rays[effect]++;
    wave_add(next, &ray);
}

/* Schlick's share of the light that glass reflects; 1 where nothing is refracted. */
static double reflected_share(double cosine, double eta, double *out_root)
{
    const double sine2 = eta * eta * (1 - cosine * cosine), zero = (1 - eta) / (1 + eta);
    if (sine2 > 1)
        return 1;
    *out_root = sqrt(1 - sine2);
    const double away = 1 - (eta > 1 ? *out_root : cosine);
    return zero * zero + (1 - zero * zero) * away * away * away * away * away;
}

static void glass(struct painter *painter, struct wave *next, uint32_t depth, const struct path *path,
                  const struct gn_render_material *material, const double point[3], const double normal[3],
                  const double mirrored[3], bool inside)
{
    const bool parted = material->glass && active(painter, GN_RENDER_DISPERSION) &&
                        (material->spread > 0 || painter->options->forced >> GN_RENDER_DISPERSION & 1);
    const double cosine = -dot(path->direction, normal);
    for (int c = 0; c < (parted ? 3 : 1); c++) {
        const double index = (double)material->index + (parted ? (double)material->spread * (c - 1) / 2 : 0);
        const double eta = inside ? index : 1 / index;
        double root = 0, direction[3];
        const double share = material->glass ? reflected_share(cosine, eta, &root) : 1;
        float through[3], back[3];
        for (int k = 0; k < 3; k++) {
            const float all = !parted || k == c ? path->weight[k] * (material->glass ? material->colour[k] : 0) : 0;
            through[k] = all * (float)(1 - share);
            back[k] = all * (float)share;
        }
        for (int a = 0; a < 3; a++)
            direction[a] = eta * path->direction[a] + (eta * cosine - root) * normal[a];
        spawn(painter, next, depth, path, point, normal, 1, mirrored, back, GN_RENDER_REFLECTION);
        if (share < 1 || !material->glass) {
            /* A forced ray through what is no glass goes straight on. */
            spawn(painter, next, depth, path, point, normal, -1, material->glass ? direction : path->direction, through,
                  GN_RENDER_REFRACTION);
            painter->result->rays[GN_RENDER_DISPERSION] += parted;
        }
    }
}

static void scatter(struct painter *painter, struct wave *next, uint32_t depth, const struct path *path,
                    const struct hit *hit, struct lights *lights)
{
    const struct gn_render_material *material = material_of(painter, hit->instance);
    const uint32_t forced = painter->options->forced;
    double point[3], normal[3], mirrored[3];
    bool inside;
    /* A ray that carries nothing is traced where it is forced, and goes no further. */
    if (path->weight[0] == 0 && path->weight[1] == 0 && path->weight[2] == 0)
        return;
    surface(painter, path, hit, point, normal, &inside);
    const double across = dot(path->direction, normal);
    for (int a = 0; a < 3; a++)
        mirrored[a] = path->direction[a] - 2 * across * normal[a];
    if (!material->glass)
        shade(painter, path, material, point, normal, lights);
    if (material->glass) {
        glass(painter, next, depth, path, material, point, normal, mirrored, inside);
        return;
    }
    if (forced >> GN_RENDER_REFRACTION & 1 && depth + 1 < painter->options->depth)
        spawn(painter, next, depth, path, point, normal, -1, path->direction, (const float[]){0, 0, 0},
              GN_RENDER_REFRACTION);
    if (material->mirror > 0 || (forced >> GN_RENDER_REFLECTION & 1 && depth + 1 < painter->options->depth)) {
        float weight[3];
        for (int c = 0; c < 3; c++)
            weight[c] = path->weight[c] * material->mirror;
        spawn(painter, next, depth, path, point, normal, 1, mirrored, weight, GN_RENDER_REFLECTION);
    }
}

static void sky(const struct gn_render_scene *scene, const double direction[3], float out[3])
{
    const double up = direction[2] / sqrt(dot(direction, direction));
    for (int c = 0; c < 3; c++)
        out[c] = scene->sky_low[c] + (scene->sky_high[c] - scene->sky_low[c]) * (float)(up > 0 ? up : 0);
}

static void eye_rays(struct painter *painter, struct wave *wave)
{
    const struct gn_render_scene *scene = painter->scene;
    const struct gn_render_options *options = painter->options;
    double forward[3], right[3], up[3];
    for (int a = 0; a < 3; a++)
        forward[a] = scene->at[a] - scene->eye[a];
    normalize(forward);
    right[0] = forward[1];
    right[1] = -forward[0];
    right[2] = 0;
    normalize(right);
    for (int a = 0; a < 3; a++)
        up[a] = right[(a + 1) % 3] * forward[(a + 2) % 3] - right[(a + 2) % 3] * forward[(a + 1) % 3];
    const double high = tan(scene->field * 3.14159265358979323846 / 360), wide = high * options->width / options->height;
    for (uint32_t p = 0; p < options->width * options->height; p++) {
        /* Pixel centres, the first row on top. */
        const double x = 2 * (p % options->width + 0.5) / options->width - 1;
        const double y = 1 - 2 * (p / options->width + 0.5) / options->height;
        struct path path = {.weight = {1, 1, 1}, .pixel = p};
        for (int a = 0; a < 3; a++) {
            path.origin[a] = scene->eye[a];
            path.direction[a] = forward[a] + x * wide * right[a] + y * high * up[a];
        }
        normalize(path.direction);
        wave_add(wave, &path);
    }
}

static bool paint(struct painter *painter)
{
    struct gn_render_result *result = painter->result;
    struct wave wave = {0}, next = {0};
    struct lights lights = {0};
    bool ok = true;
    eye_rays(painter, &wave);
    result->primary = wave.count;
    for (size_t i = 0; i < wave.count && painter->options->depth == 0; i++) {
        pixel_add(painter, wave.list[i].pixel, wave.list[i].weight, pink);
        result->pink++;
    }
    for (uint32_t depth = 0; depth < painter->options->depth && wave.count && ok; depth++) {
        struct gn_arena arena = {0};
        struct gn_cts_ray *rays = GN_NEW(&arena, struct gn_cts_ray, wave.count);
        struct hit *hits = GN_NEW(&arena, struct hit, wave.count);
        for (size_t i = 0; i < wave.count; i++)
            rays[i] = ray_make(painter, wave.list[i].origin, wave.list[i].direction, (double)FARTHEST);
        ok = trace(painter, rays, (uint32_t)wave.count, hits);
        for (size_t i = 0; i < wave.count && ok; i++) {
            float light[3];
            sky(painter->scene, wave.list[i].direction, light);
            if (hits[i].found && painter->reference && !hits[i].sphere)
                sharpen(painter, &rays[i].ray, &hits[i]);
            if (hits[i].found)
                scatter(painter, &next, depth, &wave.list[i], &hits[i], &lights);
            else
                pixel_add(painter, wave.list[i].pixel, wave.list[i].weight, light);
        }
        ok = ok && shadows_trace(painter, &lights);
        gn_arena_finish(&arena);
        const struct wave spent = wave;
        wave = next;
        next = spent;
        next.count = 0;
    }
    free(wave.list);
    free(next.list);
    free(lights.shadows);
    free(lights.lit);
    return ok;
}

static void painter_begin(struct painter *painter)
{
    const struct gn_render_options *options = painter->options;
    gn_render_plan(painter->scene, &painter->plan);
    painter->lists = active(painter, GN_RENDER_TRANSPARENCY) || active(painter, GN_RENDER_PROCEDURAL);
    *painter->result = (struct gn_render_result){
        .pixels = gn_arena_alloc(painter->arena, (size_t)options->width * options->height, sizeof(float[3]))};
}

static double thread_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

bool gn_render_reference(struct gn_arena *arena, const struct gn_render_scene *scene,
                         const struct gn_render_options *options, struct gn_render_result *out)
{
    struct gn_case_run run = {0};
    struct painter painter = {.scene = scene, .options = options, .result = out, .arena = arena};
    painter_begin(&painter);
    /* Of this thread alone: what else the machine does should not show. */
    const double begin = thread_seconds();
    painter.reference = gn_case_reference(&run, &scene->scene);
    const bool ok = painter.reference && paint(&painter);
    out->seconds = thread_seconds() - begin;
    gn_ref_scene_destroy(painter.reference);
    gn_arena_finish(&run.arena);
    return ok;
}

bool gn_render_driver(struct gn_case_run *run, const struct gn_render_scene *scene,
                      const struct gn_render_options *options, bool judged, struct gn_render_result *out)
{
    struct painter painter = {
        .scene = scene, .options = options, .result = out, .arena = &run->arena, .run = run, .judged = judged};
    painter_begin(&painter);
    const double begin = gn_clock();
    painter.traced = run->route.entry == GN_CTS_PIPELINE ? gn_table_scene(&run->arena, &scene->scene, &run->route)
                                                         : &scene->scene;
    const enum gn_device_status status =
        painter.traced ? gn_scene_build(run->device, painter.traced, &painter.built) : GN_DEVICE_UNSUPPORTED;
    if (status == GN_DEVICE_UNSUPPORTED)
        gn_case_skip(run, "%s", gn_device_message(run->device));
    else if (status != GN_DEVICE_OK)
        gn_case_fail(run, "%s", gn_device_message(run->device));
    const bool ok = status == GN_DEVICE_OK && paint(&painter);
    out->seconds = gn_clock() - begin;
    gn_built_scene_destroy(painter.built);
    return ok;
}

double gn_render_difference(const struct gn_render_result *a, const struct gn_render_result *b, uint32_t pixel_count)
{
    double sum = 0;
    for (uint32_t i = 0; i < 3 * pixel_count; i++) {
        const double off = (double)a->pixels[i / 3][i % 3] - (double)b->pixels[i / 3][i % 3];
        sum += off * off;
    }
    return sqrt(sum / (3.0 * pixel_count));
}
