/* SPDX-License-Identifier: Apache-2.0 */
//! why: each invocation has an element of its own
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[8];
    START(q[LANE], gl_RayFlagsNoneEXT);
    float t = 0;
    while (rayQueryProceedEXT(q[LANE])) //~ use.uninitialized? proceed.after_false?
        if (CANDIDATE(q[LANE]) == AT_TRIANGLE) //~ use.uninitialized? candidate.none?
            rayQueryConfirmIntersectionEXT(q[LANE]); //~ use.uninitialized? confirm.no_candidate? confirm.not_triangle?
    if (TYPE(q[LANE]) == TRIANGLE) //~ use.uninitialized?
        t = rayQueryGetIntersectionTEXT(q[LANE], true); //~ use.uninitialized? committed.none?
    SHOW(t);
}
