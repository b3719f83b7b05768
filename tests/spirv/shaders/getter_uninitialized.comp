/* SPDX-License-Identifier: Apache-2.0 */
//! why: no getter may come first
//! clauses: NG-031
//! run: -> use.uninitialized*8
//! twin: closest_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    SHOW(rayQueryGetIntersectionTypeEXT(q, true)); //~ use.uninitialized!
}
