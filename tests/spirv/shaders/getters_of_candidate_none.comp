/* SPDX-License-Identifier: Apache-2.0 */
//! why: every getter of a candidate that is not there any more
//! clauses: NG-033
//! run: choice=1 lane=3 -> candidate.none*13
//! run: ->
//! twin: getters_of_candidate_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q)) {
    }
    if (CHOSEN) {
        sum += rayQueryGetIntersectionInstanceCustomIndexEXT(q, false); //~ candidate.none!
        sum += rayQueryGetIntersectionInstanceIdEXT(q, false); //~ candidate.none!
        sum += rayQueryGetIntersectionInstanceShaderBindingTableRecordOffsetEXT(q, false); //~ candidate.none!
        sum += rayQueryGetIntersectionGeometryIndexEXT(q, false); //~ candidate.none!
        sum += rayQueryGetIntersectionPrimitiveIndexEXT(q, false); //~ candidate.none!
        sum += rayQueryGetIntersectionObjectRayDirectionEXT(q, false).x; //~ candidate.none!
        sum += rayQueryGetIntersectionObjectRayOriginEXT(q, false).x; //~ candidate.none!
        sum += rayQueryGetIntersectionObjectToWorldEXT(q, false)[0].x; //~ candidate.none!
        sum += rayQueryGetIntersectionWorldToObjectEXT(q, false)[0].x; //~ candidate.none!
        sum += rayQueryGetIntersectionTEXT(q, false); //~ candidate.none!
        sum += rayQueryGetIntersectionBarycentricsEXT(q, false).x; //~ candidate.none!
        sum += (rayQueryGetIntersectionFrontFaceEXT(q, false) ? 1.0 : 0.0); //~ candidate.none!
        sum += rayQueryGetIntersectionCandidateAABBOpaqueEXT(q) ? 2.0 : 3.0; //~ candidate.none!
    }
    SHOW(sum);
}
