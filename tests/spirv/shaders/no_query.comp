/* SPDX-License-Identifier: Apache-2.0 */
//! why: without queries nothing is touched
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main() { SHOW(1); }
