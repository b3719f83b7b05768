/* SPDX-License-Identifier: Apache-2.0 */
//! why: NG-045: one lane misbehaves
//! clauses: NG-018 NG-045
//! run: choice=1 lane=6 -> proceed.after_false*1
//! run: ->
//! twin: closest_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
    }
    uint n = 0;
    if (CHOSEN)
        n = rayQueryProceedEXT(q) ? 1 : 0; //~ proceed.after_false!
    SHOW(n);
}
