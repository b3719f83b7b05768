/* SPDX-License-Identifier: Apache-2.0 */
/* What GN_CTS_POSITIONS asks in stages that are about a hit. */
layout(set = 0, binding = 3, std430) writeonly buffer Positions { Vertices positions[]; };

void positions_write(uint index, bool triangle)
{
    for (uint vertex = 0; vertex < 3; vertex++) {
        for (uint axis = 0; axis < 3; axis++) {
            positions[index].values[vertex * 3 + axis] =
                triangle ? gl_HitTriangleVertexPositionsEXT[vertex][axis] : 0.0;
        }
    }
}
