/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the reference with the oracle over families of scenes and rays, on several threads. */
#ifndef GNOMON_TESTS_REFERENCE_PROOF_H
#define GNOMON_TESTS_REFERENCE_PROOF_H

#include "families.h"

struct proof_counts {
    uint64_t rays, aimed; /* aimed: at edges and vertices */
    uint64_t rays_hit, hits;
    uint64_t differences;
    uint64_t pairs_excluded, pairs_exact;
    /* Over the nearest triangles. t_error: the largest relative error, in units of 2^-53; misrounded: t, rounded to f32,
     * is not the f32 nearest to the ideal value but the one on its other side. */
    double t_error;
    uint64_t misrounded;
    /* The bounds that came with the numbers: how often a number was exact, and how often the bound was 2^i times its error or
     * more, but less than 2^(i+1) times, over all hits. */
    uint64_t unerring[2];
    uint64_t slack[2][64];
    char first[600]; /* the first difference, for people */
};

/* t and t_exit; beta and gamma. */
enum proof_numbers { PROOF_LENGTHS, PROOF_BARYCENTRICS };
/* The factor by which the median bound is larger than the error, of numbers that are not exact, to a power of two. */
double proof_slack(const struct proof_counts *counts, enum proof_numbers numbers);

/* Sums, of `t_error` the larger one, of `first` the earlier one. */
void proof_counts_add(struct proof_counts *total, const struct proof_counts *more);

struct proof_options {
    uint64_t seed;
    uint64_t rays; /* per family */
    int threads;
    uint32_t most_triangles; /* so many in each scene; 0: random numbers up to the family's own */
    bool every_pair; /* the oracle decides every pair in integers */
};

/* Rays of one family, over as many scenes as that takes. Edge- and vertex-aimed rays are 8 of 10. */
void proof_family(const struct family *family, const struct proof_options *options, struct proof_counts *out);

/* One height field of 2 n^2 triangles. */
void proof_large(uint32_t n, const struct proof_options *options, struct proof_counts *out);

/*
 * The self-check: the oracle forgets one triangle of each scene, so that both rays aimed at it and nothing else have to
 * come out as differences. Gives the number of rays aimed, and in *out_noticed those that differ.
 */
uint64_t proof_self_check(const struct family *family, uint64_t seed, uint64_t *out_noticed);

/* The number of rays that a test asks for, after the GNOMON_PROOF_SCALE variable (a factor) and sanitizers. */
uint64_t proof_scaled(uint64_t rays);

#endif
