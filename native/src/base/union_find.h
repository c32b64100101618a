/* Union-find: the root of an element, halving the path to it.
 *
 * Each element holds the number of its parent, a root its own. The parents may be members
 * of larger records.
 *
 * Source: Tarjan, van Leeuwen, Worst-case analysis of set union algorithms, 1984.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_BASE_UNION_FIND_H
#define LR_BASE_UNION_FIND_H

#include "base/base.h"

/* The root of element i. first: the parent of element 0, stride: bytes from one to the next. */
LR_INLINE uint32_t lr_root_of(uint32_t *first, size_t stride, uint32_t i)
{
    char *base = (char *)first;
    for (;;) {
        uint32_t *parent = (uint32_t *)(void *)(base + i * stride);
        if (*parent == i)
            return i;
        *parent = *(uint32_t *)(void *)(base + *parent * stride);
        i = *parent;
    }
}

#endif
