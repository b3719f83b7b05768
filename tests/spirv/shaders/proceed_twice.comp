/* SPDX-License-Identifier: Apache-2.0 */
//! why: two Proceeds in one condition
//! clauses: NG-018
//! run: choice=1 -> proceed.after_false*8
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, CHOSEN ? gl_RayFlagsSkipAABBEXT | gl_RayFlagsOpaqueEXT : gl_RayFlagsNoneEXT);
    bool both = rayQueryProceedEXT(q);
    both = rayQueryProceedEXT(q) && both; //~ proceed.after_false?
    SHOW(both ? 1 : 0);
}
