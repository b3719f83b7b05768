/* SPDX-License-Identifier: Apache-2.0 */
//! why: the loop ended with a false
//! clauses: NG-018
//! run: -> proceed.after_false*8
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
    SHOW(rayQueryProceedEXT(q) ? 1 : 0); //~ proceed.after_false!
}
