/* SPDX-License-Identifier: Apache-2.0 */
//! why: a query goes through three functions
//! clauses: NG-037
//! run: choice=1 lane=1 -> use.uninitialized*2
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void inner(rayQueryEXT q)
{
    if (!CHOSEN)
        START(q, gl_RayFlagsOpaqueEXT);
}
void middle(rayQueryEXT q)
{
    inner(q);
}
void outer(rayQueryEXT q)
{
    middle(q);
    while (rayQueryProceedEXT(q)) { //~ use.uninitialized?
    }
}
void main()
{
    rayQueryEXT q;
    outer(q);
    SHOW(TYPE(q)); //~ use.uninitialized?
}
