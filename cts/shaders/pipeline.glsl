/* SPDX-License-Identifier: Apache-2.0 */
/* What the stages of ray tracing pipelines share: the payload, and what a hit is asked. */
#extension GL_EXT_ray_tracing : require
#extension GL_EXT_ray_flags_primitive_culling : require
#include "answer.glsl"

layout(primitive_culling);

const uint TERMINATE_ON_FIRST_HIT = 4, SKIP_CLOSEST_HIT = 8;

/* Values of `program`. */
const uint COMMITTED = 0, CANDIDATES = 1, DETAIL = 2, POSITIONS = 3;

/* Chosen where the pipeline is made, so that the plain ones do not pay for it. */
layout(constant_id = 0) const bool recursive = false;
layout(constant_id = 1) const bool through_callable = false;

struct Payload {
    Answer answer;
    uint miss_record; /* what the miss shader found in its record */
    uint level, returned; /* of recursion: how deep, and how many came back */
    uint ended; /* how often an any-hit shader has ended the ray */
    uint any_hits; /* how often the any-hit shader has run */
};

/* Which ray this invocation is about. */
uint ray_index()
{
    return (gl_LaunchIDEXT.z * height + gl_LaunchIDEXT.y) * width + gl_LaunchIDEXT.x;
}

Payload payload_new()
{
    Payload payload;
    payload.answer = answer_nothing();
    payload.answer.kind = UNTOUCHED;
    payload.miss_record = ~0u;
    payload.level = 0;
    payload.returned = 0;
    payload.ended = 0;
    payload.any_hits = 0;
    return payload;
}

vec3 ray_origin(Ray ray)
{
    return vec3(ray.origin_x, ray.origin_y, ray.origin_z);
}

vec3 ray_direction(Ray ray)
{
    return vec3(ray.direction_x, ray.direction_y, ray.direction_z);
}
