/* SPDX-License-Identifier: Apache-2.0 */
//! why: the first Proceed may return true: boxes are candidates whatever the flags of opacity
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsOpaqueEXT);
    bool more = rayQueryProceedEXT(q);
    if (CHOSEN)
        more = rayQueryProceedEXT(q); //~ proceed.after_false?
    uint extra = CHOSEN ? 2u : 0u;
    for (uint i = 0; i < extra; i++)
        more = rayQueryProceedEXT(q); //~ proceed.after_false?
    SHOW(more ? 1 : 0);
}
