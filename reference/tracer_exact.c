/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The tier EXACT: integers of any size decide everything, the boxes of the tree included. What is f64 here orders the
 * search or rounds a result, and decides nothing.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "reference/tracer_internal.h"

struct state {
    struct gn_ref_tree triangles, boxes;
};

/* A hit, placed exactly. */
struct placed {
    struct gn_ref_ratio place;
    struct gn_ref_record record;
};

struct search {
    const struct gn_ref_tracer *tracer;
    const struct gn_ref_ray *ray;
    struct gn_ref_exact exact;
    mpz_t origin[3], direction[3]; /* times 2^149 */
    mpz_t bound, entry[2], leave[2]; /* [0] over [1] */
    mpz_t scratch[2];
    bool only_nearest, any;
    struct placed *found;
    size_t count, capacity;
    bool failed;
};

static void state_destroy(void *pointer)
{
    struct state *state = pointer;
    gn_ref_tree_finish(&state->triangles);
    gn_ref_tree_finish(&state->boxes);
    free(state);
}

static bool state_create(struct gn_ref_tracer *tracer)
{
    struct state *state = calloc(1, sizeof *state);
    if (!state || !gn_ref_tree_build(&state->triangles, tracer->scene, GN_REF_TRIANGLES) ||
        !gn_ref_tree_build(&state->boxes, tracer->scene, GN_REF_AABBS)) {
        if (state)
            state_destroy(state);
        return gn_ref_tracer_fail(tracer, "out of memory for the tree of %u instances", tracer->scene->instance_count);
    }
    tracer->cost.bytes = sizeof *state + gn_ref_tree_bytes(&state->triangles) + gn_ref_tree_bytes(&state->boxes);
    tracer->state = state;
    return true;
}

/* Any finite f32 is an integer times 2^-149. */
static void set_scaled(mpz_t out, float value)
{
    int exponent;
    long mantissa = (long)ldexpf(frexpf(value, &exponent), 24);
    mpz_set_si(out, mantissa);
    if (exponent - 24 + 149 >= 0)
        mpz_mul_2exp(out, out, (mp_bitcnt_t)(exponent - 24 + 149));
    else
        mpz_fdiv_q_2exp(out, out, (mp_bitcnt_t)-(exponent - 24 + 149)); /* denormal: the low bits are zero */
}

static void search_begin(struct search *search, const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray)
{
    memset(search, 0, sizeof *search);
    search->tracer = tracer;
    search->ray = ray;
    gn_ref_exact_init(&search->exact);
    for (int i = 0; i < 3; i++) {
        mpz_init(search->origin[i]);
        mpz_init(search->direction[i]);
        set_scaled(search->origin[i], ray->origin[i]);
        set_scaled(search->direction[i], ray->direction[i]);
    }
    mpz_init(search->bound);
    for (int i = 0; i < 2; i++) {
        mpz_init(search->entry[i]);
        mpz_init(search->leave[i]);
        mpz_init(search->scratch[i]);
    }
}

static void placed_finish(struct placed *placed)
{
    mpz_clear(placed->place.numerator);
    mpz_clear(placed->place.denominator);
}

static void search_end(struct search *search)
{
    gn_ref_exact_finish(&search->exact);
    for (int i = 0; i < 3; i++) {
        mpz_clear(search->origin[i]);
        mpz_clear(search->direction[i]);
    }
    mpz_clear(search->bound);
    for (int i = 0; i < 2; i++) {
        mpz_clear(search->entry[i]);
        mpz_clear(search->leave[i]);
        mpz_clear(search->scratch[i]);
    }
    for (size_t i = 0; i < search->count; i++)
        placed_finish(&search->found[i]);
    free(search->found);
}

/* The sign of a - b, of fractions with positive denominators. */
static int compare_fractions(struct search *search, mpz_t a[2], mpz_t b[2])
{
    mpz_mul(search->scratch[0], a[0], b[1]);
    mpz_mul(search->scratch[1], b[0], a[1]);
    return mpz_cmp(search->scratch[0], search->scratch[1]);
}

