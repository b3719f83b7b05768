/* SPDX-License-Identifier: Apache-2.0 */
/* What the shaders of one pipeline share: a callable is called, and hits trace again as deep as they are told. */
#extension GL_EXT_ray_tracing : require
layout(set = 0, binding = 0) uniform accelerationStructureEXT scene;
layout(set = 0, binding = 1) buffer Out { float result[]; };
layout(push_constant) uniform Push { uint call, depth, flags; };
#define TRACE traceRayEXT(scene, flags, 0xFF, 0, 0, 0, vec3(0.25, 0.25, -1), 0, vec3(0, 0, 1), 10, 0)
