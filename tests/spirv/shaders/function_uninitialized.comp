#version 460
/* SPDX-License-Identifier: Apache-2.0 */
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void finish(rayQueryEXT q) { while (rayQueryProceedEXT(q)) { } }
void main()
{
    rayQueryEXT a;
    finish(a);
    SHOW(0);
}
