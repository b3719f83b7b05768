/* SPDX-License-Identifier: Apache-2.0 */
//! why: a function that terminates whatever it is given
//! clauses: NG-023
//! run: choice=1 -> terminate.after_false*8
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void stop(rayQueryEXT q)
{
    rayQueryTerminateEXT(q); //~ terminate.after_false?
}
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    if (CHOSEN)
        while (rayQueryProceedEXT(q)) {
        }
    else
        rayQueryProceedEXT(q);
    stop(q);
    SHOW(1);
}
