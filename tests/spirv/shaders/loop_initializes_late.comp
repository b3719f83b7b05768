/* SPDX-License-Identifier: Apache-2.0 */
//! why: the first turn finds nothing initialized
//! clauses: NG-037
//! run: choice=0 -> use.uninitialized*8
//! run: choice=1 ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    uint n = 0;
    for (uint i = 0; i < 3; i++) {
        if (i > 0 || !CHOSEN)
            n += rayQueryProceedEXT(q) ? 1 : 0; //~ use.uninitialized?
        START(q, gl_RayFlagsOpaqueEXT);
    }
    SHOW(n);
}
