/* SPDX-License-Identifier: Apache-2.0 */
//! why: after the loop WGSL agrees
//! clauses: NG-029 NG-032
//! options: profile=wgpu
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q) == NOTHING ? 0 : rayQueryGetIntersectionTEXT(q, true));
}
