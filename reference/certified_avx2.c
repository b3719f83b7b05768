/* SPDX-License-Identifier: Apache-2.0 */
/* The kernel of certified.h for AVX2 and FMA. Compiled with those enabled, entered only where the processor has them. */
#include "reference/certified.h"

#if defined(__AVX2__) && defined(__FMA__)
#include <immintrin.h>

typedef __m256 f8;
typedef struct {
    __m256d a, b;
} d8;

static inline f8 f8_set1(float a) { return _mm256_set1_ps(a); }
static inline f8 f8_load(const float *a) { return _mm256_loadu_ps(a); }
static inline f8 f8_max(f8 a, f8 b) { return _mm256_max_ps(a, b); }
static inline f8 f8_min(f8 a, f8 b) { return _mm256_min_ps(a, b); }
static inline f8 f8_mulsub(f8 a, f8 b, f8 c) { return _mm256_fmsub_ps(a, b, c); }
static inline void f8_store(float *to, f8 a) { _mm256_storeu_ps(to, a); }
static inline unsigned f8_le(f8 a, f8 b) { return (unsigned)_mm256_movemask_ps(_mm256_cmp_ps(a, b, _CMP_LE_OQ)); }

static inline d8 d8_set1(double a) { return (d8){_mm256_set1_pd(a), _mm256_set1_pd(a)}; }
static inline d8 d8_load(const double *a) { return (d8){_mm256_loadu_pd(a), _mm256_loadu_pd(a + 4)}; }
static inline d8 d8_load_f32(const float *a)
{
    return (d8){_mm256_cvtps_pd(_mm_loadu_ps(a)), _mm256_cvtps_pd(_mm_loadu_ps(a + 4))};
}
#define BOTH(operation, p, q) ((d8){operation((p).a, (q).a), operation((p).b, (q).b)})
static inline d8 d8_add(d8 p, d8 q) { return BOTH(_mm256_add_pd, p, q); }
static inline d8 d8_sub(d8 p, d8 q) { return BOTH(_mm256_sub_pd, p, q); }
static inline d8 d8_mul(d8 p, d8 q) { return BOTH(_mm256_mul_pd, p, q); }
static inline d8 d8_div(d8 p, d8 q) { return BOTH(_mm256_div_pd, p, q); }
static inline d8 d8_max(d8 p, d8 q) { return BOTH(_mm256_max_pd, p, q); }
static inline d8 d8_min(d8 p, d8 q) { return BOTH(_mm256_min_pd, p, q); }
static inline d8 d8_muladd(d8 p, d8 q, d8 r)
{
    return (d8){_mm256_fmadd_pd(p.a, q.a, r.a), _mm256_fmadd_pd(p.b, q.b, r.b)};
}
static inline d8 d8_nmuladd(d8 p, d8 q, d8 r)
{
    return (d8){_mm256_fnmadd_pd(p.a, q.a, r.a), _mm256_fnmadd_pd(p.b, q.b, r.b)};
}
static inline d8 d8_abs(d8 p)
{
    __m256d sign = _mm256_set1_pd(-0.0);
    return (d8){_mm256_andnot_pd(sign, p.a), _mm256_andnot_pd(sign, p.b)};
}
static inline d8 d8_neg(d8 p)
{
    __m256d sign = _mm256_set1_pd(-0.0);
    return (d8){_mm256_xor_pd(sign, p.a), _mm256_xor_pd(sign, p.b)};
}
static inline void d8_store(double *to, d8 p)
{
    _mm256_storeu_pd(to, p.a);
    _mm256_storeu_pd(to + 4, p.b);
}
static inline unsigned d8_gt(d8 p, d8 q)
{
    return (unsigned)_mm256_movemask_pd(_mm256_cmp_pd(p.a, q.a, _CMP_GT_OQ)) |
           (unsigned)_mm256_movemask_pd(_mm256_cmp_pd(p.b, q.b, _CMP_GT_OQ)) << 4;
}
static inline unsigned d8_equal(d8 p, d8 q)
{
    return (unsigned)_mm256_movemask_pd(_mm256_cmp_pd(p.a, q.a, _CMP_EQ_OQ)) |
           (unsigned)_mm256_movemask_pd(_mm256_cmp_pd(p.b, q.b, _CMP_EQ_OQ)) << 4;
}
static inline d8 d8_product_rest(d8 a, d8 b, d8 p)
{
    return (d8){_mm256_fmsub_pd(a.a, b.a, p.a), _mm256_fmsub_pd(a.b, b.b, p.b)};
}
static inline unsigned ids_used(const uint32_t *ids)
{
    __m256i none = _mm256_cmpeq_epi32(_mm256_loadu_si256((const __m256i *)(const void *)ids), _mm256_set1_epi32(-1));
    return ~(unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(none)) & 0xFF;
}

#define FUSED 1
#define GN_REF_KERNEL gn_ref_certified_run_avx2
#define GN_REF_KERNEL_START gn_ref_certified_start_avx2
#include "reference/certified_kernel.h"
#endif
