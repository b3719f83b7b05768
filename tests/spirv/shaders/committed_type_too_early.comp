/* SPDX-License-Identifier: Apache-2.0 */
//! why: in WGSL even the kind waits
//! clauses: NG-029 NG-032
//! options: profile=wgpu
//! run: choice=1 lane=5 -> committed.too_early*1
//! run: ->
//! twin: committed_in_time.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    uint kind = CHOSEN ? TYPE(q) : 0; //~ committed.too_early!
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(kind + TYPE(q));
}
