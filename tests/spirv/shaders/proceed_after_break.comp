/* SPDX-License-Identifier: Apache-2.0 */
//! why: a loop that was left may be taken up again
//! clauses: NG-017
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    uint n = 0;
    while (rayQueryProceedEXT(q))
        if (++n == 1)
            break;
    if (n == 1)
        while (rayQueryProceedEXT(q)) //~ proceed.after_false?
            n++;
    SHOW(n);
}
