/* SPDX-License-Identifier: Apache-2.0 */
/* Rays for measuring time: made from their index, answered by one number, so that little but tracing costs. */
layout(binding = 0) uniform accelerationStructureEXT scene;
layout(binding = 1) buffer Sums { float sums[]; };
layout(push_constant) uniform Push {
    uint count;      /* rays */
    uint incoherent; /* 0: a camera's; 1: from anywhere to anywhere */
    uint flags;
};

uint scramble(uint x)
{
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    return x ^ x >> 16;
}

float unit(uint x) { return float(scramble(x) >> 8) / 16777216.0; }

/* The scene lies over the square from 0 to 1, between the heights 0 and 0.2. */
void ray_make(uint index, out vec3 from, out vec3 direction)
{
    const uint side = 256;
    vec3 to = vec3(vec2(index % side, index / side % side) / float(side), 0.1);
    from = vec3(0.5, 0.5, 2);
    if (incoherent != 0) {
        from = vec3(unit(6 * index), unit(6 * index + 1), 0.3 + 0.2 * unit(6 * index + 2));
        to = vec3(unit(6 * index + 3), unit(6 * index + 4), 0.1 * unit(6 * index + 5));
    }
    direction = to - from;
}
