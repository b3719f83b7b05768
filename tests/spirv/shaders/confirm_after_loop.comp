/* SPDX-License-Identifier: Apache-2.0 */
//! why: there is nothing to confirm after the loop
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
    while (rayQueryProceedEXT(q)) {
    }
    rayQueryConfirmIntersectionEXT(q); //~ confirm.no_candidate!
    SHOW(TYPE(q));
}
