/* SPDX-License-Identifier: Apache-2.0 */
/* Says that nothing was hit, and by which record it was called. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "pipeline.glsl"
#include "detail.glsl"
#include "recursion.glsl"

layout(shaderRecordEXT, std430) buffer Record { uint record_index; };

void main()
{
    const uint index = ray_index();
    if (recursive && recurse(index)) {
        return;
    }
    payload.answer = answer_nothing();
    if (gl_RayTmaxEXT != rays[index].tmax) {
        payload.answer.kind = TMAX;
    }
    payload.miss_record = record_index;
    if (program == DETAIL) {
        detail_ray(index);
        for (uint i = 0; i < 12; i++) {
            details[index].world_from_object[i] = 0.0;
            details[index].object_from_world[i] = 0.0;
        }
        for (uint i = 0; i < 3; i++) {
            details[index].object_origin[i] = 0.0;
            details[index].object_direction[i] = 0.0;
        }
    }
}
