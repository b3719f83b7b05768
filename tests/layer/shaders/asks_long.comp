#version 460
/* SPDX-License-Identifier: Apache-2.0 */
/* Counts candidates, and misuses queries in many ways where `wrong` says so; what is shown is defined in safe mode. */
#extension GL_EXT_ray_query : require
layout(local_size_x = 8) in;
layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(set = 0, binding = 1, std430) buffer Output { float output_[]; };
layout(push_constant) uniform Choices {
    uint wrong;
};
void main()
{
    rayQueryEXT q, never;
    uint count = 0;
    if (wrong == 1) {
        rayQueryInitializeEXT(never, scene, gl_RayFlagsNoneEXT, 0xFF, vec3(0), 0.0, vec3(0, 0, 1), -1.0);
    }
    rayQueryInitializeEXT(q, scene, gl_RayFlagsNoOpaqueEXT, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0);
    while (rayQueryProceedEXT(q))
        count++;
    float shown = float(count);
    if (wrong != 0) {
        shown += rayQueryProceedEXT(never) ? 1000.0 : 0.0;
        shown += rayQueryGetIntersectionTypeEXT(never, true) == gl_RayQueryCommittedIntersectionNoneEXT ? 0.5 : 1000.0;
        shown += rayQueryGetIntersectionTEXT(q, true) + rayQueryGetIntersectionTEXT(q, false);
        rayQueryConfirmIntersectionEXT(q);
        rayQueryGenerateIntersectionEXT(q, 5.0);
        rayQueryTerminateEXT(q);
        shown += rayQueryGetIntersectionBarycentricsEXT(never, true).x + rayQueryGetIntersectionObjectToWorldEXT(never, false)[0].x;
    }
    output_[gl_GlobalInvocationID.x] = shown;
}
