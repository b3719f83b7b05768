/* SPDX-License-Identifier: Apache-2.0 */
//! why: every getter of a committed intersection that is not there
//! clauses: NG-029 NG-054
//! run: choice=1 lane=0 -> committed.none*5
//! run: ->
//! twin: getters_of_committed_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    float sum = 0;
    START(q, gl_RayFlagsNoneEXT);
    while (rayQueryProceedEXT(q)) {
    }
    if (CHOSEN) {
        sum += rayQueryGetIntersectionGeometryIndexEXT(q, true); //~ committed.none?
        sum += rayQueryGetIntersectionPrimitiveIndexEXT(q, true); //~ committed.none?
        sum += rayQueryGetIntersectionTEXT(q, true); //~ committed.none?
        sum += rayQueryGetIntersectionBarycentricsEXT(q, true).x; //~ committed.none?
        sum += (rayQueryGetIntersectionFrontFaceEXT(q, true) ? 1.0 : 0.0); //~ committed.none?
    }
    SHOW(sum);
}
