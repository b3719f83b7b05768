/* SPDX-License-Identifier: Apache-2.0 */
/* The committed hit of a ray query in a closest-hit shader. */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing : require
#include "query.glsl"

struct Payload {
    uint index;
    Answer answer;
};
layout(location = 0) rayPayloadInEXT Payload payload;

void main()
{
    payload.answer = query_answer(rays[payload.index]);
}
