/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Recursion: a closest-hit or miss shader that is not at the wanted depth traces the same ray again, with a payload
 * of its own, and passes on what comes back. So the answer is that of the innermost ray.
 */
layout(location = 0) rayPayloadInEXT Payload payload;
layout(location = 1) rayPayloadEXT Payload inner;

bool recurse(uint index)
{
    if (payload.level + 1 >= depth) {
        return false;
    }
    const Ray ray = rays[index];
    inner = payload_new();
    inner.level = payload.level + 1;
    traceRayEXT(scene, ray.flags & ~SKIP_CLOSEST_HIT, ray.cull_mask, record_offset, record_stride, miss_index,
                ray_origin(ray), ray.tmin, ray_direction(ray), ray.tmax, 1);
    /* What this level had before has to be as it was. */
    const bool kept = inner.level == payload.level + 1 && payload.answer.kind == UNTOUCHED;
    payload.answer = inner.answer;
    payload.miss_record = inner.miss_record;
    payload.returned = kept ? inner.returned + 1 : 0x10000u;
    return true;
}
