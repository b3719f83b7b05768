/* SPDX-License-Identifier: Apache-2.0 */
/* A fake next layer below the layer's real functions, for what no driver here has: builds on the host, indirect builds, several queues,
 * failures. Copies take place when they are recorded, and builds do nothing. */
#ifndef GN_TESTS_LAYER_FAKE_H
#define GN_TESTS_LAYER_FAKE_H

#include "layer/layer.h"

#include <setjmp.h>
#include <stdarg.h>

#include <cmocka.h>

/* Dispatchable handles: all the loader promises is that the first word is a dispatch table. */
struct fake {
    void *table;
};
extern struct fake fake_queues[2];

/* What the next calls return; set_up makes all of them VK_SUCCESS. A deferred operation ends with build_result once it is not
 * VK_OPERATION_DEFERRED_KHR any more. */
extern VkResult submit_result, build_result, fence_status, query_result;
extern uint64_t one_address;   /* of every structure, if it is not 0 */
extern uint64_t compacted_size; /* that every question gets; 600 at first */
extern const void *copy_source; /* host memory whose address is that of every buffer; the fixture's record at first */
extern VkBufferUsageFlags2 usage_seen; /* of the last buffer, as it came to the next layer by either way of asking */

/* The call (of those that give a result) that gives fail_with instead, counted from 1; 0: none. How many there were. */
extern uint32_t fail_at, calls_made;
extern VkResult fail_with;

struct fixture {
    struct gn_instance instance;
    struct gn_device *device;
    VkDevice handle;
    VkCommandBuffer commands[8];
    _Alignas(16) VkAccelerationStructureInstanceKHR record;
    VkBuffer input;
};

/* For cmocka: the fixture is the state. All rules are on but those about barriers. */
int set_up(void **state);
int tear_down(void **state);

#define BOTTOM VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR
#define TOP VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR

VkAccelerationStructureKHR make(struct fixture *fixture, VkAccelerationStructureTypeKHR type);

/* The build of a TLAS with the fixture's one record, or of a BLAS. */
struct job {
    VkAccelerationStructureGeometryKHR geometry;
    VkAccelerationStructureBuildGeometryInfoKHR info;
    VkAccelerationStructureBuildRangeInfoKHR range;
    const VkAccelerationStructureBuildRangeInfoKHR *ranges;
};
void job_fill(struct job *job, struct fixture *fixture, VkAccelerationStructureKHR target, VkAccelerationStructureTypeKHR type);
VkResult on_host(struct fixture *fixture, VkAccelerationStructureKHR target, VkAccelerationStructureTypeKHR type);
void submit_one(struct fixture *fixture, int queue, int commands);
void on_queue(struct fixture *fixture, int queue, int commands, VkAccelerationStructureKHR target, VkAccelerationStructureTypeKHR type,
              VkFence fence);
void update_on_queue(struct fixture *fixture, int queue, int commands, VkAccelerationStructureKHR blas);

unsigned long long checked(const struct fixture *fixture, enum gn_checked what);
unsigned long long unjudged(const struct fixture *fixture, enum gn_unjudged what);

#endif
