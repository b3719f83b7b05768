#version 460
/* SPDX-License-Identifier: Apache-2.0 */
/* Traces through the element `wrong` of an array of structures, of which only some need be there. */
#extension GL_EXT_ray_query : require
layout(local_size_x = 8) in;
layout(set = 0, binding = 0) uniform accelerationStructureEXT scenes[4];
layout(set = 0, binding = 1, std430) buffer Output { float output_[]; };
layout(push_constant) uniform Choices {
    uint wrong;
};
void main()
{
    rayQueryEXT q;
    float t = -1;
    if (wrong != 100) {
        rayQueryInitializeEXT(q, scenes[wrong], gl_RayFlagsOpaqueEXT, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0);
        while (rayQueryProceedEXT(q)) {
        }
        if (rayQueryGetIntersectionTypeEXT(q, true) != gl_RayQueryCommittedIntersectionNoneEXT)
            t = rayQueryGetIntersectionTEXT(q, true);
    }
    output_[gl_GlobalInvocationID.x] = t;
}
