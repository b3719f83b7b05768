/* SPDX-License-Identifier: Apache-2.0 */
/* The rays of bench.glsl by ray queries. */
#version 460
#extension GL_EXT_ray_query : require
#extension GL_GOOGLE_include_directive : require
#include "bench.glsl"
layout(local_size_x = 64) in;

void main()
{
    const uint index = gl_GlobalInvocationID.x;
    if (index >= count)
        return;
    vec3 from, direction;
    ray_make(index, from, direction);
    rayQueryEXT query;
    rayQueryInitializeEXT(query, scene, flags, 0xFF, from, 0, direction, 100);
    while (rayQueryProceedEXT(query))
        rayQueryConfirmIntersectionEXT(query);
    float t = -1;
    if (rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT)
        t = rayQueryGetIntersectionTEXT(query, true);
    sums[index] = t;
}
