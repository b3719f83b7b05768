/* SPDX-License-Identifier: Apache-2.0 */
/* The kernel of certified.h for machines without AVX2, and as what the others are compared with: SSE2 or plain C. */
#include <math.h>
#include <stdint.h>

#if defined(__SSE2__)
#include <emmintrin.h>

typedef struct {
    __m128 a, b;
} f8;

#define BOTH(operation, p, q) ((f8){operation((p).a, (q).a), operation((p).b, (q).b)})
static inline f8 f8_set1(float a) { return (f8){_mm_set1_ps(a), _mm_set1_ps(a)}; }
static inline f8 f8_load(const float *a) { return (f8){_mm_loadu_ps(a), _mm_loadu_ps(a + 4)}; }
static inline f8 f8_load_i16(const int16_t *a)
{
    __m128i k = _mm_loadu_si128((const __m128i *)(const void *)a);
    /* In the upper halves, and shifted down with their signs. */
    return (f8){_mm_cvtepi32_ps(_mm_srai_epi32(_mm_unpacklo_epi16(k, k), 16)),
                _mm_cvtepi32_ps(_mm_srai_epi32(_mm_unpackhi_epi16(k, k), 16))};
}
static inline void f8_store(float *to, f8 p)
{
    _mm_storeu_ps(to, p.a);
    _mm_storeu_ps(to + 4, p.b);
}
static inline f8 f8_add(f8 p, f8 q) { return BOTH(_mm_add_ps, p, q); }
static inline f8 f8_sub(f8 p, f8 q) { return BOTH(_mm_sub_ps, p, q); }
static inline f8 f8_mul(f8 p, f8 q) { return BOTH(_mm_mul_ps, p, q); }
static inline f8 f8_max(f8 p, f8 q) { return BOTH(_mm_max_ps, p, q); }
static inline f8 f8_min(f8 p, f8 q) { return BOTH(_mm_min_ps, p, q); }
static inline f8 f8_abs(f8 p)
{
    __m128 sign = _mm_set1_ps(-0.0f);
    return (f8){_mm_andnot_ps(sign, p.a), _mm_andnot_ps(sign, p.b)};
}
static inline f8 f8_neg(f8 p)
{
    __m128 sign = _mm_set1_ps(-0.0f);
    return (f8){_mm_xor_ps(sign, p.a), _mm_xor_ps(sign, p.b)};
}
static inline unsigned f8_le(f8 p, f8 q)
{
    return (unsigned)_mm_movemask_ps(_mm_cmple_ps(p.a, q.a)) | (unsigned)_mm_movemask_ps(_mm_cmple_ps(p.b, q.b)) << 4;
}
static inline unsigned f8_gt(f8 p, f8 q)
{
    return (unsigned)_mm_movemask_ps(_mm_cmpgt_ps(p.a, q.a)) | (unsigned)_mm_movemask_ps(_mm_cmpgt_ps(p.b, q.b)) << 4;
}
#else
typedef struct {
    float v[8];
} f8;

#define EACH(expression)                                                                                               \
    f8 out;                                                                                                            \
    for (int l = 0; l < 8; l++)                                                                                        \
        out.v[l] = (expression);                                                                                       \
    return out
#define EACH_BIT(expression)                                                                                           \
    unsigned mask = 0;                                                                                                 \
    for (int l = 0; l < 8; l++)                                                                                        \
        mask |= (unsigned)(expression) << l;                                                                           \
    return mask
static inline f8 f8_set1(float a) { EACH(a); }
static inline f8 f8_load(const float *a) { EACH(a[l]); }
static inline f8 f8_load_i16(const int16_t *a) { EACH(a[l]); }
static inline void f8_store(float *to, f8 p)
{
    for (int l = 0; l < 8; l++)
        to[l] = p.v[l];
}
static inline f8 f8_add(f8 p, f8 q) { EACH(p.v[l] + q.v[l]); }
static inline f8 f8_sub(f8 p, f8 q) { EACH(p.v[l] - q.v[l]); }
static inline f8 f8_mul(f8 p, f8 q) { EACH(p.v[l] * q.v[l]); }
static inline f8 f8_max(f8 p, f8 q) { EACH(p.v[l] > q.v[l] ? p.v[l] : q.v[l]); }
static inline f8 f8_min(f8 p, f8 q) { EACH(p.v[l] < q.v[l] ? p.v[l] : q.v[l]); }
static inline f8 f8_abs(f8 p) { EACH(fabsf(p.v[l])); }
static inline f8 f8_neg(f8 p) { EACH(-p.v[l]); }
static inline unsigned f8_le(f8 p, f8 q) { EACH_BIT(p.v[l] <= q.v[l]); }
static inline unsigned f8_gt(f8 p, f8 q) { EACH_BIT(p.v[l] > q.v[l]); }
#endif

static inline f8 f8_muladd(f8 p, f8 q, f8 r) { return f8_add(f8_mul(p, q), r); }
static inline f8 f8_nmuladd(f8 p, f8 q, f8 r) { return f8_sub(r, f8_mul(p, q)); }
static inline f8 f8_mulsub(f8 p, f8 q, f8 r) { return f8_sub(f8_mul(p, q), r); }

#define FUSED 0
#define GN_REF_KERNEL gn_ref_certified_run_portable
#define GN_REF_KERNEL_START gn_ref_certified_start_portable
#include "reference/certified_kernel.h"
