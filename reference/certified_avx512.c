/* SPDX-License-Identifier: Apache-2.0 */
/* The kernel of certified.h for AVX-512. Compiled with it enabled, entered only where the processor has it. */
#include "reference/certified.h"

#if defined(__AVX512F__) && defined(__AVX512DQ__) && defined(__AVX512VL__)
#include <immintrin.h>

typedef __m256 f8;

static inline f8 f8_set1(float a) { return _mm256_set1_ps(a); }
static inline f8 f8_load(const float *a) { return _mm256_loadu_ps(a); }
static inline f8 f8_load_i16(const int16_t *a)
{
    return _mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(_mm_loadu_si128((const __m128i *)(const void *)a)));
}
static inline void f8_store(float *to, f8 a) { _mm256_storeu_ps(to, a); }
static inline f8 f8_add(f8 a, f8 b) { return _mm256_add_ps(a, b); }
static inline f8 f8_sub(f8 a, f8 b) { return _mm256_sub_ps(a, b); }
static inline f8 f8_mul(f8 a, f8 b) { return _mm256_mul_ps(a, b); }
static inline f8 f8_max(f8 a, f8 b) { return _mm256_max_ps(a, b); }
static inline f8 f8_min(f8 a, f8 b) { return _mm256_min_ps(a, b); }
static inline f8 f8_muladd(f8 a, f8 b, f8 c) { return _mm256_fmadd_ps(a, b, c); }
static inline f8 f8_nmuladd(f8 a, f8 b, f8 c) { return _mm256_fnmadd_ps(a, b, c); }
static inline f8 f8_mulsub(f8 a, f8 b, f8 c) { return _mm256_fmsub_ps(a, b, c); }
static inline f8 f8_abs(f8 a) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a); }
static inline f8 f8_neg(f8 a) { return _mm256_xor_ps(_mm256_set1_ps(-0.0f), a); }
static inline unsigned f8_le(f8 a, f8 b) { return _mm256_cmp_ps_mask(a, b, _CMP_LE_OQ); }
static inline unsigned f8_gt(f8 a, f8 b) { return _mm256_cmp_ps_mask(a, b, _CMP_GT_OQ); }

#define FUSED 1
#define GN_REF_KERNEL gn_ref_certified_run_avx512
#define GN_REF_KERNEL_START gn_ref_certified_start_avx512
#include "reference/certified_kernel.h"
#endif
