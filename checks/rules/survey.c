/* SPDX-License-Identifier: Apache-2.0 */
/* The survey of a TLAS build's instances, and the exact sign of a determinant. */
#include "checks/rules/survey.h"

#include <string.h>

/* Products of two floats are exact in double. A product of three needs at most 72 bits, between 2^-447 and 2^384: its two parts
 * are exact doubles, and nothing overflows or underflows. */
static void product_exact(double two_factors, double third, double *out_high, double *out_low)
{
    const double splitter = 134217729; /* 2^27 + 1 */
    double product = two_factors * third;
    double c = splitter * two_factors;
    double high = c - (c - two_factors), low = two_factors - high;
    /* `third` has 24 bits, so that both partial products are exact. */
    *out_high = product;
    *out_low = (high * third - product) + low * third;
}

/* Adds `value` to an expansion: terms that do not overlap, in rising order of magnitude, whose sum is exact. */
static int expansion_grow(double *terms, int count, double value)
{
    double sum = value;
    int kept = 0;
    for (int i = 0; i < count; i++) {
        double a = sum, b = terms[i];
        sum = a + b;
        double b_seen = sum - a;
        double rest = (a - (sum - b_seen)) + (b - b_seen);
        if (rest != 0)
            terms[kept++] = rest;
    }
    if (sum != 0)
        terms[kept++] = sum;
    return kept;
}

/* The six products of the determinant: columns taken from rows 0, 1 and 2, and the sign. */
static const struct {
    unsigned char column[3];
    signed char sign;
} permutations[6] = {{{0, 1, 2}, 1}, {{1, 2, 0}, 1}, {{2, 0, 1}, 1}, {{2, 1, 0}, -1}, {{1, 0, 2}, -1}, {{0, 2, 1}, -1}};

/* Not by conversion: an application may have told the processor to take denormal floats for zero. */
static double widen(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    if (bits & 0x7F800000u)
        return value;
    return (bits >> 31 ? -0x1p-149 : 0x1p-149) * (double)(bits & 0x7FFFFFu);
}

static int orientation_slow(const float m[12])
{
    double terms[12];
    int count = 0;
    for (int i = 0; i < 6; i++) {
        double pair = widen(m[permutations[i].column[0]]) * widen(m[4 + permutations[i].column[1]]);
        double high, low;
        product_exact(permutations[i].sign * pair, widen(m[8 + permutations[i].column[2]]), &high, &low);
        count = expansion_grow(terms, count, low);
        count = expansion_grow(terms, count, high);
    }
    if (!count)
        return 0;
    return terms[count - 1] > 0 ? 1 : -1; /* the largest term decides */
}

int gn_transform_orientation_exact(const float m[12])
{
    double a = (double)m[0] * ((double)m[5] * m[10]), b = (double)m[1] * ((double)m[6] * m[8]);
    double c = (double)m[2] * ((double)m[4] * m[9]), d = (double)m[2] * ((double)m[5] * m[8]);
    double e = (double)m[1] * ((double)m[4] * m[10]), f = (double)m[0] * ((double)m[6] * m[9]);
    double value = (a + b + c) - (d + e + f);
    /* Each product is rounded once, each of five additions once: in all at most 6 units of 2^-53 times the sum of the
     * magnitudes, with terms of second order far below the two units to spare. The sum itself may be rounded down a little. */
    double bound = (__builtin_fabs(a) + __builtin_fabs(b) + __builtin_fabs(c) + __builtin_fabs(d) + __builtin_fabs(e) + __builtin_fabs(f)) * 0x1p-50;
    if (value > bound)
        return 1;
    if (value < -bound)
        return -1;
    return orientation_slow(m);
}

static void note(struct gn_survey_class *out, uint32_t index)
{
    if (!out->count++)
        out->first = index;
}

static bool is_finite(uint32_t word)
{
    return (word & 0x7F800000u) != 0x7F800000u;
}

/* Whether all 12 floats lie below 2^64 in magnitude, and the 3x3 part is invertible for certain. This is what nearly every instance
 * passes, and cheap: anything that it leaves open is looked at again. Products of three are rounded twice, sums three times, so that
 * 16 units of 2^-24 of the sum of magnitudes are more than enough; what is lost to underflow is at most 9 * 2^64 * 2^-149; and where
 * something overflows, no comparison with infinity holds. */
static bool is_plain(const float m[12])
{
    uint32_t words[12], unusual = 0;
    memcpy(words, m, sizeof words);
    for (int i = 0; i < 12; i++)
        unusual |= (words[i] & 0x7FFFFFFFu) + 0x20800000u; /* 2^64 and above carry into the sign */
    float a = m[0] * (m[5] * m[10]), b = m[1] * (m[6] * m[8]), c = m[2] * (m[4] * m[9]);
    float d = m[2] * (m[5] * m[8]), e = m[1] * (m[4] * m[10]), f = m[0] * (m[6] * m[9]);
    float value = __builtin_fabsf((a + b + c) - (d + e + f));
    float sum = (__builtin_fabsf(a) + __builtin_fabsf(b) + __builtin_fabsf(c)) + (__builtin_fabsf(d) + __builtin_fabsf(e) + __builtin_fabsf(f));
    return !(unusual >> 31) && value > sum * 0x1p-20f && value > 0x1p-60f;
}

