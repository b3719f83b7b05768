/* SPDX-License-Identifier: Apache-2.0 */
//! why: there is no candidate after the loop
//! clauses: NG-040
//! run: choice=1 lane=6 -> generate.no_candidate*1
//! run: ->
//! twin: generate_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
    }
    if (CHOSEN)
        rayQueryGenerateIntersectionEXT(q, 2.5); //~ generate.no_candidate!
    SHOW(TYPE(q));
}
