/* SPDX-License-Identifier: Apache-2.0 */
//! why: a mask has eight bits; a complement is meant
//! clauses: NG-047 NG-048
//! run: choice=0 ->
//! run: choice=0xFF ->
//! run: choice=0x100 -> initialize.mask_bits*8
//! run: choice=0x1FF -> initialize.mask_bits*8
//! run: choice=0xFFFFFFFF ->
//! run: choice=0xFFFFFFFE ->
//! run: choice=0x7FFFFFFF -> initialize.mask_bits*8
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"
void main()
{
    rayQueryEXT q;
    rayQueryInitializeEXT(q, scene, 0u, choice, vec3(0.25, 0.25, -1), 0.0, vec3(0, 0, 1), 100.0); //~ initialize.mask_bits?
    while (rayQueryProceedEXT(q)) {
    }
    SHOW(TYPE(q));
}
