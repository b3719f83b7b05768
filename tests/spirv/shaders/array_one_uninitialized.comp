/* SPDX-License-Identifier: Apache-2.0 */
//! why: the other element is not the one that was initialized
//! clauses: NG-031 NG-045
//! run: -> use.uninitialized*8
//! twin: array_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[2];
    START(q[0], gl_RayFlagsOpaqueEXT);
    while (rayQueryProceedEXT(q[0])) {
    }
    while (rayQueryProceedEXT(q[1])) { //~ use.uninitialized!
    }
    SHOW(0);
}
