/* SPDX-License-Identifier: Apache-2.0 */
//! why: the candidate could be a box
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoOpaqueEXT);
    bool more = rayQueryProceedEXT(q);
    if (more) {
        rayQueryConfirmIntersectionEXT(q); //~ confirm.not_triangle?
        rayQueryTerminateEXT(q);
        more = rayQueryProceedEXT(q);
    }
    SHOW(more ? 1 : 0);
}
