/* SPDX-License-Identifier: Apache-2.0 */
//! why: a return leaves out those that were not initialized
//! clauses: NG-037
//! run: choice=1 ->
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    if (CHOSEN)
        START(q, gl_RayFlagsOpaqueEXT);
    else {
        SHOW(7);
        return;
    }
    SHOW(rayQueryProceedEXT(q) ? 1 : 0);
}
