#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_EXT_ray_query : require
layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(location = 0) in vec3 direction;
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, vec3(gl_VertexIndex), 0.0, direction, 10.0);
    bool more = rayQueryProceedEXT(q);
    gl_Position = vec4(rayQueryGetIntersectionObjectRayOriginEXT(q, true), more ? 1 : 0);
}
