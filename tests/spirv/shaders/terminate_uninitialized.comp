/* SPDX-License-Identifier: Apache-2.0 */
//! why: no operation but Initialize may come first
//! clauses: NG-031
//! run: choice=1 -> use.uninitialized*8
//! run: ->
//! twin: terminate_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    if (CHOSEN)
        rayQueryTerminateEXT(q); //~ use.uninitialized!
    SHOW(0);
}
