/* SPDX-License-Identifier: Apache-2.0 */
/* reference_proof: the comparison of the reference with the oracle, as long as one likes. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "proof.h"
#include "reference/certified.h"

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void report(const char *name, const struct proof_counts *c, double time)
{
    printf("%-20s %10llu rays %10llu aimed %9llu hit %11llu hits %13llu excluded %10llu exact %6.1f s  t within %.3g x 2^-53, "
           "%llu to the other f32; bounds in the median at most %g times the error of t, %g of barycentrics; "
           "%llu differences\n",
           name, (unsigned long long)c->rays, (unsigned long long)c->aimed, (unsigned long long)c->rays_hit,
           (unsigned long long)c->hits, (unsigned long long)c->pairs_excluded, (unsigned long long)c->pairs_exact, time,
           c->t_error, (unsigned long long)c->misrounded,
           proof_slack(c, PROOF_LENGTHS), proof_slack(c, PROOF_BARYCENTRICS), (unsigned long long)c->differences);
    if (c->differences)
        printf("  %s\n", c->first);
    fflush(stdout);
}

/* All families, or the one named. */
static void families_run(const struct proof_options *options, const char *only, struct proof_counts *total)
{
    for (uint32_t f = 0; f < family_count && options->rays > 0; f++) {
        if (only && strcmp(only, families[f].name) != 0)
            continue;
        struct proof_counts counts;
        double before = seconds();
        proof_family(&families[f], options, &counts);
        report(families[f].name, &counts, seconds() - before);
        proof_counts_add(total, &counts);
    }
}

int main(int argc, char **argv)
{
    struct proof_options options = {.seed = 1, .threads = 2};
    double rays = 1e6, large_rays = 0, every_pair_rays = 0;
    const char *only = NULL;
    for (int i = 1; i < argc; i += 2) {
        const char *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (value && strcmp(argv[i], "--rays") == 0)
            rays = atof(value);
        else if (value && strcmp(argv[i], "--large") == 0)
            large_rays = atof(value);
        else if (value && strcmp(argv[i], "--full-gmp") == 0)
            every_pair_rays = atof(value);
        else if (value && strcmp(argv[i], "--seed") == 0)
            options.seed = strtoull(value, NULL, 0);
        else if (value && strcmp(argv[i], "--threads") == 0)
            options.threads = atoi(value);
        else if (value && strcmp(argv[i], "--family") == 0)
            only = value;
        else if (value && strcmp(argv[i], "--kernel") == 0 && gn_ref_certified_force(value))
            continue;
        else {
            fprintf(stderr, "usage: reference_proof [--rays N] [--large N] [--full-gmp N] [--seed S] [--threads T] [--family NAME]\n"
                            "                       [--kernel K]\n"
                            "  --rays: in all families together; --large: against 131,072 triangles\n"
                            "  --full-gmp: of each family, every ray against every one of 200 triangles in integers\n"
                            "  --kernel: avx512, avx2, portable or none, as far as this machine has it\n");
            return 2;
        }
    }
    struct proof_counts total = {0};
    double start = seconds();
    options.rays = (uint64_t)(rays / (only ? 1 : family_count));
    families_run(&options, only, &total);
    options.rays = (uint64_t)large_rays;
    if (options.rays > 0) {
        struct proof_counts counts;
        double before = seconds();
        proof_large(256, &options, &counts);
        report("131,072 triangles", &counts, seconds() - before);
        proof_counts_add(&total, &counts);
    }
    options = (struct proof_options){.seed = options.seed, .threads = options.threads, .rays = (uint64_t)every_pair_rays,
                                     .most_triangles = 200, .every_pair = true};
    if (options.rays > 0)
        printf("every pair in integers:\n");
    families_run(&options, only, &total);
    report("all", &total, seconds() - start);
    struct gn_ref_trace_counters counters = gn_ref_trace_counters();
    printf("the reference: %llu decisions by the filter, %llu by wide integers, %llu by GMP\n",
           (unsigned long long)counters.filtered, (unsigned long long)counters.wide,
           (unsigned long long)counters.exact);
    return total.differences ? 1 : total.rays ? 0 : 4;
}
