/* SPDX-License-Identifier: Apache-2.0 */
/* What every test shader of ray queries starts with. The push constants let a test decide at run time what the compiler must not
 * know. Stages other than compute define LANE first: which of the invocations this is. */
#extension GL_EXT_ray_query : require
#extension GL_EXT_ray_flags_primitive_culling : require
#ifndef LANE
layout(local_size_x = 8) in;
#define LANE gl_GlobalInvocationID.x
#endif
layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(set = 0, binding = 1, std430) buffer Output { float output_[]; };
layout(push_constant) uniform Choices {
    uint choice;
    float value;
    uint lane; /* where `choice` applies, or ~0 for every lane */
};
#define CHOSEN (choice != 0 && (lane == ~0u || lane == LANE))
#define SHOW(shown) output_[LANE] = float(shown)
#define START(query, flags) \
    rayQueryInitializeEXT(query, scene, flags, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0)
#define TRIANGLE gl_RayQueryCommittedIntersectionTriangleEXT
#define GENERATED gl_RayQueryCommittedIntersectionGeneratedEXT
#define NOTHING gl_RayQueryCommittedIntersectionNoneEXT
#define TYPE(query) rayQueryGetIntersectionTypeEXT(query, true)
#define CANDIDATE(query) rayQueryGetIntersectionTypeEXT(query, false)
#define AT_TRIANGLE gl_RayQueryCandidateIntersectionTriangleEXT
#define AT_BOX gl_RayQueryCandidateIntersectionAABBEXT
#define INFINITY uintBitsToFloat(0x7F800000)
