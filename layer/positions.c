/* SPDX-License-Identifier: Apache-2.0 */
/* Where shaders may read vertex positions: of each TLAS, once its build has been judged, the table of structures says which of its instances
 * have a BLAS that was built without ALLOW_DATA_ACCESS (checks/spirv/records.h). What is written anew is unknown until it is judged. All with
 * the device locked. */
#include "layer/shader.h"

#include <stdlib.h>
#include <string.h>

/* Of all lists together. They are never given back, as work may still read them; the list of a TLAS that is built again the same way is kept. */
#define LIST_WORDS ((size_t)1 << 20)
#define MOST_WORDS (UINT32_MAX >> GN_STRUCTURE_LIST_SHIFT)

_Static_assert(GN_STRUCTURES + LIST_WORDS < MOST_WORDS, "a word of the table can tell where any list is");

size_t gn_positions_room(const struct gn_device *device)
{
    return device->shaders->positions ? LIST_WORDS : 0;
}

/* A BLAS whose contents were observed says whether they can be read; another may. */
static bool may_allow(const struct gn_as *as)
{
    return as->shared || as->made == GN_MADE_UNKNOWN || as->made == GN_MADE_DESERIALIZED || !as->shape ||
           (as->shape->shape.flags & VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_DATA_ACCESS_KHR);
}

void gn_positions_tell_all(struct gn_device *device)
{
    struct gn_shaders *shaders = device->shaders;
    bool none = shaders->positions && !shaders->positions_possible && !device->builds_unseen &&
                !atomic_load_explicit(&device->incomplete, memory_order_relaxed);
    if (shaders->structures)
        __atomic_store_n(&shaders->structures[GN_STRUCTURE_ID_UNKNOWN], GN_STRUCTURE_FINE | (none ? GN_STRUCTURE_NO_POSITIONS : 0),
                         __ATOMIC_RELEASE);
}

static void forget(struct gn_device *device, struct gn_as *as)
{
    if (!as->positions)
        return;
    as->positions = 0;
    gn_structure_tell(device, as);
}

void gn_positions_written(struct gn_device *device, struct gn_as *as)
{
    struct gn_shaders *shaders = device->shaders;
    struct gn_as *other;
    if (!shaders || !shaders->positions)
        return;
    forget(device, as);
    if (as->levels == GN_LEVEL_TOP)
        return;
    bool allows = may_allow(as);
    if (allows && !shaders->positions_possible) {
        shaders->positions_possible = true;
        gn_positions_tell_all(device);
    }
    /* It may be in any TLAS that was judged. */
    if (as->writes > 1 && as->allowed_positions != allows)
        for (size_t cursor = 0; (other = gn_map_next(&device->structures, &cursor));)
            forget(device, other);
    as->allowed_positions = allows;
}

/* A list of the instances, the last one of this TLAS if it is the same; 0 when there is no room. */
static uint32_t list_make(struct gn_device *device, const struct gn_as *tlas, const uint32_t *refers_to, const bool *lacks,
                          uint32_t owners, uint32_t count)
{
    struct gn_shaders *shaders = device->shaders;
    size_t words = 1 + (count + (size_t)31) / 32;
    if (!shaders->structures || LIST_WORDS - shaders->positions_used < words)
        return 0;
    uint32_t at = (uint32_t)(GN_STRUCTURES + shaders->positions_used), *list = shaders->structures + at;
    memset(list, 0, words * 4);
    list[0] = count;
    for (uint32_t i = 0; i < count; i++)
        if (refers_to[i] < owners && lacks[refers_to[i]])
            list[1 + i / 32] |= UINT32_C(1) << i % 32;
    if (tlas->positions_list && memcmp(shaders->structures + tlas->positions_list, list, words * 4) == 0)
        return tlas->positions_list;
    shaders->positions_used += words;
    return at;
}

void gn_positions_judged(struct gn_device *device, struct gn_as *tlas, uint64_t position, const struct gn_as *const *owners,
                         uint32_t owner_count, const uint32_t *refers_to, uint32_t count)
{
    struct gn_shaders *shaders = device->shaders;
    uint32_t lacking = 0, active = 0;
    bool *lacks = shaders && shaders->positions ? calloc(owner_count + (size_t)1, sizeof *lacks) : NULL;
    if (!lacks || !gn_record_memory_begin(device))
        goto done;
    for (uint32_t i = 0; i < owner_count; i++) {
        const struct gn_as *blas = owners[i];
        /* Written since, it may not be what work under way finds. */
        lacks[i] = blas->writes && !blas->destroyed_at && blas->last_writes[(blas->writes - 1) % 4].position < position && !may_allow(blas);
    }
    for (uint32_t i = 0; i < count; i++) {
        active += refers_to[i] != GN_REFERENCE_NULL;
        lacking += refers_to[i] < owner_count && lacks[refers_to[i]];
    }
    if (!lacking)
        goto done;
    if (lacking == active) {
        tlas->positions = GN_STRUCTURE_NO_POSITIONS;
    } else {
        tlas->positions_list = list_make(device, tlas, refers_to, lacks, owner_count, count);
        tlas->positions = tlas->positions_list << GN_STRUCTURE_LIST_SHIFT;
        if (!tlas->positions_list)
            gn_tally_unjudged(device, GN_UNJUDGED_positions, 1);
    }
    gn_structure_tell(device, tlas);
done:
    free(lacks);
}
