/* A complete octree of occupancy bits, walked with vertical moves.
 *
 * Node c of level m covers 2^m cells a side and is set where one of them holds
 * surface. An empty node is left in one jump; into a set one the walk descends.
 * After a jump it first climbs to the level at which the old and the new cell
 * share a parent, to find larger empty nodes.
 *
 * Source: Levoy 1990. Departures: 1. the levels of a brick are read from the brick
 * store's own masks and cost nothing; 2. the child is chosen from the cell's
 * integer coordinates; 3. a climb goes up as far as the parents differ.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/traverser.h"

enum { BRICK_LEVEL = LR_SIDE_BITS, MAX_LEVELS = 24 };

/* Levels above the brick's own, one bit per node. */
typedef struct pyramid {
    int top;
    int32_t size[MAX_LEVELS][3];
    uint64_t *bits[MAX_LEVELS]; /* by level; NULL up to BRICK_LEVEL */
} pyramid;

typedef struct place {
    int level;
    int32_t cell[3];
} place;

LR_INLINE size_t node_at(const pyramid *p, int level, const int32_t c[3])
{
    const int32_t *size = p->size[level];
    return ((size_t)(c[2] >> level) * (size_t)size[1] + (size_t)(c[1] >> level)) * (size_t)size[0] +
           (size_t)(c[0] >> level);
}

LR_INLINE bool set_above_brick(const pyramid *p, int level, const int32_t c[3])
{
    size_t at = node_at(p, level, c);
    return p->bits[level][at >> 6] >> (at & 63) & 1;
}

/* Does the node of that level around cell c hold surface? */
LR_INLINE bool node_set(const pyramid *p, const lr_volume *v, int level, const int32_t c[3])
{
    return level > BRICK_LEVEL ? set_above_brick(p, level, c) : lr_cube_has_surface(v, level, c);
}

static void set_node(pyramid *p, int level, const int32_t c[3])
{
    size_t at = node_at(p, level, c);
    p->bits[level][at >> 6] |= (uint64_t)1 << (at & 63);
}

void lr_pyramid_free(void *data)
{
    pyramid *p = data;
    if (p == NULL)
        return;
    for (int level = 0; level < MAX_LEVELS; level++)
        free(p->bits[level]);
    free(p);
}

static lr_status add_levels(pyramid *p, const lr_volume *v, uint64_t *nbytes, lr_error *error)
{
    int32_t largest = lr_max_i(v->table_size[0], lr_max_i(v->table_size[1], v->table_size[2]));
    p->top = BRICK_LEVEL;
    while (1 << (p->top - BRICK_LEVEL) < largest) {
        int level = ++p->top;
        size_t count = 1;
        for (int a = 0; a < 3; a++) {
            p->size[level][a] = ((LR_SIDE * v->table_size[a] - 1) >> level) + 1;
            count *= (size_t)p->size[level][a];
        }
        size_t words = (count + 63) / 64;
        p->bits[level] = calloc(words, sizeof(uint64_t));
        if (p->bits[level] == NULL)
            return lr_fail_memory(error, words * sizeof(uint64_t), "a level of the pyramid");
        *nbytes += words * sizeof(uint64_t);
    }
    return LR_OK;
}

lr_status lr_pyramid_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                           void **data, uint64_t *nbytes, lr_error *error)
{
    (void)choices;
    pyramid *p = calloc(1, sizeof *p);
    if (p == NULL)
        return lr_fail_memory(error, sizeof *p, "a pyramid");
    *nbytes = sizeof *p;
    lr_status status = add_levels(p, v, nbytes, error);
    int32_t b[3] = {-1, 0, 0};
    while (status == LR_OK && lr_next_surface_brick(v, watch, b))
        for (int level = BRICK_LEVEL + 1; level <= p->top; level++)
            set_node(p, level, (const int32_t[3]){LR_SIDE * b[0], LR_SIDE * b[1], LR_SIDE * b[2]});
    if (status == LR_OK && lr_stopped(watch))
        status = lr_fail_stopped(error);
    if (status != LR_OK) {
        lr_pyramid_free(p);
        return status;
    }
    *data = p;
    return LR_OK;
}

LR_INLINE void begin_walk(const pyramid *p, const int32_t c[3], place *at)
{
    at->level = p->top;
    memcpy(at->cell, c, sizeof at->cell);
}

LR_INLINE bool same_parent(const int32_t a[3], const int32_t b[3], int level)
{
    int32_t differ = (a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2]);
    return differ >> (level + 1) == 0;
}

LR_INLINE bool empty_node(const void *data, const lr_volume *v, const lr_ray *r, place *at,
                          const int32_t c[3], int32_t lo[3], int32_t hi[3], lr_tally *tally)
{
    const pyramid *p = data;
    int level = at->level;
    while (level < p->top && !same_parent(at->cell, c, level)) {
        level++;
        lr_count_node(tally);
    }
    while (node_set(p, v, level, c) && level > 0) {
        level--;
        lr_count_node(tally);
    }
    at->level = level;
    memcpy(at->cell, c, sizeof at->cell);
    if (level == 0 && node_set(p, v, 0, c))
        return true;
    for (int a = 0; a < 3; a++) {
        lo[a] = c[a] >> level << level;
        hi[a] = lo[a] + (1 << level) - 1;
    }
    lr_cut_box(r, lo, hi);
    return false;
}

#define LR_NAME                                             pyramid
#define LR_STATE                                            place
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(data, (cursor)->c, state)
#define LR_BOX                                              empty_node
#include "trace/walk_template.h"
