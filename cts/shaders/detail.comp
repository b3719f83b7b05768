/* SPDX-License-Identifier: Apache-2.0 */
/* The committed hit and everything else that a query can be asked about it. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"

layout(local_size_x = 64) in;

layout(set = 0, binding = 3, std430) writeonly buffer Details { Detail details[]; };

void main()
{
    const uint index = gl_GlobalInvocationID.x;
    if (index >= ray_count) {
        return;
    }
    const Ray ray = rays[index];
    query_begin(ray);
    if (!query_decide_all(ray)) {
        committed[index].kind = UNFINISHED;
        return;
    }
    const Answer answer = answer_committed();
    committed[index] = answer;

    const vec3 world_origin = rayQueryGetWorldRayOriginEXT(query);
    const vec3 world_direction = rayQueryGetWorldRayDirectionEXT(query);
    mat4x3 world_from_object = mat4x3(0.0);
    mat4x3 object_from_world = mat4x3(0.0);
    vec3 object_origin = vec3(0.0);
    vec3 object_direction = vec3(0.0);
    if (answer.kind != NOTHING) {
        world_from_object = rayQueryGetIntersectionObjectToWorldEXT(query, true);
        object_from_world = rayQueryGetIntersectionWorldToObjectEXT(query, true);
        object_origin = rayQueryGetIntersectionObjectRayOriginEXT(query, true);
        object_direction = rayQueryGetIntersectionObjectRayDirectionEXT(query, true);
    }
    for (uint row = 0; row < 3; row++) {
        for (uint column = 0; column < 4; column++) {
            details[index].world_from_object[row * 4 + column] = world_from_object[column][row];
            details[index].object_from_world[row * 4 + column] = object_from_world[column][row];
        }
        details[index].object_origin[row] = object_origin[row];
        details[index].object_direction[row] = object_direction[row];
        details[index].world_origin[row] = world_origin[row];
        details[index].world_direction[row] = world_direction[row];
    }
    details[index].tmin = rayQueryGetRayTMinEXT(query);
    details[index].flags = rayQueryGetRayFlagsEXT(query);
}
