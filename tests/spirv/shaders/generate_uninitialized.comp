/* SPDX-License-Identifier: Apache-2.0 */
//! why: no operation but Initialize may come first
//! clauses: NG-040
//! run: choice=1 -> use.uninitialized*8
//! run: ->
//! twin: generate_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    if (CHOSEN)
        rayQueryGenerateIntersectionEXT(q, 1.0); //~ use.uninitialized!
    SHOW(0);
}
