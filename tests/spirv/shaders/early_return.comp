/* SPDX-License-Identifier: Apache-2.0 */
//! why: what returns early does not reach the getter
//! run: choice=1 lane=3 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    if (CHOSEN)
        return;
    START(q, gl_RayFlagsOpaqueEXT);
    bool more = rayQueryProceedEXT(q);
    if (more)
        return;
    if (rayQueryGetIntersectionTypeEXT(q, true) == gl_RayQueryCommittedIntersectionNoneEXT)
        return;
    SHOW(rayQueryGetIntersectionTEXT(q, true));
}
