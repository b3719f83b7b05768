/* SPDX-License-Identifier: Apache-2.0 */
//! why: in WGSL the committed intersection waits for the end of the traversal
//! clauses: NG-032
//! options: profile=wgpu
//! run: -> committed.too_early*8
//! twin: committed_too_early_vulkan.comp
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
            sum += rayQueryGetIntersectionTEXT(q, true); //~ committed.too_early!
        }
    }
    SHOW(sum);
}
