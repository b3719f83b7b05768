/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The reference answers every ray as the oracle does: a million rays, eight of ten aimed at edges and vertices, over
 * meshes of up to 2,000 triangles in sixteen families, and ten thousand rays against 131,072 triangles.
 * GNOMON_PROOF_SCALE multiplies the numbers; reference_proof runs the same for as long as one likes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>

#include "proof.h"
#include "reference/certified.h"

#define SEED 20240917

static void check(const char *name, const struct proof_counts *counts, uint64_t wanted)
{
    print_message("%-22s %8llu rays, %8llu aimed, %8llu hit; pairs: %11llu excluded by intervals, %8llu exact\n", name,
                  (unsigned long long)counts->rays, (unsigned long long)counts->aimed,
                  (unsigned long long)counts->rays_hit, (unsigned long long)counts->pairs_excluded,
                  (unsigned long long)counts->pairs_exact);
    if (counts->differences)
        print_error("%llu differences, the first: %s\n", (unsigned long long)counts->differences, counts->first);
    assert_int_equal(counts->differences, 0);
    assert_int_equal(counts->rays, wanted);
    /* A family that hits nothing proves nothing. */
    assert_true(counts->rays_hit * 4 > counts->rays);
    /* The bounds that come with the numbers are not much larger than they have to be: as trace.h says. */
    double lengths = proof_slack(counts, PROOF_LENGTHS), barycentrics = proof_slack(counts, PROOF_BARYCENTRICS);
    if (lengths > 512 || barycentrics > 1024)
        print_error("in the median the bound of t is up to %g times its error, that of a barycentric %g times\n", lengths,
                    barycentrics);
    assert_true(lengths <= 512 && barycentrics <= 1024);
}

static struct proof_counts total; /* of all families */

static void family_agrees(void **state)
{
    const struct family *family = *state;
    struct proof_options options = {.seed = SEED, .rays = proof_scaled(80000), .threads = 2};
    struct proof_counts counts;
    proof_family(family, &options, &counts);
    check(family->name, &counts, options.rays);
    proof_counts_add(&total, &counts);
}

/* With bounds half as large some numbers would be found to be wrong by more. */
static void bounds_are_reached(void **state)
{
    (void)state;
    assert_true(total.slack[PROOF_LENGTHS][0] > 0 && total.slack[PROOF_BARYCENTRICS][0] > 0);
}

/* Every kernel that this machine has, the f64 traversal included: fewer rays, all families. */
static void kernels_agree(void **state)
{
    (void)state;
    static const char *const kernels[] = {"none", "portable", "avx2", "avx512"};
    struct proof_options options = {.seed = SEED + 1, .rays = proof_scaled(5000), .threads = 2};
    for (size_t k = 0; k < sizeof kernels / sizeof kernels[0]; k++) {
        if (!gn_ref_certified_force(kernels[k])) {
            print_message("this machine has no %s\n", kernels[k]);
            continue;
        }
        struct proof_counts counts;
        for (uint32_t f = 0; f < family_count; f++) {
            proof_family(&families[f], &options, &counts);
            if (counts.differences)
                print_error("%s: %llu differences, the first: %s\n", kernels[k], (unsigned long long)counts.differences,
                            counts.first);
            assert_int_equal(counts.differences, 0);
        }
        options.rays = proof_scaled(1000);
        proof_large(256, &options, &counts);
        assert_int_equal(counts.differences, 0);
        options.rays = proof_scaled(5000);
    }
    assert_true(gn_ref_certified_force(NULL));
}

static void large_mesh_agrees(void **state)
{
    (void)state;
    struct proof_options options = {.seed = SEED, .rays = proof_scaled(10000), .threads = 2};
    struct proof_counts counts;
    proof_large(256, &options, &counts);
    check("131,072 triangles", &counts, options.rays);
}

/* A comparison that could not fail would prove nothing: with one triangle forgotten every ray that hits it differs. */
static void forgotten_triangle_is_noticed(void **state)
{
    (void)state;
    for (uint32_t f = 0; f < 2; f++) {
        uint64_t noticed, aimed = proof_self_check(&families[f], SEED, &noticed);
        assert_true(aimed > 1000);
        assert_int_equal(noticed, aimed);
    }
}

int main(void)
{
    struct CMUnitTest tests[64] = {{0}};
    size_t count = 0;
    for (uint32_t f = 0; f < family_count; f++)
        tests[count++] = (struct CMUnitTest){families[f].name, family_agrees, NULL, NULL, (void *)(uintptr_t)&families[f]};
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(bounds_are_reached);
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(large_mesh_agrees);
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(kernels_agree);
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(forgotten_triangle_is_noticed);
    return _cmocka_run_group_tests("reference.proof", tests, count, NULL, NULL);
}
