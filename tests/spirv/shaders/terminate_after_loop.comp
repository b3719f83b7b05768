/* SPDX-License-Identifier: Apache-2.0 */
//! why: every Proceed before must have returned true
//! clauses: NG-023
//! run: -> terminate.after_false*8
//! twin: terminate_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
    }
    rayQueryTerminateEXT(q); //~ terminate.after_false!
    SHOW(0);
}
