#version 460
/* SPDX-License-Identifier: Apache-2.0 */
/* A ray per invocation into a field of triangles, or past it. */
#extension GL_EXT_ray_query : require
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(set = 0, binding = 1, std430) buffer Output { float output_[]; };
layout(push_constant) uniform Choices {
    uint flags;
    float away; /* 1: every ray passes the field by */
    uint which; /* of the queries */
};
#ifdef ARRAY
#define Q q[which]
#else
#define Q q
#endif
uint state;
float random()
{
    state = state * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28) + 4)) ^ state) * 277803737u;
    return float((word >> 22 ^ word) & 0xFFFFFFu) / 16777216.0;
}
void main()
{
#ifdef ARRAY
    rayQueryEXT q[2];
#else
    rayQueryEXT q;
#endif
    state = gl_GlobalInvocationID.x;
    vec3 origin = vec3(random() * 128, random() * 128, -1 - 1000 * away);
    vec3 direction = normalize(vec3(random() - 0.5, random() - 0.5, 0.5 - 1.5 * away));
    float t = -1;
    rayQueryInitializeEXT(Q, scene, flags, 0xFF, origin, 0.0, direction, 1000.0);
    while (rayQueryProceedEXT(Q)) {
        if (rayQueryGetIntersectionTypeEXT(Q, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
            vec2 at = rayQueryGetIntersectionBarycentricsEXT(Q, false);
            if (at.x + at.y > 0.05)
                rayQueryConfirmIntersectionEXT(Q);
        }
    }
    if (rayQueryGetIntersectionTypeEXT(Q, true) == gl_RayQueryCommittedIntersectionTriangleEXT)
        t = rayQueryGetIntersectionTEXT(Q, true) + rayQueryGetIntersectionBarycentricsEXT(Q, true).x;
    output_[gl_GlobalInvocationID.x] = t;
}
