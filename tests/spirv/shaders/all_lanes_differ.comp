/* SPDX-License-Identifier: Apache-2.0 */
//! why: divergent lanes each have their own state
//! clauses: NG-045
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    for (uint i = 0; i < LANE % 3; i++)
        if (!rayQueryProceedEXT(q))
            break;
    uint n = 0;
    if (LANE % 3 == 1)
        n = CANDIDATE(q); //~ candidate.none?
    SHOW(n);
}
