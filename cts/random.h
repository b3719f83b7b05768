/* SPDX-License-Identifier: Apache-2.0 */
/* Seeded random numbers, the same everywhere: splitmix64 for the state, so that any seed is a good one. */
#ifndef GNOMON_CTS_RANDOM_H
#define GNOMON_CTS_RANDOM_H

#include <stdint.h>

struct gn_random {
    uint64_t state;
};

static inline uint64_t gn_random_u64(struct gn_random *random)
{
    uint64_t z = (random->state += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

/* In [0, n); n is not 0. */
static inline uint32_t gn_random_below(struct gn_random *random, uint32_t n)
{
    return (uint32_t)(((gn_random_u64(random) >> 32) * n) >> 32);
}

/* In [0, 1), a multiple of 2^-53. */
static inline double gn_random_unit(struct gn_random *random)
{
    return (double)(gn_random_u64(random) >> 11) * 0x1p-53;
}

static inline double gn_random_range(struct gn_random *random, double from, double to)
{
    return from + (to - from) * gn_random_unit(random);
}

#endif
