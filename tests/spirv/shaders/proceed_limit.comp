/* SPDX-License-Identifier: Apache-2.0 */
//! why: a loop that takes longer than was allowed
//! clauses: NG-007
//! options: limit=1
//! run: -> proceed.limit*16
//! twin: proceed_limit_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    uint n = 0;
    while (rayQueryProceedEXT(q)) //~ proceed.limit?
        n++;
    SHOW(n);
}