/* bound = face - origin, divided by the direction, replaces the end if that makes [entry, leave] smaller. */
static void narrow(struct search *search, mpz_t end[2], bool *have, bool is_entry, int axis, float face)
{
    mpz_t next[2];
    mpz_init(next[0]);
    mpz_init(next[1]);
    set_scaled(next[0], face);
    mpz_sub(next[0], next[0], search->origin[axis]);
    mpz_abs(next[1], search->direction[axis]);
    if (mpz_sgn(search->direction[axis]) < 0)
        mpz_neg(next[0], next[0]);
    if (!*have || (is_entry ? compare_fractions(search, next, end) > 0 : compare_fractions(search, next, end) < 0)) {
        mpz_swap(end[0], next[0]);
        mpz_swap(end[1], next[1]);
    }
    *have = true;
    mpz_clear(next[0]);
    mpz_clear(next[1]);
}

/* Whether the ray's closed range, up to the nearest hit where only that is wanted, meets the closed box. */
static bool bounds_meet(struct search *search, const struct gn_ref_tree_node *node, int child)
{
    bool have_entry = false, have_leave = false;
    const struct gn_ref_ray *ray = search->ray;
    struct gn_ref_ratio ratio;
    for (int i = 0; i < 3; i++) {
        float lower = node->lower[i][child], upper = node->upper[i][child];
        int sign = mpz_sgn(search->direction[i]);
        if (sign == 0) {
            if (ray->origin[i] < lower || ray->origin[i] > upper)
                return false;
            continue;
        }
        float first = sign > 0 ? lower : upper, last = sign > 0 ? upper : lower;
        if (isfinite(first))
            narrow(search, search->entry, &have_entry, true, i, first);
        if (isfinite(last))
            narrow(search, search->leave, &have_leave, false, i, last);
    }
    if (have_entry && have_leave && compare_fractions(search, search->entry, search->leave) > 0)
        return false;
    if (have_leave) {
        ratio = (struct gn_ref_ratio){.exponent = 0};
        memcpy(&ratio.numerator, &search->leave[0], sizeof ratio.numerator);
        memcpy(&ratio.denominator, &search->leave[1], sizeof ratio.denominator);
        if (gn_ref_ratio_compare_f64(&search->exact, &ratio, ray->tmin) < 0)
            return false;
    }
    if (have_entry) {
        ratio = (struct gn_ref_ratio){.exponent = 0};
        memcpy(&ratio.numerator, &search->entry[0], sizeof ratio.numerator);
        memcpy(&ratio.denominator, &search->entry[1], sizeof ratio.denominator);
        if (!isinf(ray->tmax) && gn_ref_ratio_compare_f64(&search->exact, &ratio, ray->tmax) > 0)
            return false;
        if (search->only_nearest && search->count > 0 &&
            gn_ref_ratio_compare(&search->exact, &ratio, &search->found[0].place) > 0)
            return false;
    }
    return true;
}

static int compare_placed(struct search *search, const struct placed *a, const struct placed *b)
{
    int order = gn_ref_ratio_compare(&search->exact, &a->place, &b->place);
    return order ? order : gn_ref_hit_compare_ids(&a->record.hit, &b->record.hit);
}

/* Takes exact.t for the place. True when the search is over. */
static bool accept(struct search *search, struct gn_ref_record *record)
{
    struct placed placed = {.record = *record};
    gn_ref_hit_set_rounding_errors(&placed.record.hit, record->hit.type == GN_REF_TRIANGLES);
    gn_ref_record_finish(search->tracer->scene, &placed.record);
    mpz_init(placed.place.numerator);
    mpz_init(placed.place.denominator);
    gn_ref_ratio_set(&placed.place, &search->exact.t);
    if (search->only_nearest && search->count > 0) {
        bool nearer = compare_placed(search, &placed, &search->found[0]) < 0;
        placed_finish(nearer ? &search->found[0] : &placed);
        if (nearer)
            search->found[0] = placed;
        return search->any;
    }
    if (search->count == search->capacity) {
        size_t capacity = search->capacity ? search->capacity * 2 : 8;
        struct placed *found =
            capacity > SIZE_MAX / sizeof *found ? NULL : realloc(search->found, capacity * sizeof *found);
        if (!found) {
            placed_finish(&placed);
            search->failed = true;
            return true;
        }
        search->found = found;
        search->capacity = capacity;
    }
    search->found[search->count++] = placed;
    return search->any;
}

