/* SPDX-License-Identifier: Apache-2.0 */
//! why: the loop is in a function, and called twice
//! clauses: NG-018
//! run: choice=1 lane=2 -> proceed.after_false*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void finish(rayQueryEXT q)
{
    while (rayQueryProceedEXT(q)) { //~ proceed.after_false?
    }
}
void main()
{
    SHOW(0);
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    finish(q);
    if (CHOSEN)
        finish(q);
}
