/* SPDX-License-Identifier: Apache-2.0 */
//! why: a getter in a function that is called in the loop and after it
//! clauses: NG-033
//! run: choice=1 lane=7 -> candidate.none*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
uint look(rayQueryEXT q)
{
    return rayQueryGetIntersectionInstanceIdEXT(q, false); //~ candidate.none?
}
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    uint sum = 0;
    while (rayQueryProceedEXT(q)) //~ proceed.after_false?
        sum += look(q);
    if (CHOSEN)
        sum += look(q);
    SHOW(sum);
}
