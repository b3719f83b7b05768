/* SPDX-License-Identifier: Apache-2.0 */
//! why: a loop without a condition, left by a break
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
    for (;;) {
        if (!rayQueryProceedEXT(q))
            break;
        n += CANDIDATE(q) + 1;
    }
    SHOW(n + TYPE(q));
}
