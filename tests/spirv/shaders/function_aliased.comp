/* SPDX-License-Identifier: Apache-2.0 */
//! why: a query under two names is left to the device
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
rayQueryEXT global;
/* One query under two names: nothing may be proved of it. */
bool step(rayQueryEXT q)
{
    bool more = rayQueryProceedEXT(q); //~ use.uninitialized? proceed.after_false?
    if (CHOSEN)
        START(global, gl_RayFlagsOpaqueEXT);
    return more && rayQueryProceedEXT(q); //~ use.uninitialized? proceed.after_false?
}
void main()
{
    START(global, gl_RayFlagsOpaqueEXT);
    SHOW(step(global) ? 1 : 0);
}
