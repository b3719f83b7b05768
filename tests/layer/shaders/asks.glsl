/* SPDX-License-Identifier: Apache-2.0 */
/* One ray per invocation, and one more Proceed than is allowed where `wrong` says so. */
#extension GL_EXT_ray_query : require
layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(push_constant) uniform Choices {
    uint wrong;
};
float ask(bool too_often)
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0);
    for (uint i = 0; i <= uint(too_often); i++)
        rayQueryProceedEXT(q);
    if (rayQueryGetIntersectionTypeEXT(q, true) == gl_RayQueryCommittedIntersectionNoneEXT)
        return -1;
    return rayQueryGetIntersectionTEXT(q, true);
}
