#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main() { SHOW(1); }
