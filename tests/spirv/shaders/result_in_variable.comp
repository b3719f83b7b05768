/* SPDX-License-Identifier: Apache-2.0 */
//! why: the result is kept in a variable and tested later
//! clauses: NG-030
//! run: choice=1 ->
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    bool more = rayQueryProceedEXT(q);
    uint n = 3;
    if (CHOSEN)
        n = 4;
    if (more)
        n += CANDIDATE(q);
    SHOW(n);
}
