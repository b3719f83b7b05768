/* SPDX-License-Identifier: Apache-2.0 */
/* Two queries at a time, in turns, each with a ray of its own; neither may show in the other. */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_query : require
#define QUERY_DECLARED
rayQueryEXT queries[2];
#define query queries[0]
#include "query.glsl"
#undef query

layout(local_size_x = 64) in;

/* The other one confirms every triangle and passes boxes. */
bool other_goes_on()
{
    if (!rayQueryProceedEXT(queries[1])) {
        return false;
    }
    if (rayQueryGetIntersectionTypeEXT(queries[1], false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
        rayQueryConfirmIntersectionEXT(queries[1]);
    }
    return true;
}

void main()
{
    const uint index = gl_GlobalInvocationID.x;
    if (index >= ray_count) {
        return;
    }
    const Ray ray = rays[index], other = rays[ray_count - 1 - index];
    query_begin(ray);
    rayQueryInitializeEXT(queries[1], scene, other.flags, other.cull_mask,
                          vec3(other.origin_x, other.origin_y, other.origin_z), other.tmin,
                          vec3(other.direction_x, other.direction_y, other.direction_z), other.tmax);
    bool other_done = false;
    for (uint steps = 0; steps < MAX_STEPS; steps++) {
        other_done = other_done || !other_goes_on();
        if (!rayQueryProceedEXT(queries[0])) {
            committed[index] = answer_committed();
            return;
        }
        candidate_decide(ray);
    }
    committed[index].kind = UNFINISHED;
}
