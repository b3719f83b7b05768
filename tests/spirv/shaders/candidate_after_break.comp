/* SPDX-License-Identifier: Apache-2.0 */
//! why: the candidate is still there behind a break
//! clauses: NG-030
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    bool found = false;
    while (rayQueryProceedEXT(q)) {
        if (CANDIDATE(q) == AT_TRIANGLE) {
            found = true;
            break;
        }
    }
    SHOW(found ? rayQueryGetIntersectionTEXT(q, false) : 0);
}
