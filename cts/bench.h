/* SPDX-License-Identifier: Apache-2.0 */
/*
 * What a driver's operations cost: one measurement at a time, for a parent that compares drivers in turns
 * (cts/gate_time.c). No judgement here.
 */
#ifndef GNOMON_CTS_BENCH_H
#define GNOMON_CTS_BENCH_H

#include "cts/device.h"

struct gn_bench_item {
    const char *name;  /* "build.triangles.16k" */
    const char *about; /* what is measured */
    bool bytes;        /* a size, which does not vary; otherwise seconds */
};
size_t gn_bench_count(void);
const struct gn_bench_item *gn_bench_item(size_t item);
/* The item of that name, or gn_bench_count(). */
size_t gn_bench_find(const char *name);

struct gn_bench;
/* Never NULL but for want of memory. The device must stay until gn_bench_destroy(). */
struct gn_bench *gn_bench_create(struct gn_device *device);
void gn_bench_destroy(struct gn_bench *bench);

/*
 * Measures one item: the shortest of several times (of one, where that is long), which is what the driver needs when nothing else gets into its way.
 * The first time prepares what the item works on. Anything but GN_DEVICE_OK: gn_device_message() says why.
 */
enum gn_device_status gn_bench_measure(struct gn_bench *bench, size_t item, double *out_value);

#endif