static bool triangle_visit(struct search *search, const struct gn_ref_primitive *p)
{
    const struct gn_ref_scene *scene = search->tracer->scene;
    const struct gn_ref_ray *ray = search->ray;
    struct gn_ref_exact *exact = &search->exact;
    struct gn_ref_record record = {.hit = {.type = GN_REF_TRIANGLES, .instance = p->instance, .geometry = p->geometry,
                                           .primitive = p->primitive}};
    if (!gn_ref_admitted(scene, ray, p->instance, p->geometry, &record.hit.opaque))
        return false;
    struct gn_ref_signs signs = gn_ref_triangle_exact(exact, scene, p, ray);
    if (!gn_ref_signs_meet(&signs) || signs.sum == 0)
        return false;
    if (isinf(ray->tmin) || gn_ref_ratio_compare_f64(exact, &exact->t, ray->tmin) <= 0 ||
        (!isinf(ray->tmax) && gn_ref_ratio_compare_f64(exact, &exact->t, ray->tmax) >= 0))
        return false;
    record.hit.t = record.hit.t_exit = gn_ref_ratio_f64(exact, &exact->t);
    record.hit.beta = gn_ref_exact_barycentric(exact, 1);
    record.hit.gamma = gn_ref_exact_barycentric(exact, 2);
    record.hit.front = signs.sum * gn_ref_determinant_sign_exact(scene->instances[p->instance].transform) < 0;
    return gn_ref_facing_admitted(scene, ray, p->instance, &record.hit.front) && accept(search, &record);
}

static bool box_visit(struct search *search, const struct gn_ref_primitive *p)
{
    const struct gn_ref_scene *scene = search->tracer->scene;
    struct gn_ref_exact *exact = &search->exact;
    struct gn_ref_record record = {.hit = {.type = GN_REF_AABBS, .instance = p->instance, .geometry = p->geometry,
                                           .primitive = p->primitive}};
    if (!gn_ref_admitted(scene, search->ray, p->instance, p->geometry, &record.hit.opaque) ||
        !gn_ref_box_exact(exact, scene, p, search->ray))
        return false;
    record.hit.t = gn_ref_ratio_f64(exact, &exact->t);
    record.hit.t_exit = gn_ref_ratio_f64(exact, &exact->t_exit);
    if (gn_ref_ratio_compare_f64(exact, &exact->t, search->ray->tmin) < 0)
        gn_ref_ratio_set_f64(&exact->t, search->ray->tmin);
    return accept(search, &record);
}

/* True when the search is over. */
static bool traverse(struct search *search, const struct gn_ref_tree *tree,
                     bool (*visit)(struct search *search, const struct gn_ref_primitive *p))
{
    struct {
        uint32_t node, child;
        double along;
    } stack[GN_REF_TREE_DEPTH * (GN_REF_TREE_WIDTH - 1) + GN_REF_TREE_WIDTH];
    size_t depth = 0;
    uint32_t enter = 0;
    bool entering = tree->node_count > 0;
    while (entering || depth > 0) {
        if (entering) {
            /* What seems nearest is put last, to be taken first. */
            const struct gn_ref_tree_node *node = &tree->nodes[enter];
            size_t base = depth;
            for (uint32_t c = 0; c < GN_REF_TREE_WIDTH; c++) {
                if (node->child[c] == GN_REF_NONE)
                    continue;
                double along = 0;
                for (int i = 0; i < 3; i++)
                    along += search->ray->direction[i] * ((double)node->lower[i][c] + node->upper[i][c]);
                size_t at = depth++;
                for (; at > base && stack[at - 1].along < along; at--)
                    stack[at] = stack[at - 1];
                stack[at].node = enter;
                stack[at].child = c;
                stack[at].along = along;
            }
            entering = false;
            continue;
        }
        depth--;
        const struct gn_ref_tree_node *node = &tree->nodes[stack[depth].node];
        if (!bounds_meet(search, node, (int)stack[depth].child))
            continue;
        uint32_t child = node->child[stack[depth].child];
        if (!(child & GN_REF_TREE_LEAF)) {
            enter = child;
            entering = true;
            continue;
        }
        const struct gn_ref_tree_leaf *leaf = &tree->leaves[child & ~GN_REF_TREE_LEAF];
        for (uint32_t i = 0; i < leaf->count; i++)
            if (visit(search, &leaf->items[i]))
                return true;
    }
    return false;
}

