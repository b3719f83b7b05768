/* SPDX-License-Identifier: Apache-2.0 */
/* What an update has to leave as it was, besides what the call itself says: the indices, and which primitives are active. Of
 * each geometry of a structure that may be updated a digest is kept, and held against that of the update. */
#include "checks/rules/geometry.h"
#include "layer/layer.h"
#include "layer/spread.h"

#include <stdlib.h>
#include <string.h>

struct gn_digest {
    uint64_t version; /* of the structure: its `writes` after the build */
    uint32_t geometry;
    bool has_indices, has_activity;
    uint64_t indices, activity; /* hashes */
    uint64_t inactive, total;
    uint32_t updates;  /* in place, since the last build */
    uint32_t *order;   /* of the primitives at the first of them; NULL: not known */
    uint32_t order_count;
};

/* From so many updates in a row on, their order is held against a new one, each time that they have doubled. */
#define FIRST_LOOK 8u

void gn_digests_free(struct gn_as *as)
{
    for (uint32_t i = 0; i < as->digest_count; i++)
        free(as->digests[i].order);
    free(as->digests);
}

static uint64_t mixed(uint64_t hash, uint64_t value)
{
    hash = (hash ^ value) * UINT64_C(0x9E3779B97F4A7C15);
    return hash ^ hash >> 29;
}

static uint64_t hash_of(const unsigned char *bytes, uint64_t size)
{
    uint64_t hash = size, word = 0;
    for (; size >= 8; bytes += 8, size -= 8) {
        memcpy(&word, bytes, 8);
        hash = mixed(hash, word);
    }
    word = 0;
    memcpy(&word, bytes, size);
    return mixed(hash, word);
}

static bool is_nan(const unsigned char *bytes, uint32_t size)
{
    uint64_t bits = 0;
    memcpy(&bits, bytes, size < 8 ? size : 8);
    return size == 2   ? (bits & 0x7FFF) > 0x7C00
           : size == 4 ? (bits & 0x7FFFFFFF) > 0x7F800000
                       : (bits & UINT64_C(0x7FFFFFFFFFFFFFFF)) > UINT64_C(0x7FF0000000000000);
}

static uint32_t index_at(const struct gn_geometry_contents *contents, uint64_t i)
{
    uint32_t index = 0;
    memcpy(&index, contents->indices + i * contents->index_size, contents->index_size);
    return index;
}

/* Counts one primitive in; the hash depends on which of them are inactive. */
static void count(struct gn_digest *digest, bool inactive)
{
    digest->total++;
    if (inactive) {
        digest->inactive++;
        digest->activity = mixed(digest->activity, digest->total);
    }
}

/* Triangles with some coordinates NaN and some not are neither: nothing is said about the geometry then. */
static void digest_triangles(const struct gn_geometry_contents *contents, struct gn_digest *digest)
{
    digest->has_activity = contents->vertices && contents->component_count;
    for (uint64_t i = 0; digest->has_activity && i + 3 <= contents->index_count; i += 3) {
        uint32_t nans = 0;
        for (uint64_t corner = i; corner < i + 3; corner++) {
            uint64_t vertex = contents->indices ? index_at(contents, corner) : corner;
            if (vertex >= contents->vertex_count) {
                digest->has_activity = false;
                return;
            }
            nans += is_nan(contents->vertices + vertex * contents->vertex_stride, contents->component_size);
        }
        if (nans == 1 || nans == 2)
            digest->has_activity = false;
        count(digest, nans == 3);
    }
}

static struct gn_digest digest_of(const struct gn_geometry_contents *contents)
{
    struct gn_digest digest = {.geometry = contents->geometry};
    if (contents->boxes) {
        digest.has_activity = true;
        for (uint64_t i = 0; i < contents->box_count; i++)
            count(&digest, is_nan(contents->boxes + i * contents->box_stride, 4));
        return digest;
    }
    if (contents->indices) {
        digest.has_indices = true;
        digest.indices = hash_of(contents->indices, contents->index_count * contents->index_size);
    }
    digest_triangles(contents, &digest);
    return digest;
}

