#version 460
/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the vertices of what it hits: every other lane asks the instance that stands 10 away. */
#extension GL_EXT_ray_query : require
#extension GL_EXT_ray_tracing_position_fetch : require
layout(local_size_x = 8) in;
layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(set = 0, binding = 1, std430) buffer Output { float output_[]; };
layout(push_constant) uniform Choices {
    uint both;
};
void main()
{
    rayQueryEXT q;
    vec3 corners[3];
    uint lane = gl_GlobalInvocationID.x;
    vec3 origin = vec3(0.25 + 10 * float(both & lane), 0.25, -1);
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, origin, 0.0, vec3(0, 0, 1), 100.0);
    rayQueryProceedEXT(q);
    if (rayQueryGetIntersectionTypeEXT(q, true) != gl_RayQueryCommittedIntersectionTriangleEXT)
        return;
    rayQueryGetIntersectionTriangleVertexPositionsEXT(q, true, corners);
    output_[lane] = 1 + corners[1].x;
}
