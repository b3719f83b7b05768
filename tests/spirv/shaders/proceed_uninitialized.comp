/* SPDX-License-Identifier: Apache-2.0 */
//! why: no Proceed may come first
//! clauses: NG-037
//! run: -> use.uninitialized*8
//! twin: closest_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    SHOW(rayQueryProceedEXT(q) ? 1 : 0); //~ use.uninitialized!
}
