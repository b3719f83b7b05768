/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Drivers by name. `lavapipe` is the environment's own; others lie in folders below GNOMON_DRIVERS, each with
 * manifests in icd.d/ and the libraries they need in root/, which `./gnomon driver add` makes.
 */
#ifndef GNOMON_CTS_DRIVER_H
#define GNOMON_CTS_DRIVER_H

#include <stdbool.h>
#include <stddef.h>

#include "cts/arena.h"

/*
 * The ICD file of --driver: a path, or a name. NULL with a message when there is no such file, it is no
 * ICD file, or the name is unknown. Without a name: lavapipe, unless the environment (VK_DRIVER_FILES,
 * VK_ICD_FILENAMES) or, where GNOMON_ANY_DRIVER is set as in a bundle, the loader chooses, which gives "".
 */
const char *gn_driver_resolve(const char *name, struct gn_arena *arena, char *out_error, size_t error_size);

/* How to start this program for a driver that lies in a root of its own: a dynamic loader and where it finds libraries. */
struct gn_driver_loader {
    const char *loader;    /* NULL: as it is */
    const char *libraries; /* folders, parted by colons */
};
/* A driver from another distribution needs that distribution's C library, which has to be as new as ours or newer. */
struct gn_driver_loader gn_driver_loader(const char *icd, struct gn_arena *arena);

#endif
