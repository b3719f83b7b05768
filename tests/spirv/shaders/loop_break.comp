/* SPDX-License-Identifier: Apache-2.0 */
//! why: a break leaves the candidate, the end of the loop does not
//! run: choice=9 -> candidate.none*8
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoOpaqueEXT);
    uint n = 0;
    while (rayQueryProceedEXT(q)) {
        if (n++ == choice)
            break;
    }
    /* At a candidate after the break, without one otherwise. */
    SHOW(rayQueryGetIntersectionInstanceIdEXT(q, false)); //~ candidate.none?
}
