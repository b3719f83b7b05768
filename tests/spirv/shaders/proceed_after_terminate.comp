/* SPDX-License-Identifier: Apache-2.0 */
//! why: once terminated, Proceed returns false, and then it is over
//! clauses: NG-018 NG-023
//! run: -> proceed.after_false*8
//! twin: proceed_after_terminate_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    rayQueryProceedEXT(q);
    rayQueryTerminateEXT(q); //~ terminate.after_false?
    rayQueryProceedEXT(q); //~ proceed.after_false?
    SHOW(rayQueryProceedEXT(q) ? 1 : 0); //~ proceed.after_false!
}
