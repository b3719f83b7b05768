/* SPDX-License-Identifier: Apache-2.0 */
/* A hit or candidate as closest-hit, any-hit and intersection shaders see it, but for what only triangles have. */
#include "pipeline.glsl"

layout(set = 0, binding = 3, std430) buffer Presented { Candidates presented[]; };
/* A record knows its place in the table. */
layout(shaderRecordEXT, std430) buffer Record { uint record_index; };

Answer answer_here()
{
    Answer answer = answer_nothing();
    answer.instance = gl_InstanceID;
    answer.geometry = gl_GeometryIndexEXT;
    answer.primitive = gl_PrimitiveID;
    answer.custom_index = gl_InstanceCustomIndexEXT;
    answer.sbt_offset = record_index - record_offset - record_stride * gl_GeometryIndexEXT;
    return answer;
}

/* Invocations of one ray follow one another, but what they write is not seen by the next; an atomic is. */
void present(Answer answer)
{
    const uint index = ray_index();
    const uint place = atomicAdd(presented[index].count, 1);
    if (place < MAX_CANDIDATES) {
        presented[index].list[place] = answer;
    }
}
