/* SPDX-License-Identifier: Apache-2.0 */
//! why: a helper says whether there was a hit
//! clauses: NG-054
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
bool hit(rayQueryEXT q)
{
    return TYPE(q) != NOTHING;
}
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(hit(q) ? rayQueryGetIntersectionTEXT(q, true) : 0.0);
}
