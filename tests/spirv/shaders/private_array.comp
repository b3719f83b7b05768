/* SPDX-License-Identifier: Apache-2.0 */
//! why: a global array of queries, indexed by what only the device knows
//! clauses: NG-037 NG-045
//! run: choice=1 lane=6 -> use.uninitialized*2
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
rayQueryEXT globals[3];
void main()
{
    for (uint i = 0; i < 3; i++)
        if (!CHOSEN || i != 1)
            START(globals[i], gl_RayFlagsOpaqueEXT);
    uint n = 0;
    for (uint i = 0; i < 3; i++) {
        if (rayQueryProceedEXT(globals[i])) //~ use.uninitialized? proceed.after_false?
            n++;
        n += TYPE(globals[i]); //~ use.uninitialized?
    }
    SHOW(n);
}
