/* SPDX-License-Identifier: Apache-2.0 */
/* A chain of blocks; everything a case allocates goes at once. */
#include "cts/arena.h"

#include <stdalign.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#define BLOCK_BYTES ((size_t)64 * 1024)

struct gn_arena_block {
    struct gn_arena_block *previous;
    size_t used;
    size_t size;
    alignas(max_align_t) unsigned char bytes[];
};

static _Noreturn void out_of_memory(size_t count, size_t size)
{
    fprintf(stderr, "gnomon: no memory for %zu things of %zu bytes\n", count, size);
    /* A worker ends here: no atexit handlers, which may wait for a driver's threads. */
    _Exit(3);
}

static struct gn_arena_block *block_create(size_t size)
{
    size_t bytes = 0;
    if (__builtin_add_overflow(sizeof(struct gn_arena_block), size, &bytes)) {
        return NULL;
    }
    struct gn_arena_block *block = calloc(1, bytes);
    if (block) {
        block->size = size;
    }
    return block;
}

void *gn_arena_alloc(struct gn_arena *arena, size_t count, size_t size)
{
    const size_t alignment = alignof(max_align_t);
    size_t bytes = 0;
    if (__builtin_mul_overflow(count, size, &bytes) ||
        __builtin_add_overflow(bytes, alignment - 1, &bytes)) {
        out_of_memory(count, size);
    }
    bytes &= ~(alignment - 1);

    struct gn_arena_block *last = arena->last;
    if (last && bytes <= last->size - last->used) {
        void *memory = last->bytes + last->used;
        last->used += bytes;
        return memory;
    }
    struct gn_arena_block *block = block_create(bytes > BLOCK_BYTES ? bytes : BLOCK_BYTES);
    if (!block) {
        out_of_memory(count, size);
    }
    block->used = bytes;
    /* A block for one large thing is full at once: the one in use stays in front, with the room it has. */
    if (last && bytes > BLOCK_BYTES) {
        block->previous = last->previous;
        last->previous = block;
    } else {
        block->previous = last;
        arena->last = block;
    }
    return block->bytes;
}

char *gn_arena_printf(struct gn_arena *arena, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    va_list again;
    va_copy(again, arguments);
    const int length = vsnprintf(NULL, 0, format, arguments);
    va_end(arguments);
    const size_t size = length < 0 ? 1 : (size_t)length + 1;
    char *text = gn_arena_alloc(arena, size, 1);
    if (length >= 0) {
        vsnprintf(text, size, format, again);
    }
    va_end(again);
    return text;
}

void gn_arena_finish(struct gn_arena *arena)
{
    struct gn_arena_block *block = arena->last;
    while (block) {
        struct gn_arena_block *previous = block->previous;
        free(block);
        block = previous;
    }
    arena->last = NULL;
}
