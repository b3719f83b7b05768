/* SPDX-License-Identifier: Apache-2.0 */
//! why: the committed type may be read at once, before any Proceed
//! clauses: NG-029
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    SHOW(TYPE(q));
}
