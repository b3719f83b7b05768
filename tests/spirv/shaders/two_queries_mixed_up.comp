/* SPDX-License-Identifier: Apache-2.0 */
//! why: the one was initialized, the other is used
//! clauses: NG-037
//! run: -> use.uninitialized*8
//! twin: two_queries_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q, other;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(other)) { //~ use.uninitialized!
    }
    SHOW(0);
}
