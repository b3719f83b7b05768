/* SPDX-License-Identifier: Apache-2.0 */
/* No hit. */
#version 460
#extension GL_EXT_ray_tracing : require
layout(location = 0) rayPayloadInEXT float t;

void main()
{
    t = -1;
}
