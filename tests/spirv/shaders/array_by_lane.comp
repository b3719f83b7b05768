/* SPDX-License-Identifier: Apache-2.0 */
//! why: each invocation has an element of its own, always the same: proved as for one query
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[8];
    START(q[LANE], gl_RayFlagsNoneEXT);
    float t = 0;
    while (rayQueryProceedEXT(q[LANE]))
        if (CANDIDATE(q[LANE]) == AT_TRIANGLE)
            rayQueryConfirmIntersectionEXT(q[LANE]);
    if (TYPE(q[LANE]) == TRIANGLE)
        t = rayQueryGetIntersectionTEXT(q[LANE], true);
    SHOW(t);
}
