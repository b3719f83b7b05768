/* SPDX-License-Identifier: Apache-2.0 */
//! why: NG-029: nothing can be committed yet
//! clauses: NG-029
//! run: -> committed.none*8
//! twin: closest_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    SHOW(rayQueryGetIntersectionTEXT(q, true)); //~ committed.none!
}
