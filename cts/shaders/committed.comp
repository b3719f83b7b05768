/* SPDX-License-Identifier: Apache-2.0 */
/* The committed hit. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"

void main()
{
    const uint index = gl_GlobalInvocationID.x;
    if (index >= ray_count) {
        return;
    }
    const Ray ray = rays[index];
    query_begin(ray);
    if (query_decide_all(ray)) {
        committed[index] = answer_committed();
    } else {
        committed[index].kind = UNFINISHED;
    }
}
