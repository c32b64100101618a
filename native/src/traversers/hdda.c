/* A shallow, wide tree: roots over nodes of 16^3 bricks over the store's bricks.
 *
 * The ray leaves the largest of the three that is empty: the whole region of a
 * missing node (128^3 cells), a missing brick, or one cell of a brick that holds
 * surface. A node is a mask of its bricks; a brick is found by counting the bits
 * before its own. Memory grows with the surface, but for 4 bytes per region.
 *
 * Source: Museth 2013 (the tree of OpenVDB) and 2014 (the hierarchical digital
 * differential analyser). Departures: 1. every step is a box left by the exit
 * kernel, none is a nudge of t; 2. the last brick is cached, so that single
 * steps do not descend again; 3. roots are a dense table.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/next_planes.h"
#include "trace/traverser.h"

enum { NODE_BITS = 4, NODE_BRICKS = 1 << 3 * NODE_BITS };

#define NO_NODE UINT32_MAX

typedef struct node {
    uint64_t mask[NODE_BRICKS / 64];
    uint32_t first[NODE_BRICKS / 64]; /* leaf of the first brick in each word */
} node;

typedef struct tree {
    int32_t size[3]; /* regions per axis */
    uint32_t n_nodes;
    uint32_t *roots; /* [regions]: a node, or NO_NODE */
    node *nodes;
    uint32_t *leaves; /* entries of the bricks that hold surface, node by node */
} tree;

void lr_hdda_free(void *data)
{
    tree *t = data;
    if (t == NULL)
        return;
    free(t->roots);
    free(t->nodes);
    free(t->leaves);
    free(t);
}

LR_INLINE size_t root_at(const tree *t, const int32_t b[3])
{
    const size_t row = (size_t)t->size[0], slice = row * (size_t)t->size[1];
    return (size_t)(b[0] >> NODE_BITS) + (size_t)(b[1] >> NODE_BITS) * row +
           (size_t)(b[2] >> NODE_BITS) * slice;
}

LR_INLINE uint32_t brick_in_node(const int32_t b[3])
{
    return (uint32_t)((b[0] & 15) | (b[1] & 15) << 4 | (b[2] & 15) << 8);
}

/* Brick `in` of region `at`, in table coordinates; false beyond the table. */
static bool brick_of(const tree *t, const lr_volume *v, size_t at, uint32_t in, int32_t b[3])
{
    const size_t row = (size_t)t->size[0], slice = row * (size_t)t->size[1];
    b[0] = (int32_t)(at % row << NODE_BITS | (in & 15));
    b[1] = (int32_t)(at % slice / row << NODE_BITS | (in >> 4 & 15));
    b[2] = (int32_t)(at / slice << NODE_BITS | in >> 8);
    return b[0] < v->table_size[0] && b[1] < v->table_size[1] && b[2] < v->table_size[2];
}

/* Fill a node's mask and count its leaves; write these unless leaves is NULL. */
static uint32_t add_node(const tree *t, const lr_volume *v, size_t at, node *made, uint32_t n,
                         uint32_t *leaves)
{
    memset(made, 0, sizeof *made);
    for (uint32_t in = 0; in < NODE_BRICKS; in++) {
        int32_t b[3];
        if ((in & 63) == 0)
            made->first[in >> 6] = n;
        if (!brick_of(t, v, at, in, b))
            continue;
        const uint32_t entry = lr_entry_at(v, lr_table_at(v, b[0], b[1], b[2]));
        if (lr_entry_words(entry) == 0)
            continue;
        made->mask[in >> 6] |= (uint64_t)1 << (in & 63);
        if (leaves != NULL)
            leaves[n] = entry;
        n++;
    }
    return n;
}

static lr_status make_roots(tree *t, const lr_volume *v, size_t *regions, uint32_t *n_leaves,
                            const lr_watch *watch, lr_error *error)
{
    *regions = 1;
    for (int a = 0; a < 3; a++) {
        t->size[a] = ((v->table_size[a] - 1) >> NODE_BITS) + 1;
        *regions *= (size_t)t->size[a];
    }
    t->roots = malloc(*regions * sizeof *t->roots);
    if (t->roots == NULL)
        return lr_fail_memory(error, *regions * sizeof *t->roots, "a tree");
    for (size_t at = 0; at < *regions; at++) {
        node unused;
        const uint32_t n = add_node(t, v, at, &unused, 0, NULL);
        t->roots[at] = n > 0 ? t->n_nodes++ : NO_NODE;
        *n_leaves += n;
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
    }
    return LR_OK;
}

