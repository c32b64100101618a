/* A quadtree over the pixels of an image: which of them are still open, and does a rectangle hold
 * one? A node counts its open children, so that filling a pixel goes up only as far as nodes close.
 *
 * Source: the occlusion quadtree of Meagher 1982.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_IMAGING_OPEN_PIXELS_H
#define LR_IMAGING_OPEN_PIXELS_H

#include "base/base.h"

enum { LR_QUAD_LEVELS = 32 };

/* Pixels x0..x1 and y0..y1, inclusive. */
typedef struct lr_rect {
    int32_t x0, y0, x1, y1;
} lr_rect;

typedef struct lr_open_pixels {
    int top;
    int32_t width[LR_QUAD_LEVELS];
    uint8_t *open[LR_QUAD_LEVELS]; /* of level 0 a flag per pixel, above open children per node */
    uint8_t *memory;
} lr_open_pixels;

/* All open; false without memory, of which *nbytes are wanted. Ends by lr_free_pixels. */
bool lr_open_all_pixels(lr_open_pixels *q, int32_t width, int32_t height, uint64_t *nbytes);
void lr_free_pixels(lr_open_pixels *q);

/* Does a node of that level hold an open pixel of the rectangle? */
bool lr_node_is_open(const lr_open_pixels *q, int level, int32_t x, int32_t y, const lr_rect *r);

LR_INLINE bool lr_pixel_is_open(const lr_open_pixels *q, int32_t x, int32_t y)
{
    return q->open[0][(size_t)y * (size_t)q->width[0] + (size_t)x] != 0;
}

/* Does a rectangle of the image hold an open pixel? */
LR_INLINE bool lr_rect_is_open(const lr_open_pixels *q, const lr_rect *r)
{
    int level = 0; /* at which the rectangle meets four nodes at the most */
    const int32_t size = lr_max_i(r->x1 - r->x0, r->y1 - r->y0);
    while (level < q->top && 1 << level < size)
        level++;
    for (int32_t y = r->y0 >> level; y <= r->y1 >> level; y++)
        for (int32_t x = r->x0 >> level; x <= r->x1 >> level; x++)
            if (lr_node_is_open(q, level, x, y, r))
                return true;
    return false;
}

/* Close an open pixel. */
LR_INLINE void lr_close_pixel(lr_open_pixels *q, int32_t x, int32_t y)
{
    for (int level = 0; level <= q->top; level++) {
        uint8_t *open =
            &q->open[level][(size_t)(y >> level) * (size_t)q->width[level] + (size_t)(x >> level)];
        if (--*open != 0)
            return;
    }
}

#endif
