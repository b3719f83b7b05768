/* SPDX-License-Identifier: Apache-2.0 */
//! why: two queries through one function
//! clauses: NG-037
//! run: choice=1 lane=3 -> use.uninitialized*2
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
uint both(rayQueryEXT a, rayQueryEXT b)
{
    while (rayQueryProceedEXT(a)) {
    }
    while (rayQueryProceedEXT(b)) { //~ use.uninitialized?
    }
    return TYPE(a) + TYPE(b); //~ use.uninitialized?
}
void main()
{
    rayQueryEXT q, other;
    START(q, gl_RayFlagsOpaqueEXT);
    if (!CHOSEN)
        START(other, gl_RayFlagsOpaqueEXT);
    SHOW(both(q, other));
}
