/* SPDX-License-Identifier: Apache-2.0 */
//! why: NG-037 through a parameter
//! clauses: NG-037
//! run: -> use.uninitialized*8
//! twin: function_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void finish(rayQueryEXT q) { while (rayQueryProceedEXT(q)) { } } //~ use.uninitialized!
void main()
{
    rayQueryEXT a;
    finish(a);
    SHOW(0);
}
