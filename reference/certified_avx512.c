/* SPDX-License-Identifier: Apache-2.0 */
/* The kernel of certified.h for AVX-512. Compiled with it enabled, entered only where the processor has it. */
#include "reference/certified.h"

#if defined(__AVX512F__) && defined(__AVX512DQ__) && defined(__AVX512VL__)
#include <immintrin.h>

typedef __m256 f8;
typedef __m512d d8;

static inline f8 f8_set1(float a) { return _mm256_set1_ps(a); }
static inline f8 f8_load(const float *a) { return _mm256_loadu_ps(a); }
static inline f8 f8_max(f8 a, f8 b) { return _mm256_max_ps(a, b); }
static inline f8 f8_min(f8 a, f8 b) { return _mm256_min_ps(a, b); }
static inline f8 f8_mulsub(f8 a, f8 b, f8 c) { return _mm256_fmsub_ps(a, b, c); }
static inline void f8_store(float *to, f8 a) { _mm256_storeu_ps(to, a); }
static inline unsigned f8_le(f8 a, f8 b) { return _mm256_cmp_ps_mask(a, b, _CMP_LE_OQ); }

static inline d8 d8_set1(double a) { return _mm512_set1_pd(a); }
static inline d8 d8_load(const double *a) { return _mm512_loadu_pd(a); }
static inline d8 d8_load_f32(const float *a) { return _mm512_cvtps_pd(_mm256_loadu_ps(a)); }
static inline d8 d8_add(d8 a, d8 b) { return _mm512_add_pd(a, b); }
static inline d8 d8_sub(d8 a, d8 b) { return _mm512_sub_pd(a, b); }
static inline d8 d8_mul(d8 a, d8 b) { return _mm512_mul_pd(a, b); }
static inline d8 d8_div(d8 a, d8 b) { return _mm512_div_pd(a, b); }
static inline d8 d8_max(d8 a, d8 b) { return _mm512_max_pd(a, b); }
static inline d8 d8_min(d8 a, d8 b) { return _mm512_min_pd(a, b); }
static inline d8 d8_muladd(d8 a, d8 b, d8 c) { return _mm512_fmadd_pd(a, b, c); }
static inline d8 d8_nmuladd(d8 a, d8 b, d8 c) { return _mm512_fnmadd_pd(a, b, c); }
static inline d8 d8_abs(d8 a) { return _mm512_abs_pd(a); }
static inline d8 d8_neg(d8 a) { return _mm512_xor_pd(a, _mm512_set1_pd(-0.0)); }
static inline void d8_store(double *to, d8 a) { _mm512_storeu_pd(to, a); }
static inline unsigned d8_gt(d8 a, d8 b) { return _mm512_cmp_pd_mask(a, b, _CMP_GT_OQ); }
static inline unsigned d8_equal(d8 a, d8 b) { return _mm512_cmp_pd_mask(a, b, _CMP_EQ_OQ); }
static inline d8 d8_product_rest(d8 a, d8 b, d8 p) { return _mm512_fmsub_pd(a, b, p); }
static inline unsigned ids_used(const uint32_t *ids)
{
    return _mm256_cmpneq_epi32_mask(_mm256_loadu_si256((const __m256i *)(const void *)ids), _mm256_set1_epi32(-1));
}

#define FUSED 1
#define GN_REF_KERNEL gn_ref_certified_run_avx512
#define GN_REF_KERNEL_START gn_ref_certified_start_avx512
#include "reference/certified_kernel.h"
#endif
