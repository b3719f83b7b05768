/* SPDX-License-Identifier: Apache-2.0 */
//! why: the candidate is read inside of the loop
//! clauses: NG-030 NG-033 NG-035
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    uint n = 0;
    while (rayQueryProceedEXT(q))
        n += CANDIDATE(q) + 1;
    SHOW(n);
}
