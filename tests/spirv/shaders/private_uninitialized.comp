/* SPDX-License-Identifier: Apache-2.0 */
//! why: a global query starts without a state as well
//! clauses: NG-037
//! run: choice=1 ->
//! run: -> use.uninitialized*8
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
rayQueryEXT global;
void main()
{
    if (CHOSEN)
        START(global, gl_RayFlagsOpaqueEXT);
    SHOW(rayQueryProceedEXT(global) ? 1 : 0); //~ use.uninitialized?
}
