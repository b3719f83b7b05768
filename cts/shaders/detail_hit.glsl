/* SPDX-License-Identifier: Apache-2.0 */
/* What GN_CTS_DETAIL asks in stages that are about a hit. */
#include "detail.glsl"

void detail_hit(uint index)
{
    detail_ray(index);
    for (uint row = 0; row < 3; row++) {
        for (uint column = 0; column < 4; column++) {
            details[index].world_from_object[row * 4 + column] = gl_ObjectToWorldEXT[column][row];
            details[index].object_from_world[row * 4 + column] = gl_WorldToObjectEXT[column][row];
        }
        details[index].object_origin[row] = gl_ObjectRayOriginEXT[row];
        details[index].object_direction[row] = gl_ObjectRayDirectionEXT[row];
    }
}
