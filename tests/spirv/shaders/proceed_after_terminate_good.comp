/* SPDX-License-Identifier: Apache-2.0 */
//! why: after Terminate one more Proceed is allowed, and returns false
//! clauses: NG-023
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    bool more = rayQueryProceedEXT(q);
    if (more) {
        rayQueryTerminateEXT(q);
        more = rayQueryProceedEXT(q);
    }
    SHOW(more ? 1 : 0);
}
