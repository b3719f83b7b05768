/* SPDX-License-Identifier: Apache-2.0 */
//! why: initialized on one of two paths
//! run: choice=1 lane=4 -> use.uninitialized*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    if (!CHOSEN)
        START(q, gl_RayFlagsOpaqueEXT);
    float t = 0;
    SHOW(rayQueryGetRayFlagsEXT(q)); //~ use.uninitialized?
}
