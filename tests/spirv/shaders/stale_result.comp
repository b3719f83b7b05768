#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoOpaqueEXT);
    bool previous = true, more = true;
    uint n = 0;
    for (uint i = 0; i < 9 && more; i++) {
        more = rayQueryProceedEXT(q);
        /* What an earlier Proceed returned says nothing of the candidate now. */
        if (previous)
            n += rayQueryGetIntersectionInstanceIdEXT(q, false);
        previous = more;
    }
    SHOW(n);
}
