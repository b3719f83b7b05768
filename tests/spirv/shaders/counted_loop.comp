/* SPDX-License-Identifier: Apache-2.0 */
//! why: a bound on the number of turns beside the result
//! clauses: NG-030
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    uint n = 0;
    for (uint i = 0; i < 4 && rayQueryProceedEXT(q); i++)
        n += CANDIDATE(q) + 1;
    SHOW(n + TYPE(q));
}
