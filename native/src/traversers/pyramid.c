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
#include "grid/surface_octree.h"
#include "trace/traverser.h"

typedef struct place {
    int level;
    int32_t cell[3];
} place;

void lr_pyramid_free(void *data)
{
    lr_octree_free(data);
}

lr_status lr_pyramid_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                           void **data, uint64_t *nbytes, lr_error *error)
{
    (void)choices;
    lr_octree *tree = NULL;
    const lr_status status = lr_octree_build(v, watch, &tree, nbytes, error);
    *data = tree;
    return status;
}

LR_INLINE void begin_walk(const lr_octree *p, const int32_t c[3], place *at)
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
    const lr_octree *p = data;
    int level = at->level;
    while (level < p->top && !same_parent(at->cell, c, level)) {
        level++;
        lr_count_node(tally);
    }
    while (lr_octree_has(p, v, level, c) && level > 0) {
        level--;
        lr_count_node(tally);
    }
    at->level = level;
    memcpy(at->cell, c, sizeof at->cell);
    if (level == 0 && lr_octree_has(p, v, 0, c))
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
