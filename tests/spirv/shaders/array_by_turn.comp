/* SPDX-License-Identifier: Apache-2.0 */
//! why: the element changes from turn to turn, so that none is told from the others
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[8];
    float t = 0;
    for (uint i = 0; i < 2; i++) {
        uint which = (LANE + i) & 7;
        START(q[which], gl_RayFlagsNoneEXT);
        while (rayQueryProceedEXT(q[which])) //~ use.uninitialized? proceed.after_false?
            if (CANDIDATE(q[which]) == AT_TRIANGLE) //~ use.uninitialized? candidate.none?
                rayQueryConfirmIntersectionEXT(q[which]); //~ use.uninitialized? confirm.no_candidate? confirm.not_triangle?
        if (TYPE(q[which]) == TRIANGLE) //~ use.uninitialized?
            t = rayQueryGetIntersectionTEXT(q[which], true); //~ use.uninitialized? committed.none?
    }
    SHOW(t);
}
