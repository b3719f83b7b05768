/* SPDX-License-Identifier: Apache-2.0 */
//! why: every getter of the committed intersection, behind its type
//! clauses: NG-029 NG-032 NG-054
//! run: ->
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    START(q, gl_RayFlagsNoneEXT);
    float sum = 0;
    while (rayQueryProceedEXT(q))
        if (CANDIDATE(q) == AT_TRIANGLE)
            rayQueryConfirmIntersectionEXT(q);
    if (TYPE(q) == TRIANGLE) {
        sum += rayQueryGetIntersectionInstanceCustomIndexEXT(q, true);
        sum += rayQueryGetIntersectionInstanceIdEXT(q, true);
        sum += rayQueryGetIntersectionInstanceShaderBindingTableRecordOffsetEXT(q, true);
        sum += rayQueryGetIntersectionGeometryIndexEXT(q, true);
        sum += rayQueryGetIntersectionPrimitiveIndexEXT(q, true);
        sum += rayQueryGetIntersectionObjectRayDirectionEXT(q, true).x;
        sum += rayQueryGetIntersectionObjectRayOriginEXT(q, true).x;
        sum += rayQueryGetIntersectionObjectToWorldEXT(q, true)[0].x;
        sum += rayQueryGetIntersectionWorldToObjectEXT(q, true)[0].x;
        sum += rayQueryGetIntersectionTEXT(q, true);
        sum += rayQueryGetIntersectionBarycentricsEXT(q, true).x;
        sum += (rayQueryGetIntersectionFrontFaceEXT(q, true) ? 1.0 : 0.0);
    }
    SHOW(sum);
}
