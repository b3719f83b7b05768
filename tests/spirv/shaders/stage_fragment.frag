#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_EXT_ray_query : require
layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(location = 0) in vec3 direction;
layout(location = 0) out vec4 color;
void main()
{
    rayQueryEXT q;
    if (direction.x > 0.9)
        discard;
    rayQueryInitializeEXT(q, scene, gl_RayFlagsNoneEXT, 0xFF, vec3(0), 0.0, direction, 10.0);
    while (rayQueryProceedEXT(q)) {
    }
    color = vec4(rayQueryGetIntersectionTEXT(q, true));
}
