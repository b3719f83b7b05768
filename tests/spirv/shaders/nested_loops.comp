/* SPDX-License-Identifier: Apache-2.0 */
//! why: a query for each turn of two loops
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    float sum = 0;
    for (uint y = 0; y < 2; y++)
        for (uint x = 0; x < 2; x++) {
            rayQueryEXT q;
            rayQueryInitializeEXT(q, scene, gl_RayFlagsOpaqueEXT, 0xFF, vec3(0.25 * x, 0.25 * y, -1), 0.0, vec3(0, 0, 1), 100.0); //~ initialize.nan? initialize.infinite?
            while (rayQueryProceedEXT(q)) {
            }
            sum += TYPE(q) == NOTHING ? 0.0 : rayQueryGetIntersectionTEXT(q, true);
        }
    SHOW(sum);
}
