/* SPDX-License-Identifier: Apache-2.0 */
//! why: which structure a query goes through is kept beside it, also for an array, and nothing is asked of one that is not initialized
//! clauses: VUID-RuntimeSpirv-flags-08761
//! options: structures=9
//! run: choice=0 -> structure.no_positions*8
//! twin: positions_lacking_box.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing_position_fetch : require
#include "query.glsl"
void main()
{
    rayQueryEXT q[2];
    vec3 corners[3];
    uint which = choice & 1;
    START(q[0], gl_RayFlagsOpaqueEXT); //~ structure.none? structure.never_built? structure.destroyed? structure.bottom_level?
    rayQueryProceedEXT(q[0]); //~ use.uninitialized?
    rayQueryInitializeEXT(q[1], scene, gl_RayFlagsOpaqueEXT, 0xFF, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, CHOSEN ? -1 : 1), 100.0); //~ structure.none? structure.never_built? structure.destroyed? structure.bottom_level? initialize.nan? initialize.infinite? initialize.zero_direction?
    rayQueryProceedEXT(q[1]); //~ use.uninitialized? proceed.after_false?
    rayQueryGetIntersectionTriangleVertexPositionsEXT(q[which], true, corners); //~ use.uninitialized? committed.none? structure.no_positions?
    SHOW(corners[1].x);
}
