/* SPDX-License-Identifier: Apache-2.0 */
//! why: as many Proceeds as allowed
//! clauses: NG-007
//! options: limit=8
//! run: ->
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
