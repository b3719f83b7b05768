/* SPDX-License-Identifier: Apache-2.0 */
//! why: a discard between Initialize and use
//! clauses: NG-030
//! run: choice=1 lane=3 ->
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#define LANE uint(gl_FragCoord.x)
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    if (CHOSEN)
        discard;
    uint n = 0;
    while (rayQueryProceedEXT(q))
        n += CANDIDATE(q) + 1;
    SHOW(n);
}
