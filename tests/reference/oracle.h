/* SPDX-License-Identifier: Apache-2.0 */
/*
 * An oracle that shares nothing with reference/ but the structs: every primitive is looked at, in object space rather
 * than the world, by Moeller and Trumbore's formulas rather than edge functions, in integers. Only what a deliberately
 * crude interval bound excludes is not.
 */
#ifndef GNOMON_TESTS_REFERENCE_ORACLE_H
#define GNOMON_TESTS_REFERENCE_ORACLE_H

#include "reference/trace.h"

/* What a test traces, before it is added to a gn_ref_scene. */
#define ORACLE_INSTANCES 48
struct oracle_scene {
    struct gn_ref_geometry geometries[8];
    uint32_t blas_first[9]; /* the geometries of BLAS b: blas_first[b] .. blas_first[b + 1] */
    uint32_t blas_count;
    struct gn_ref_instance instances[ORACLE_INSTANCES];
    uint32_t instance_count;
};

struct oracle;

/* For one thread. */
struct oracle *oracle_create(const struct oracle_scene *scene);
/* From now on the interval bound excludes nothing: every pair is decided in integers. */
void oracle_exclude_nothing(struct oracle *oracle);
void oracle_destroy(struct oracle *oracle);

/* All that the ray meets, in order: hits[i].t and so on are rounded from exact values. The number of hits. */
size_t oracle_trace(struct oracle *oracle, const struct gn_ref_ray *ray, const struct gn_ref_hit **out_hits);
/* What a value for a number of the hit at that place is wrong by, rounded up to an f64; infinite when the value is. */
enum oracle_number { ORACLE_T, ORACLE_T_EXIT, ORACLE_BETA, ORACLE_GAMMA, ORACLE_NUMBER_COUNT };
double oracle_error(struct oracle *oracle, size_t hit, enum oracle_number number, double value);
/* The exact order of two of them: -1, 0, 1. */
int oracle_compare_t(struct oracle *oracle, size_t a, size_t b);

/* Pairs of ray and primitive: excluded by the interval bound, decided in integers. */
struct oracle_counters {
    uint64_t excluded, exact;
};
struct oracle_counters oracle_counters(const struct oracle *oracle);

/* The self-check's lever: this primitive is not looked at any more. */
void oracle_forget(struct oracle *oracle, uint32_t instance, uint32_t geometry, uint32_t primitive);

#endif
