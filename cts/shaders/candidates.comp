/* SPDX-License-Identifier: Apache-2.0 */
/* Every candidate that is presented, none of them confirmed, and the committed hit, which is opaque. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "query.glsl"

layout(local_size_x = 64) in;

layout(set = 0, binding = 3, std430) writeonly buffer Presented { Candidates presented[]; };

void main()
{
    const uint index = gl_GlobalInvocationID.x;
    if (index >= ray_count) {
        return;
    }
    query_begin(rays[index]);
    uint count = 0;
    bool done = false;
    while (count < MAX_STEPS) {
        if (!rayQueryProceedEXT(query)) {
            done = true;
            break;
        }
        if (count < MAX_CANDIDATES) {
            presented[index].list[count] = answer_candidate();
        }
        count++;
    }
    presented[index].count = count;
    if (done) {
        committed[index] = answer_committed();
    } else {
        committed[index].kind = UNFINISHED;
    }
}
