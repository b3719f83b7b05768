/* SPDX-License-Identifier: Apache-2.0 */
//! why: the loop ends when there is no candidate
//! clauses: NG-033
//! run: -> candidate.none*8
//! twin: candidate_in_loop_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(rayQueryGetIntersectionTypeEXT(q, false)); //~ candidate.none!
}