/* Whether word `i` carried out of its lower 24 bits: three neighbours rise by the same small step, and the upper 8 bits change with the
 * second or third. Instances of their own accord do not count through two fields at once. `word` 0: index and mask, 1: offset and flags. */
static uint32_t word_of(const struct gn_instance_record *instance, int word)
{
    return word ? instance->sbt_offset_and_flags : instance->custom_index_and_mask;
}

static bool carries(const struct gn_instance_record *instances, uint32_t count, uint32_t i, int which)
{
    if (i == 0)
        return false;
    uint32_t before = word_of(&instances[i - 1], which), word = word_of(&instances[i], which), step = word - before;
    if ((word >> 24) == (before >> 24) || !step || step > 0xFFFFu)
        return false;
    return (i >= 2 && before - word_of(&instances[i - 2], which) == step) ||
           (i + 1 < count && word_of(&instances[i + 1], which) - word == step);
}

/* Whether everything about the instance is as in nearly every instance, so that nothing but its offset has to be looked at. */
static bool is_ordinary(const struct gn_tlas_build *build, const struct gn_instance_record *instance, uint32_t last_mask,
                        uint32_t last_flags)
{
    uint32_t mask = instance->custom_index_and_mask >> 24, flags = instance->sbt_offset_and_flags >> 24;
    return mask == last_mask && mask && flags == last_flags && !(flags & ~build->valid_flags) && instance->reference &&
           is_plain(instance->object_to_world);
}

static void survey_matrix(const struct gn_instance_record *instance, uint32_t i, struct gn_survey *out)
{
    uint32_t words[12];
    bool finite = true;
    memcpy(words, instance->object_to_world, sizeof words);
    for (int k = 0; k < 12; k++)
        finite &= k % 4 == 3 || is_finite(words[k]);
    if (!is_finite(words[3]) || !is_finite(words[7]) || !is_finite(words[11]))
        note(&out->bad_translation, i);
    if (!finite || gn_transform_orientation_exact(instance->object_to_world) == 0)
        note(&out->bad_matrix, i);
}

static void survey_one(const struct gn_tlas_build *build, uint32_t i, struct gn_survey *out)
{
    const struct gn_instance_record *instance = &build->instances[i];
    uint32_t mask = instance->custom_index_and_mask >> 24;
    if (!instance->reference)
        return;
    if (i && instance[-1].reference) {
        if (carries(build->instances, build->instance_count, i, 0))
            note(&out->carry, i);
        if (carries(build->instances, build->instance_count, i, 1))
            note(&out->offset_carry, i);
    }
    out->active++;
    if (!mask)
        note(&out->mask_zero, i);
    if (instance->sbt_offset_and_flags >> 24 & ~build->valid_flags)
        note(&out->bad_flags, i);
    if (!is_plain(instance->object_to_world))
        survey_matrix(instance, i, out);
}

/* What was declared of the instances; nearly always that is nothing. */
static void survey_declared(const struct gn_tlas_build *build, uint32_t first, uint32_t end, struct gn_survey *out)
{
    for (uint32_t i = first; i < end; i++) {
        const struct gn_instance_record *instance = &build->instances[i];
        uint32_t mask = instance->custom_index_and_mask >> 24;
        if (!instance->reference)
            continue;
        if (build->declared_masks && !(build->declared_masks[mask / 64] >> (mask % 64) & 1))
            note(&out->mask_undeclared, i);
        if (build->custom_index_bound && (instance->custom_index_and_mask & 0xFFFFFFu) >= build->custom_index_bound)
            note(&out->index_above, i);
        if (build->sbt_offset_bound && (instance->sbt_offset_and_flags & 0xFFFFFFu) >= build->sbt_offset_bound)
            note(&out->offset_above, i);
    }
}

void gn_survey_add(const struct gn_tlas_build *build, uint32_t first, uint32_t count, struct gn_survey *out)
{
    const struct gn_instance_record *before = count ? &build->instances[first ? first - 1 : 0] : NULL;
    uint32_t last_mask = before ? before->custom_index_and_mask >> 24 : 0, last_flags = before ? before->sbt_offset_and_flags >> 24 : 0;
    for (uint32_t i = first; i < first + count; i++) {
        const struct gn_instance_record *instance = &build->instances[i];
        uint32_t offset = instance->sbt_offset_and_flags & 0xFFFFFFu;
        if (is_ordinary(build, instance, last_mask, last_flags)) {
            out->active++;
        } else {
            last_mask = instance->custom_index_and_mask >> 24;
            last_flags = instance->sbt_offset_and_flags >> 24;
            survey_one(build, i, out);
        }
        if (offset > out->highest_offset && instance->reference && last_mask) {
            out->highest_offset = offset;
            out->highest_offset_at = i;
        }
    }
    if (build->declared_masks || build->custom_index_bound || build->sbt_offset_bound)
        survey_declared(build, first, first + count, out);
}
