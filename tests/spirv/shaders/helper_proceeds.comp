/* SPDX-License-Identifier: Apache-2.0 */
//! why: a helper that proceeds and returns what Proceed did
//! clauses: NG-030
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
bool step(rayQueryEXT q)
{
    return rayQueryProceedEXT(q);
}
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    uint n = 0;
    while (step(q))
        n += CANDIDATE(q) + 1;
    SHOW(n);
}
