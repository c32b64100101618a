/* A quadtree over the pixels of an image.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "imaging/open_pixels.h"

/* Nodes along a side of a level. */
static int32_t nodes_along(int32_t pixels, int level)
{
    return ((pixels - 1) >> level) + 1;
}

bool lr_open_all_pixels(lr_open_pixels *q, int32_t width, int32_t height, uint64_t *nbytes)
{
    uint64_t offset[LR_QUAD_LEVELS], used = 0;
    q->top = 0;
    for (int level = 0;; level++) {
        q->width[level] = nodes_along(width, level);
        offset[level] = used;
        used += (uint64_t)q->width[level] * (uint64_t)nodes_along(height, level);
        q->top = level;
        if (nodes_along(lr_max_i(width, height), level) == 1)
            break;
    }
    *nbytes = used;
    q->memory = malloc(used);
    if (q->memory == NULL)
        return false;
    for (int level = 0; level <= q->top; level++) {
        q->open[level] = q->memory + offset[level];
        const int32_t columns = q->width[level], rows = nodes_along(height, level);
        for (int32_t y = 0; y < rows; y++)
            for (int32_t x = 0; x < columns; x++) {
                const int below = level == 0 ? 0 : level - 1;
                const int children_x = level == 0 || 2 * x + 1 == q->width[below] ? 1 : 2;
                const int children_y =
                    level == 0 || 2 * y + 1 == nodes_along(height, below) ? 1 : 2;
                q->open[level][(size_t)y * (size_t)columns + (size_t)x] =
                    (uint8_t)(children_x * children_y);
            }
    }
    return true;
}

void lr_free_pixels(lr_open_pixels *q)
{
    free(q->memory);
}

bool lr_node_is_open(const lr_open_pixels *q, int level, int32_t x, int32_t y, const lr_rect *r)
{
    if (q->open[level][(size_t)y * (size_t)q->width[level] + (size_t)x] == 0)
        return false;
    const int32_t x0 = x << level, y0 = y << level, last = (1 << level) - 1;
    if (x0 >= r->x0 && x0 + last <= r->x1 && y0 >= r->y0 && y0 + last <= r->y1)
        return true;
    if (level == 0)
        return true;
    for (int32_t j = lr_max_i(y0, r->y0) >> (level - 1);
         j <= lr_min_i(y0 + last, r->y1) >> (level - 1); j++)
        for (int32_t i = lr_max_i(x0, r->x0) >> (level - 1);
             i <= lr_min_i(x0 + last, r->x1) >> (level - 1); i++)
            if (lr_node_is_open(q, level - 1, i, j, r))
                return true;
    return false;
}
