/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What every shader of the suite shares: the rays, the answers, and the words for what kind of answer it is.
 *
 * The layout of the buffers is that of struct gpu_ray in cts/device_trace.c and of the answers in
 * reference/verdict.h and cts/scene.h: scalars only, so that std430 and C agree.
 */

/* Beyond GENERATED nothing was hit, but something went wrong: gn_answer_fault() in cts/device_trace.c has the words. */
const uint NOTHING = 0, TRIANGLE = 1, GENERATED = 2, UNFINISHED = 3, UNTOUCHED = 4, CONTRADICTED = 5, ATTRIBUTE = 6,
           HIT_KIND = 7, MISS_RECORD = 8, RAYGEN_RECORD = 9, RETURNED = 10, LAUNCH = 11,
           WENT_ON = 12, NOT_ENDED = 13, TMAX = 14, PAYLOAD = 15;

const uint MAX_CANDIDATES = 64;

struct Ray {
    float origin_x, origin_y, origin_z, tmin;
    float direction_x, direction_y, direction_z, tmax;
    uint flags, cull_mask, confirm_mask, generate_mask;
    float generate_t0, generate_step;
    uint unused_0, unused_1;
};

struct Answer {
    uint kind;
    uint instance, geometry, primitive;
    uint custom_index, sbt_offset;
    uint front;
    float t;
    float beta, gamma;
};

struct Candidates {
    uint count;
    Answer list[MAX_CANDIDATES];
};

struct Detail {
    float world_from_object[12];
    float object_from_world[12];
    float object_origin[3];
    float object_direction[3];
    float world_origin[3];
    float world_direction[3];
    float tmin;
    uint flags;
};

struct Vertices {
    float values[9];
};

layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(set = 0, binding = 1, std430) readonly buffer Rays { Ray rays[]; };
layout(set = 0, binding = 2, std430) writeonly buffer Committed { Answer committed[]; };
/* struct constants in cts/device_trace.c; ray queries take the number of rays only. */
layout(push_constant) uniform Constants {
    uint ray_count;
    uint program; /* enum gn_cts_program */
    uint record_offset, record_stride, miss_index;
    uint depth;
    uint width, height; /* of the launch */
    uint ways; /* a sum of those below */
    uvec2 scene_address;
};
/* struct gn_cts_route has them as names; enum gn_trace_way in cts/device_internal.h has the numbers. */
const uint TRAPS = 1, OPAQUE_BOXES = 2, FROM_CANDIDATE = 4, TERMINATE = 8, WIDE = 16, REPORTS = 32, COUNTED = 64,
           ANY_HIT_REFUSES = 128, ANY_HIT_ENDS = 256;

bool way(uint which)
{
    return (ways & which) != 0;
}

Answer answer_nothing()
{
    return Answer(NOTHING, 0, 0, 0, 0, 0, 0, 0.0, 0.0, 0.0);
}

/* Where the ray's policy wants a hit on a box. */
float generated_t(Ray ray, uint primitive)
{
    precise const float t = ray.generate_t0 + ray.generate_step * float(primitive);
    return t;
}
