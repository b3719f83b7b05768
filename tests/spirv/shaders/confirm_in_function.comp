/* SPDX-License-Identifier: Apache-2.0 */
//! why: a function that confirms what it is given
//! clauses: NG-042
//! run: choice=1 lane=4 -> confirm.no_candidate*1
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void accept(rayQueryEXT q)
{
    rayQueryConfirmIntersectionEXT(q); //~ confirm.no_candidate?
}
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) //~ proceed.after_false?
        if (CANDIDATE(q) == AT_TRIANGLE)
            accept(q);
    if (CHOSEN)
        accept(q);
    SHOW(TYPE(q));
}
