/* SPDX-License-Identifier: Apache-2.0 */
//! why: even the committed type needs an Initialize
//! clauses: NG-031
//! run: -> use.uninitialized*8
//! twin: type_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    SHOW(TYPE(q)); //~ use.uninitialized!
}
