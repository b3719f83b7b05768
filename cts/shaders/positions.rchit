/* SPDX-License-Identifier: Apache-2.0 */
/* Says what was hit, and its vertices, read back from the structure. */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing_position_fetch : require
#define FETCH_POSITIONS
#include "hit.glsl"