lr_status lr_hdda_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                        void **data, uint64_t *nbytes, lr_error *error)
{
    (void)choices;
    size_t regions;
    uint32_t n_leaves = 0, n = 0;
    tree *t = calloc(1, sizeof *t);
    if (t == NULL)
        return lr_fail_memory(error, sizeof *t, "a tree");
    lr_status status = make_roots(t, v, &regions, &n_leaves, watch, error);
    if (status != LR_OK) {
        lr_hdda_free(t);
        return status;
    }
    *nbytes = sizeof *t + regions * sizeof *t->roots + t->n_nodes * sizeof *t->nodes +
              n_leaves * sizeof *t->leaves;
    t->nodes = malloc((t->n_nodes + (size_t)1) * sizeof *t->nodes);
    t->leaves = malloc((n_leaves + (size_t)1) * sizeof *t->leaves);
    if (t->nodes == NULL || t->leaves == NULL)
        status = lr_fail_memory(error, *nbytes, "a tree");
    for (size_t at = 0; status == LR_OK && at < regions; at++) {
        if (t->roots[at] != NO_NODE)
            n = add_node(t, v, at, &t->nodes[t->roots[at]], n, t->leaves);
        if (lr_stopped(watch))
            status = lr_fail_stopped(error);
        lr_progress(watch, (double)(at + 1) / (double)regions);
    }
    if (status != LR_OK) {
        lr_hdda_free(t);
        return status;
    }
    *data = t;
    return LR_OK;
}

/* The brick last looked up. */
typedef struct place {
    int32_t brick[3];
    int shift; /* cells of the empty box: 2^shift; 0 in a brick with surface */
    uint32_t entry;
    bool steps; /* cell by cell, by the planes */
    lr_planes planes;
} place;

LR_INLINE void descend(const tree *t, place *at, lr_tally *tally)
{
    const uint32_t root = t->roots[root_at(t, at->brick)];
    lr_count_node(tally);
    at->shift = LR_SIDE_BITS + NODE_BITS;
    if (root == NO_NODE)
        return;
    const node *n = &t->nodes[root];
    const uint32_t in = brick_in_node(at->brick);
    const uint64_t word = n->mask[in >> 6], bit = (uint64_t)1 << (in & 63);
    lr_count_node(tally);
    at->shift = LR_SIDE_BITS;
    if (!(word & bit))
        return;
    at->shift = 0;
    at->entry = t->leaves[n->first[in >> 6] + (uint32_t)__builtin_popcountll(word & (bit - 1))];
}

LR_INLINE void look_up(const tree *t, place *at, const int32_t c[3], lr_tally *tally)
{
    if (lr_brick_of(c[0]) == at->brick[0] && lr_brick_of(c[1]) == at->brick[1] &&
        lr_brick_of(c[2]) == at->brick[2])
        return;
    for (int a = 0; a < 3; a++)
        at->brick[a] = lr_brick_of(c[a]);
    descend(t, at, tally);
}

LR_INLINE bool leave_empty(const lr_ray *r, lr_lattice lattice, lr_cursor *u, place *at)
{
    int32_t lo[3], hi[3];
    for (int a = 0; a < 3; a++) {
        lo[a] = u->c[a] >> at->shift << at->shift;
        hi[a] = lo[a] + (1 << at->shift) - 1;
    }
    lr_cut_box(r, lo, hi);
    at->steps = false;
    return lr_exit(r, lattice, u, lo, hi);
}

/* Leave a cell of a brick that holds surface. */
LR_INLINE bool leave_cell(const lr_ray *r, lr_lattice lattice, lr_cursor *u, place *at)
{
    double t;
    if (!at->steps)
        lr_planes_begin(&at->planes, r, lattice, u);
    at->steps = true;
    if (!lr_planes_step(&at->planes, r, lattice, u, &t))
        return false;
    u->t = t > u->t ? t : u->t;
    return true;
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_lattice lattice,
                    lr_cursor *u, place *at, bool first, lr_tally *tally)
{
    for (bool leaves = !first;; leaves = true) {
        if (leaves &&
            !(at->shift == 0 ? leave_cell(r, lattice, u, at) : leave_empty(r, lattice, u, at)))
            return false;
        look_up(data, at, u->c, tally);
        lr_count_cell(tally);
        if (at->shift == 0 && lr_entry_has(v, at->entry, u->c))
            return true;
        lr_count_jump(tally, at->shift != 0);
    }
}

LR_INLINE void begin(place *at)
{
    at->brick[0] = -1; /* none yet */
    at->entry = 0;
    at->steps = false;
}

#define LR_NAME                                             hdda
#define LR_STATE                                            place
#define LR_START(data, volume, ray, lattice, cursor, state) begin(state)
#define LR_WALK                                             walk
#include "trace/walk_template.h"
