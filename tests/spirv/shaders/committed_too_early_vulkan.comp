/* SPDX-License-Identifier: Apache-2.0 */
//! why: Vulkan lets what is committed so far be read
//! clauses: NG-032
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q)) {
        if (CANDIDATE(q) == AT_TRIANGLE) {
            rayQueryConfirmIntersectionEXT(q);
            sum += rayQueryGetIntersectionTEXT(q, true);
        }
    }
    SHOW(sum);
}
