/* SPDX-License-Identifier: Apache-2.0 */
//! why: which of the two ended the loop is not told
//! clauses: NG-033
//! run: choice=1 value=1 ->
//! run: value=1 -> candidate.none*8
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    uint n = 0;
    for (uint i = 0; i < (CHOSEN ? 1 : 4) && rayQueryProceedEXT(q); i++)
        n++;
    if (value > 0)
        n += CANDIDATE(q); //~ candidate.none?
    SHOW(n);
}
