/* SPDX-License-Identifier: Apache-2.0 */
/* What every test shader starts with. The push constants let a test decide at run time what the compiler must not know. */
#extension GL_EXT_ray_query : require
#extension GL_EXT_ray_flags_primitive_culling : require
layout(local_size_x = 8) in;
layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(set = 0, binding = 1, std430) buffer Output { float output_[]; };
layout(push_constant) uniform Choices {
    uint choice;
    float value;
    uint lane; /* where `choice` applies, or ~0 for every lane */
};
#define CHOSEN (choice != 0 && (lane == ~0u || lane == gl_GlobalInvocationID.x))
#define SHOW(shown) output_[gl_GlobalInvocationID.x] = float(shown)
#define START(query, flags) \
    rayQueryInitializeEXT(query, scene, flags, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0)
#define TRIANGLE gl_RayQueryCommittedIntersectionTriangleEXT
