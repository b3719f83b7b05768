/* SPDX-License-Identifier: Apache-2.0 */
//! why: initialized anew in every turn
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    uint n = 0;
    rayQueryEXT q;
    for (uint i = 0; i < 3; i++) {
        START(q, gl_RayFlagsOpaqueEXT);
        while (rayQueryProceedEXT(q))
            n++;
        n += TYPE(q);
    }
    SHOW(n);
}
