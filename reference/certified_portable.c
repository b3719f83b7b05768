/* SPDX-License-Identifier: Apache-2.0 */
/* The kernel of certified.h in plain C, for machines without AVX2 and as what the others are compared with. */
#include <math.h>
#include <stdint.h>

typedef struct {
    float v[8];
} f8;
typedef struct {
    double v[8];
} d8;

#define EACH(out, type, expression)                                                                                    \
    type out;                                                                                                          \
    for (int l = 0; l < 8; l++)                                                                                        \
        out.v[l] = (expression);                                                                                       \
    return out

static inline f8 f8_set1(float a) { EACH(r, f8, a); }
static inline f8 f8_load(const float *a) { EACH(r, f8, a[l]); }
static inline f8 f8_max(f8 a, f8 b) { EACH(r, f8, a.v[l] > b.v[l] ? a.v[l] : b.v[l]); }
static inline f8 f8_min(f8 a, f8 b) { EACH(r, f8, a.v[l] < b.v[l] ? a.v[l] : b.v[l]); }
static inline f8 f8_mulsub(f8 a, f8 b, f8 c) { EACH(r, f8, a.v[l] * b.v[l] - c.v[l]); }
static inline void f8_store(float *to, f8 a)
{
    for (int l = 0; l < 8; l++)
        to[l] = a.v[l];
}
static inline unsigned f8_le(f8 a, f8 b)
{
    unsigned mask = 0;
    for (int l = 0; l < 8; l++)
        mask |= (unsigned)(a.v[l] <= b.v[l]) << l;
    return mask;
}

static inline d8 d8_set1(double a) { EACH(r, d8, a); }
static inline d8 d8_load(const double *a) { EACH(r, d8, a[l]); }
static inline d8 d8_load_f32(const float *a) { EACH(r, d8, a[l]); }
static inline d8 d8_add(d8 a, d8 b) { EACH(r, d8, a.v[l] + b.v[l]); }
static inline d8 d8_sub(d8 a, d8 b) { EACH(r, d8, a.v[l] - b.v[l]); }
static inline d8 d8_mul(d8 a, d8 b) { EACH(r, d8, a.v[l] * b.v[l]); }
static inline d8 d8_div(d8 a, d8 b) { EACH(r, d8, a.v[l] / b.v[l]); }
static inline d8 d8_muladd(d8 a, d8 b, d8 c) { EACH(r, d8, a.v[l] * b.v[l] + c.v[l]); }
static inline d8 d8_nmuladd(d8 a, d8 b, d8 c) { EACH(r, d8, c.v[l] - a.v[l] * b.v[l]); }
static inline d8 d8_max(d8 a, d8 b) { EACH(r, d8, a.v[l] > b.v[l] ? a.v[l] : b.v[l]); }
static inline d8 d8_min(d8 a, d8 b) { EACH(r, d8, a.v[l] < b.v[l] ? a.v[l] : b.v[l]); }
static inline d8 d8_abs(d8 a) { EACH(r, d8, fabs(a.v[l])); }
static inline d8 d8_neg(d8 a) { EACH(r, d8, -a.v[l]); }
static inline void d8_store(double *to, d8 a)
{
    for (int l = 0; l < 8; l++)
        to[l] = a.v[l];
}
static inline unsigned d8_gt(d8 a, d8 b)
{
    unsigned mask = 0;
    for (int l = 0; l < 8; l++)
        mask |= (unsigned)(a.v[l] > b.v[l]) << l;
    return mask;
}
static inline unsigned d8_equal(d8 a, d8 b)
{
    unsigned mask = 0;
    for (int l = 0; l < 8; l++)
        mask |= (unsigned)(a.v[l] == b.v[l]) << l;
    return mask;
}
/* a b - p for the rounded product p: Dekker's, exact as factors stay below 2^970 and rests do not underflow. */
static inline d8 d8_product_rest(d8 a, d8 b, d8 p)
{
    d8 rest;
    for (int l = 0; l < 8; l++) {
        double c = a.v[l] * 0x1.0000002p27, d = b.v[l] * 0x1.0000002p27;
        double a1 = c - (c - a.v[l]), b1 = d - (d - b.v[l]), a0 = a.v[l] - a1, b0 = b.v[l] - b1;
        rest.v[l] = a0 * b0 - (((p.v[l] - a1 * b1) - a0 * b1) - a1 * b0);
    }
    return rest;
}
static inline unsigned ids_used(const uint32_t *ids)
{
    unsigned mask = 0;
    for (int l = 0; l < 8; l++)
        mask |= (unsigned)(ids[l] != UINT32_MAX) << l;
    return mask;
}

#define FUSED 0
#define GN_REF_KERNEL gn_ref_certified_run_portable
#define GN_REF_KERNEL_START gn_ref_certified_start_portable
#include "reference/certified_kernel.h"
