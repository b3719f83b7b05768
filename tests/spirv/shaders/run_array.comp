/* SPDX-License-Identifier: Apache-2.0 */
//! why: a dynamic index leaves it to the device
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[4];
    uint count = CHOSEN ? 3u : 4u;
    for (uint i = 0; i < count; i++)
        START(q[i], gl_RayFlagsOpaqueEXT);
    uint n = 0;
    for (uint i = 0; i < 4; i++) {
        while (rayQueryProceedEXT(q[i])) //~ use.uninitialized? proceed.after_false?
            n++;
        if (i < count)
            n += rayQueryGetIntersectionTypeEXT(q[i], true); //~ use.uninitialized?
    }
    SHOW(n);
}
