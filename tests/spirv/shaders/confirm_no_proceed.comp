/* SPDX-License-Identifier: Apache-2.0 */
//! why: nothing was traversed yet
//! clauses: NG-042
//! run: -> confirm.no_candidate*8
//! twin: confirm_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    rayQueryConfirmIntersectionEXT(q); //~ confirm.no_candidate!
    SHOW(0);
}
