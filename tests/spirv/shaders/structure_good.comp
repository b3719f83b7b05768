/* SPDX-License-Identifier: Apache-2.0 */
//! why: a structure that was built, whose positions nobody reads
//! options: structures=9
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsOpaqueEXT); //~ structure.none? structure.never_built? structure.destroyed? structure.bottom_level?
    rayQueryProceedEXT(q);
    SHOW(TYPE(q));
}
