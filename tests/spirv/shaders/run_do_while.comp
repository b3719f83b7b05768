/* SPDX-License-Identifier: Apache-2.0 */
//! why: a loop that tests at its end
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    if (!CHOSEN)
        START(q, gl_RayFlagsOpaqueEXT);
    uint n = 0;
    do {
        n++;
    } while (rayQueryProceedEXT(q) && n < 3); //~ use.uninitialized?
    SHOW(n);
}
