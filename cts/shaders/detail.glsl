/* SPDX-License-Identifier: Apache-2.0 */
/* What GN_CTS_DETAIL asks of a ray in a miss shader as in a closest-hit shader. */
layout(set = 0, binding = 3, std430) writeonly buffer Details { Detail details[]; };

void detail_ray(uint index)
{
    for (uint row = 0; row < 3; row++) {
        details[index].world_origin[row] = gl_WorldRayOriginEXT[row];
        details[index].world_direction[row] = gl_WorldRayDirectionEXT[row];
    }
    details[index].tmin = gl_RayTminEXT;
    details[index].flags = gl_IncomingRayFlagsEXT | (rays[index].flags & SKIP_CLOSEST_HIT);
}
