/* SPDX-License-Identifier: Apache-2.0 */
//! why: the same candidate may be confirmed again
//! clauses: NG-041
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q))
        if (CANDIDATE(q) == AT_TRIANGLE) {
            rayQueryConfirmIntersectionEXT(q);
            rayQueryConfirmIntersectionEXT(q);
        }
    SHOW(TYPE(q));
}