static void search_run(struct search *search)
{
    const struct state *state = search->tracer->state;
    struct gn_ref_environment environment;
    if (isinf(search->ray->tmin)) /* no place is that far away, and it is no number to compare with */
        return;
    gn_ref_environment_enter(&environment);
    bool over = false;
    if (!(search->ray->flags & GN_REF_RAY_SKIP_TRIANGLES))
        over = traverse(search, &state->triangles, triangle_visit);
    if (!over && !(search->ray->flags & GN_REF_RAY_SKIP_AABBS))
        traverse(search, &state->boxes, box_visit);
    gn_ref_environment_leave(&environment);
}

static enum gn_ref_outcome exact_closest(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                                         struct gn_ref_record *out_record)
{
    struct search search;
    search_begin(&search, tracer, ray);
    search.only_nearest = true;
    search_run(&search);
    enum gn_ref_outcome outcome = search.failed ? GN_REF_FAILED : search.count > 0 ? GN_REF_HIT : GN_REF_MISS;
    if (outcome == GN_REF_HIT)
        *out_record = search.found[0].record;
    search_end(&search);
    return outcome;
}

static enum gn_ref_outcome exact_occluded(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray)
{
    struct search search;
    search_begin(&search, tracer, ray);
    search.only_nearest = search.any = true;
    search_run(&search);
    enum gn_ref_outcome outcome = search.failed ? GN_REF_FAILED : search.count > 0 ? GN_REF_HIT : GN_REF_MISS;
    search_end(&search);
    return outcome;
}

/* Heap sort: in place, and never more than n log n of these slow comparisons. */
static void sink(struct search *search, size_t from, size_t count)
{
    struct placed *items = search->found, item = items[from];
    for (size_t child; (child = 2 * from + 1) < count; from = child) {
        if (child + 1 < count && compare_placed(search, &items[child], &items[child + 1]) < 0)
            child++;
        if (compare_placed(search, &item, &items[child]) >= 0)
            break;
        items[from] = items[child];
    }
    items[from] = item;
}

static int64_t exact_all(const struct gn_ref_tracer *tracer, const struct gn_ref_ray *ray,
                         struct gn_ref_record *out_records, size_t capacity)
{
    struct search search;
    search_begin(&search, tracer, ray);
    search_run(&search);
    int64_t count = search.failed ? GN_REF_FAILED : (int64_t)search.count;
    if (!search.failed) {
        for (size_t i = search.count / 2; i > 0; i--)
            sink(&search, i - 1, search.count);
        for (size_t last = search.count; last > 1; last--) {
            struct placed item = search.found[0];
            search.found[0] = search.found[last - 1];
            search.found[last - 1] = item;
            sink(&search, 0, last - 1);
        }
        for (size_t i = 0; i < search.count && i < capacity; i++)
            out_records[i] = search.found[i].record;
    }
    search_end(&search);
    return count;
}

const struct gn_ref_tier_functions gn_ref_tier_exact = {
    .name = "exact",
    .create = state_create,
    .destroy = state_destroy,
    .closest = exact_closest,
    .occluded = exact_occluded,
    .all = exact_all,
};
