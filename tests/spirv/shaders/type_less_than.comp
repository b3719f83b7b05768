/* SPDX-License-Identifier: Apache-2.0 */
//! why: a committed type above none is one of the others
//! clauses: NG-054
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
    }
    float sum = 0;
    if (TYPE(q) > NOTHING)
        sum = rayQueryGetIntersectionTEXT(q, true);
    SHOW(sum);
}
