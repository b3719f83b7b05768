/* SPDX-License-Identifier: Apache-2.0 */
//! why: NG-006: the history starts again
//! clauses: NG-006
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    float t = 0;
    for (int i = 0; i < 4; i++) {
        START(q, gl_RayFlagsOpaqueEXT);
        while (rayQueryProceedEXT(q)) {
        }
        if (rayQueryGetIntersectionTypeEXT(q, true) == TRIANGLE)
            t += rayQueryGetIntersectionTEXT(q, true);
    }
    SHOW(t);
}
