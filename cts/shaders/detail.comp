/* SPDX-License-Identifier: Apache-2.0 */
/* The committed hit and everything else that a query can be asked about it, then or when it was a candidate. */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_query : require

struct Asked {
    mat4x3 world_from_object, object_from_world;
    vec3 object_origin, object_direction;
    vec3 world_origin, world_direction;
    float tmin;
    uint flags;
};
Asked asked, kept;

/* The getters take a constant for which of the two they are about. */
#define ASK(committed)                                                                \
    asked.world_from_object = rayQueryGetIntersectionObjectToWorldEXT(query, committed); \
    asked.object_from_world = rayQueryGetIntersectionWorldToObjectEXT(query, committed); \
    asked.object_origin = rayQueryGetIntersectionObjectRayOriginEXT(query, committed);   \
    asked.object_direction = rayQueryGetIntersectionObjectRayDirectionEXT(query, committed)
#define ASK_RAY()                                                  \
    asked.world_origin = rayQueryGetWorldRayOriginEXT(query);       \
    asked.world_direction = rayQueryGetWorldRayDirectionEXT(query); \
    asked.tmin = rayQueryGetRayTMinEXT(query);                      \
    asked.flags = rayQueryGetRayFlagsEXT(query)
#define CANDIDATE_ASK()        \
    if (way(FROM_CANDIDATE)) { \
        ASK(false);            \
        ASK_RAY();             \
    }
#define CANDIDATE_KEEP() kept = asked
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

    if (answer.kind == NOTHING) {
        asked = Asked(mat4x3(0.0), mat4x3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), 0.0, 0);
        ASK_RAY();
    } else if (way(FROM_CANDIDATE)) {
        asked = kept;
    } else {
        ASK(true);
        ASK_RAY();
    }
    for (uint row = 0; row < 3; row++) {
        for (uint column = 0; column < 4; column++) {
            details[index].world_from_object[row * 4 + column] = asked.world_from_object[column][row];
            details[index].object_from_world[row * 4 + column] = asked.object_from_world[column][row];
        }
        details[index].object_origin[row] = asked.object_origin[row];
        details[index].object_direction[row] = asked.object_direction[row];
        details[index].world_origin[row] = asked.world_origin[row];
        details[index].world_direction[row] = asked.world_direction[row];
    }
    details[index].tmin = asked.tmin;
    details[index].flags = asked.flags;
}
