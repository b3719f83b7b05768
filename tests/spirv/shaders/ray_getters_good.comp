/* SPDX-License-Identifier: Apache-2.0 */
//! why: what was given to Initialize can be read at any time after it
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = rayQueryGetRayTMinEXT(q) + float(rayQueryGetRayFlagsEXT(q));
    while (rayQueryProceedEXT(q))
        sum += rayQueryGetWorldRayOriginEXT(q).x;
    SHOW(sum + rayQueryGetWorldRayDirectionEXT(q).z);
}
