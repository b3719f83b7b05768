/* SPDX-License-Identifier: Apache-2.0 */
//! why: NG-030: nothing was traversed yet
//! clauses: NG-030
//! run: -> candidate.none*8
//! twin: candidate_in_loop_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    SHOW(rayQueryGetIntersectionPrimitiveIndexEXT(q, false)); //~ candidate.none!
}
