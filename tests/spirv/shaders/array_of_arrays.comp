/* SPDX-License-Identifier: Apache-2.0 */
//! why: two dimensions
//! clauses: NG-018
//! run: not (lavapipe crashes on the original)
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[2][3];
    for (uint i = 0; i < 2; i++)
        for (uint j = 0; j < 3; j++)
            START(q[i][j], gl_RayFlagsOpaqueEXT);
    uint n = 0, last = CHOSEN ? 0 : 1;
    while (rayQueryProceedEXT(q[last][2])) //~ use.uninitialized? proceed.after_false?
        n++;
    if (CHOSEN)
        n += rayQueryProceedEXT(q[0][2]) ? 1 : 0; //~ use.uninitialized? proceed.after_false?
    SHOW(n + TYPE(q[1][0])); //~ use.uninitialized?
}
