/* SPDX-License-Identifier: Apache-2.0 */
/* Memory that lives as long as a case runs. */
#ifndef GNOMON_CTS_ARENA_H
#define GNOMON_CTS_ARENA_H

#include <stddef.h>

struct gn_arena {
    struct gn_arena_block *last;
};

/* Zeroed memory for `count` things of `size` bytes, aligned for any type. Never NULL: the process ends with a
 * message and exit status 3 when memory is short or the product overflows (a worker's parent sees that). */
void *gn_arena_alloc(struct gn_arena *arena, size_t count, size_t size);
char *gn_arena_printf(struct gn_arena *arena, const char *format, ...) __attribute__((format(printf, 2, 3)));
void gn_arena_finish(struct gn_arena *arena);

#define GN_NEW(arena, type, count) ((type *)gn_arena_alloc((arena), (count), sizeof(type)))

#endif