static struct gn_digest *find(const struct gn_as *as, uint32_t geometry)
{
    for (uint32_t i = 0; i < as->digest_count; i++)
        if (as->digests[i].geometry == geometry)
            return &as->digests[i];
    return NULL;
}

/* The digest is given away. */
static void keep(struct gn_device *device, struct gn_as *as, struct gn_digest *digest)
{
    struct gn_digest *known = find(as, digest->geometry);
    if (!known) {
        struct gn_digest *grown = realloc(as->digests, (as->digest_count + 1) * sizeof *grown);
        if (!grown) {
            gn_tally_lost(device);
            free(digest->order);
            return;
        }
        as->digests = grown;
        known = &grown[as->digest_count++];
        known->order = NULL;
    } else if (known->version > digest->version) {
        free(digest->order);
        return;
    }
    free(known->order);
    *known = *digest;
}

/* Goes on counting updates in place; what the build before them had in order is taken from there. Returns by how much groups have grown. */
static double count_update(const struct gn_geometry_contents *contents, struct gn_digest *before, struct gn_digest *digest)
{
    digest->updates = before->updates + 1;
    digest->order = before->order;
    digest->order_count = before->order_count;
    before->order = NULL;
    if (!digest->order && digest->updates == 1)
        digest->order = gn_spread_order(contents, &digest->order_count);
    bool look = digest->order && digest->updates >= FIRST_LOOK && (digest->updates & (digest->updates - 1)) == 0;
    return look ? gn_spread_growth(contents, digest->order, digest->order_count) : 0;
}

static const char *given_place(void *context)
{
    return context;
}

static void judge_refit(const void *value, struct gn_report *report)
{
    gn_rules_judge_refit(value, report);
}

static void judge(struct gn_device *device, const struct gn_judgement *judgement, const struct gn_geometry_contents *contents,
                  struct gn_digest *digest, const char *place, struct gn_findings *out)
{
    struct gn_as *target = judgement->tlas, *source = judgement->source;
    digest->version = judgement->version;
    struct gn_digest *before = source ? find(source, digest->geometry) : NULL;
    if (before && before->version == judgement->source_version && before->total == digest->total) {
        struct gn_findings found;
        struct gn_pending_finding *finding;
        struct gn_refit refit = {.target = {target->kind, (uint64_t)target->handle, target->name},
                                 .target_id = target->id,
                                 .geometry = digest->geometry,
                                 .indices_changed =
                                     before->has_indices && digest->has_indices && before->indices != digest->indices,
                                 .activity_changed =
                                     before->has_activity && digest->has_activity && before->activity != digest->activity,
                                 .inactive_before = before->inactive,
                                 .inactive = digest->inactive,
                                 .total = digest->total};
        if (source == target)
            refit.growth = count_update(contents, before, digest);
        refit.updates = digest->updates;
        gn_findings_init(&found);
        gn_report_suspect(device->instance,
                          &(struct gn_suspect){.judge = judge_refit,
                                               .value = &refit,
                                               .place = &refit.place,
                                               .make_place = given_place,
                                               .context = (void *)(uintptr_t)place},
                          &found);
        while ((finding = gn_findings_take(&found)))
            gn_report_confirm(device->instance, finding, out);
        gn_tally_check(device, GN_CHECKED_refits, 1);
    }
    keep(device, target, digest);
}

void gn_refit_geometry(struct gn_device *device, const struct gn_judgement *judgement, const struct gn_geometry_contents *contents,
                       const char *place, struct gn_findings *out)
{
    if (contents->partial || !judgement->may_update)
        return;
    struct gn_digest digest = digest_of(contents);
    judge(device, judgement, contents, &digest, place, out);
}
