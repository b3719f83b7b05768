/* SPDX-License-Identifier: Apache-2.0 */
/* The closest-hit shader: says what was hit and, as the program asks, more. */
#include "candidate.glsl"
#include "detail.glsl"
#include "recursion.glsl"

hitAttributeEXT vec2 left_behind;

#ifdef FETCH_POSITIONS
layout(set = 0, binding = 3, std430) writeonly buffer Positions { Vertices positions[]; };

void positions_write(uint index, bool triangle)
{
    for (uint vertex = 0; vertex < 3; vertex++) {
        for (uint axis = 0; axis < 3; axis++) {
            positions[index].values[vertex * 3 + axis] =
                triangle ? gl_HitTriangleVertexPositionsEXT[vertex][axis] : 0.0;
        }
    }
}
#endif

void main()
{
    const uint index = ray_index();
    if (recursive && recurse(index)) {
        return;
    }
    Answer answer = answer_here();
    answer.t = gl_HitTEXT;
    const bool triangle = gl_HitKindEXT >= gl_HitKindFrontFacingTriangleEXT;
    if (triangle) {
        answer.kind = TRIANGLE;
        answer.front = gl_HitKindEXT == gl_HitKindFrontFacingTriangleEXT ? 1 : 0;
        answer.beta = left_behind.x;
        answer.gamma = left_behind.y;
    } else {
        /* What the intersection shader left with the hit that it reported, not with one that it reported later. */
        answer.kind = gl_HitKindEXT != (gl_PrimitiveID & 127)                                ? HIT_KIND
                      : left_behind.x != float(gl_PrimitiveID) || left_behind.y != gl_HitTEXT ? ATTRIBUTE
                                                                                             : GENERATED;
    }
    payload.answer = answer;
    if (program == DETAIL) {
        detail_ray(index);
        for (uint row = 0; row < 3; row++) {
            for (uint column = 0; column < 4; column++) {
                details[index].world_from_object[row * 4 + column] = gl_ObjectToWorldEXT[column][row];
                details[index].object_from_world[row * 4 + column] = gl_WorldToObjectEXT[column][row];
            }
            details[index].object_origin[row] = gl_ObjectRayOriginEXT[row];
            details[index].object_direction[row] = gl_ObjectRayDirectionEXT[row];
        }
    }
#ifdef FETCH_POSITIONS
    positions_write(index, triangle);
#endif
}
