/* SPDX-License-Identifier: Apache-2.0 */
//! why: only the device knows the committed T
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
        uint kind = rayQueryGetIntersectionTypeEXT(q, false);
        if (kind == gl_RayQueryCandidateIntersectionAABBEXT) {
            if (rayQueryGetIntersectionCandidateAABBOpaqueEXT(q))
                rayQueryGenerateIntersectionEXT(q, 2.0); //~ generate.range?
        } else {
            rayQueryConfirmIntersectionEXT(q);
        }
    }
    SHOW(rayQueryGetIntersectionTypeEXT(q, true));
}
