/* SPDX-License-Identifier: Apache-2.0 */
//! why: nothing was traversed yet
//! clauses: NG-040
//! run: -> generate.no_candidate*8
//! twin: generate_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    rayQueryGenerateIntersectionEXT(q, 1.0); //~ generate.no_candidate!
    SHOW(0);
}
