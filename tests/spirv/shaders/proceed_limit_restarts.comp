/* SPDX-License-Identifier: Apache-2.0 */
//! why: the count starts again with each initialization
//! clauses: NG-006
//! options: limit=3
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    uint n = 0;
    for (uint i = 0; i < 5; i++) {
        START(q, gl_RayFlagsNoneEXT);
        while (rayQueryProceedEXT(q)) //~ proceed.limit?
            n++;
    }
    SHOW(n);
}
