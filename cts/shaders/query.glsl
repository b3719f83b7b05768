/* SPDX-License-Identifier: Apache-2.0 */
/* What shaders with ray queries share: the questions about a hit, the loop that decides about candidates. */
#extension GL_EXT_ray_query : require
#extension GL_EXT_ray_flags_primitive_culling : require
#include "answer.glsl"

/* The flags come with the rays, the two that skip primitive types among them: they need a capability of their own,
 * which every device with ray queries has. */
layout(primitive_culling);

/* A driver that never says that it is done must not hang the device. */
const uint MAX_STEPS = 1u << 20;

#ifndef QUERY_DECLARED
rayQueryEXT query;
#endif

/* Only what is defined for the kind of hit is asked for. */
Answer answer_committed()
{
    Answer answer = answer_nothing();
    const uint type = rayQueryGetIntersectionTypeEXT(query, true);
    if (type == gl_RayQueryCommittedIntersectionNoneEXT) {
        return answer;
    }
    answer.instance = rayQueryGetIntersectionInstanceIdEXT(query, true);
    answer.geometry = rayQueryGetIntersectionGeometryIndexEXT(query, true);
    answer.primitive = rayQueryGetIntersectionPrimitiveIndexEXT(query, true);
    answer.custom_index = rayQueryGetIntersectionInstanceCustomIndexEXT(query, true);
    answer.sbt_offset = rayQueryGetIntersectionInstanceShaderBindingTableRecordOffsetEXT(query, true);
    answer.t = rayQueryGetIntersectionTEXT(query, true);
    if (type == gl_RayQueryCommittedIntersectionTriangleEXT) {
        const vec2 barycentrics = rayQueryGetIntersectionBarycentricsEXT(query, true);
        answer.kind = TRIANGLE;
        answer.front = rayQueryGetIntersectionFrontFaceEXT(query, true) ? 1 : 0;
        answer.beta = barycentrics.x;
        answer.gamma = barycentrics.y;
    } else {
        answer.kind = GENERATED;
    }
    return answer;
}

Answer answer_candidate()
{
    Answer answer = answer_nothing();
    answer.instance = rayQueryGetIntersectionInstanceIdEXT(query, false);
    answer.geometry = rayQueryGetIntersectionGeometryIndexEXT(query, false);
    answer.primitive = rayQueryGetIntersectionPrimitiveIndexEXT(query, false);
    answer.custom_index = rayQueryGetIntersectionInstanceCustomIndexEXT(query, false);
    answer.sbt_offset = rayQueryGetIntersectionInstanceShaderBindingTableRecordOffsetEXT(query, false);
    if (rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
        const vec2 barycentrics = rayQueryGetIntersectionBarycentricsEXT(query, false);
        answer.kind = TRIANGLE;
        answer.t = rayQueryGetIntersectionTEXT(query, false);
        answer.front = rayQueryGetIntersectionFrontFaceEXT(query, false) ? 1 : 0;
        answer.beta = barycentrics.x;
        answer.gamma = barycentrics.y;
    } else {
        answer.kind = GENERATED;
    }
    return answer;
}

#ifndef SCENE
#define SCENE scene
#endif
void query_begin(Ray ray)
{
    rayQueryInitializeEXT(query, SCENE, ray.flags, ray.cull_mask, vec3(ray.origin_x, ray.origin_y, ray.origin_z),
                          ray.tmin, vec3(ray.direction_x, ray.direction_y, ray.direction_z), ray.tmax);
}

/* Decides about the candidate at hand as the ray's policy says; whether it is a hit now. */
bool candidate_decide(Ray ray)
{
    const uint primitive = rayQueryGetIntersectionPrimitiveIndexEXT(query, false);
    const uint bit = 1u << (primitive & 31u);
    if (rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
        if ((ray.confirm_mask & bit) != 0) {
            rayQueryConfirmIntersectionEXT(query);
            return true;
        }
        return false;
    }
    if ((ray.generate_mask & bit) == 0 ||
        (way(OPAQUE_BOXES) && !rayQueryGetIntersectionCandidateAABBOpaqueEXT(query))) {
        return false;
    }
    float closest = ray.tmax;
    if (rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT) {
        closest = rayQueryGetIntersectionTEXT(query, true);
    }
    const float t = generated_t(ray, primitive);
    /* Outside this range the result of generating a hit is undefined. */
    if (t >= ray.tmin && t <= closest) {
        rayQueryGenerateIntersectionEXT(query, t);
        return true;
    }
    return false;
}

/* What is asked of a candidate is kept if it becomes a hit; the last one that does is the one that is committed. */
#ifndef CANDIDATE_ASK
#define CANDIDATE_ASK()
#define CANDIDATE_KEEP()
#endif

/* What went wrong, or NOTHING. */
uint query_run(Ray ray)
{
    for (uint steps = 0; steps < MAX_STEPS; steps++) {
        if (!rayQueryProceedEXT(query)) {
            return NOTHING;
        }
        if ((ray.flags & gl_RayFlagsTerminateOnFirstHitEXT) != 0 &&
            rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT) {
            return WENT_ON;
        }
        CANDIDATE_ASK();
        if (candidate_decide(ray)) {
            CANDIDATE_KEEP();
            if (way(TERMINATE)) {
                rayQueryTerminateEXT(query);
            }
        }
    }
    return UNFINISHED;
}

/* False when the driver did not come to an end. */
bool query_decide_all(Ray ray)
{
    return query_run(ray) == NOTHING;
}

/*
 * Leaves the query as a shader may that lost interest: in the middle of a traversal, with a hit, and ended by hand. What
 * is initialized afterwards must not show any of it. What went wrong, or NOTHING.
 */
uint query_abandon(Ray ray)
{
    const uint opacity = gl_RayFlagsOpaqueEXT | gl_RayFlagsCullOpaqueEXT | gl_RayFlagsCullNoOpaqueEXT;
    Ray other = ray;
    other.flags = (ray.flags & ~opacity) | gl_RayFlagsNoOpaqueEXT;
    query_begin(other);
    if (!rayQueryProceedEXT(query)) {
        return NOTHING;
    }
    if (rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
        rayQueryConfirmIntersectionEXT(query);
    }
    rayQueryTerminateEXT(query);
    return rayQueryProceedEXT(query) ? NOT_ENDED : NOTHING;
}

/* The committed hit of a ray, whatever the stage. */
Answer query_answer(Ray ray)
{
    uint fault = NOTHING;
    /* A few rays are enough; their directions say which. */
    if ((floatBitsToUint(ray.direction_x) & 63u) == 0) {
        fault = query_abandon(ray);
    }
    if (fault == NOTHING) {
        query_begin(ray);
        fault = query_run(ray);
    }
    if (fault == NOTHING) {
        return answer_committed();
    }
    Answer answer = answer_nothing();
    answer.kind = fault;
    return answer;
}
