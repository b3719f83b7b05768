/* SPDX-License-Identifier: Apache-2.0 */
//! why: every getter of the candidate, in the loop and behind its type
//! clauses: NG-030 NG-033 NG-062
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q)) {
        sum += rayQueryGetIntersectionInstanceCustomIndexEXT(q, false);
        sum += rayQueryGetIntersectionInstanceIdEXT(q, false);
        sum += rayQueryGetIntersectionInstanceShaderBindingTableRecordOffsetEXT(q, false);
        sum += rayQueryGetIntersectionGeometryIndexEXT(q, false);
        sum += rayQueryGetIntersectionPrimitiveIndexEXT(q, false);
        sum += rayQueryGetIntersectionObjectRayDirectionEXT(q, false).x;
        sum += rayQueryGetIntersectionObjectRayOriginEXT(q, false).x;
        sum += rayQueryGetIntersectionObjectToWorldEXT(q, false)[0].x;
        sum += rayQueryGetIntersectionWorldToObjectEXT(q, false)[0].x;
        if (CANDIDATE(q) == AT_TRIANGLE) {
            sum += rayQueryGetIntersectionTEXT(q, false);
            sum += rayQueryGetIntersectionBarycentricsEXT(q, false).x;
            sum += (rayQueryGetIntersectionFrontFaceEXT(q, false) ? 1.0 : 0.0);
        } else {
            sum += rayQueryGetIntersectionCandidateAABBOpaqueEXT(q) ? 2.0 : 3.0;
        }
    }
    SHOW(sum);
}
