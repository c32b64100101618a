/* Arrays one after the other in one buffer of the caller's.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_BASE_ARENA_H
#define LR_BASE_ARENA_H

#include "base/base.h"

typedef struct lr_arena {
    char *base; /* NULL: only the size is asked for */
    uint64_t used;
} lr_arena;

/* Room for n things of that size, NULL without a buffer. Arrays begin on cache lines where the
 * buffer does. A line between two lets thing i of arrays of 2^k bytes lie in different sets of the
 * cache: those are mostly read together. */
LR_INLINE void *lr_arena_take(lr_arena *arena, uint64_t n, size_t size)
{
    const uint64_t line = 64;
    void *p = arena->base != NULL ? arena->base + arena->used : NULL;
    arena->used += ((n * size + line - 1) / line + 1) * line;
    return p;
}

LR_INLINE double *lr_arena_take_doubles(lr_arena *arena, uint64_t n)
{
    return lr_arena_take(arena, n, sizeof(double));
}

#endif
