/* SPDX-License-Identifier: Apache-2.0 */
/* Says what was hit. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "hit.glsl"
