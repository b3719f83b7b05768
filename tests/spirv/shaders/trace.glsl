/* SPDX-License-Identifier: Apache-2.0 */
/* What every test shader of a ray-tracing pipeline starts with, see query.glsl. */
#extension GL_EXT_ray_tracing : require
#extension GL_EXT_ray_flags_primitive_culling : require
layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(set = 0, binding = 1, std430) buffer Output { float output_[]; };
layout(push_constant) uniform Choices {
    uint choice;
    float value;
    uint lane; /* where `choice` applies, or ~0 for every lane */
};
#define CHOSEN (choice != 0 && (lane == ~0u || lane == gl_LaunchIDEXT.x))
#define SHOW(shown) output_[gl_LaunchIDEXT.x] = float(shown)
#define ORIGIN vec3(0.25, 0.25, -1)
#define DIRECTION vec3(0, 0, 1)
