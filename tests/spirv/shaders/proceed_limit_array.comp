/* SPDX-License-Identifier: Apache-2.0 */
//! why: the count is per query
//! clauses: NG-007
//! options: limit=3
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[2];
    uint n = 0;
    START(q[0], gl_RayFlagsNoneEXT);
    START(q[1], gl_RayFlagsNoneEXT);
    for (uint i = 0; i < 2; i++)
        while (rayQueryProceedEXT(q[CHOSEN ? 1 : i])) { //~ use.uninitialized? proceed.after_false? proceed.limit?
            n++;
            if (CHOSEN) {
                START(q[1], gl_RayFlagsNoneEXT);
                if (n > 9)
                    break;
            }
        }
    SHOW(n);
}
