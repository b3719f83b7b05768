/* SPDX-License-Identifier: Apache-2.0 */
//! why: constants prove it; a mask of all ones is meant
//! run: -> initialize.nan*8 initialize.infinite*8 initialize.negative_t*8 initialize.t_order*8 initialize.zero_direction*8 initialize.skip_both*8 initialize.cull_pair*8 initialize.opacity_pair*8 initialize.unknown_flags*8 initialize.mask_bits*8
//! twin: initialize_constants_good.comp
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    const float zero = 0.0;
    rayQueryInitializeEXT(q, scene, 0x300, 0x1FF, vec3(0), -1.0, vec3(0), 10.0); //~ initialize.negative_t! initialize.zero_direction! initialize.skip_both! initialize.mask_bits!
    rayQueryInitializeEXT(q, scene, 0x110, 0xFF, vec3(0), 2.0, vec3(0, 0, 1), 1.0); //~ initialize.t_order! initialize.cull_pair!
    rayQueryInitializeEXT(q, scene, 0x3, 0xFF, vec3(uintBitsToFloat(0x7FC00000u)), 0.0, vec3(0, 0, 1), 1.0); //~ initialize.nan! initialize.opacity_pair!
    rayQueryInitializeEXT(q, scene, 0x800, 0xFFFFFFFF, vec3(uintBitsToFloat(0x7F800000u)), 0.0, vec3(0, 0, 1), 1.0); //~ initialize.infinite! initialize.unknown_flags!
    rayQueryTerminateEXT(q);
    SHOW(0);
}
