/* SPDX-License-Identifier: Apache-2.0 */
/* The committed hit and its vertices, read back from the structure, then or when it was a candidate. */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing_position_fetch : require
#extension GL_EXT_ray_query : require

vec3 asked[3], kept[3];
#define CANDIDATE_ASK()                                                                                            \
    if (way(FROM_CANDIDATE) &&                                                                                     \
        rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {              \
        rayQueryGetIntersectionTriangleVertexPositionsEXT(query, false, asked);                                    \
    }
#define CANDIDATE_KEEP() kept = asked
#include "query.glsl"

layout(local_size_x = 64) in;

layout(set = 0, binding = 3, std430) writeonly buffer Positions { Vertices positions[]; };

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

    vec3 vertices[3] = vec3[3](vec3(0.0), vec3(0.0), vec3(0.0));
    if (answer.kind == TRIANGLE && way(FROM_CANDIDATE)) {
        vertices = kept;
    } else if (answer.kind == TRIANGLE) {
        rayQueryGetIntersectionTriangleVertexPositionsEXT(query, true, vertices);
    }
    for (uint vertex = 0; vertex < 3; vertex++) {
        for (uint axis = 0; axis < 3; axis++) {
            positions[index].values[vertex * 3 + axis] = vertices[vertex][axis];
        }
    }
}
