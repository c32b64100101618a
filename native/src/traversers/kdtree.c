/* A k-d tree over the surface cells, cut at the median, with tight boxes.
 *
 * A node is the bounding box of its cells; it is cut across its longest side at the
 * boundary between two layers that comes nearest to halving their number. Empty space
 * lies between the boxes. A box without holes is a leaf, whose cells the ray visits one
 * by one. Boxes are tested front to back, with an explicit stack.
 *
 * Source: Subramanian and Fussell 1990. Departures: 1. leaves are boxes without holes
 * in place of single cells; 2. boxes are integers and are met by comparing integer
 * planes, so that none is widened and none is missed; children need no test against the
 * cutting plane; 3. a tight box has cells in its first and last layer, so that a cut is
 * never empty on one side; should the tree still grow deeper than MEDIAN_DEPTH, boxes
 * are cut in the middle, which bounds it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/traverser.h"

enum {
    MEDIAN_DEPTH = 64,
    MAX_DEPTH = MEDIAN_DEPTH + 3 * 21, /* halving sides of at most 2^20 cells */
};

typedef struct node {
    int32_t lo[3], hi[3]; /* cells, inclusive */
    uint32_t second;      /* the upper child, the lower one follows its parent; 0: a leaf */
    int32_t axis;
} node;

typedef struct tree {
    uint64_t n, capacity;
    node *nodes;
} tree;

typedef struct cell {
    int32_t c[3];
} cell;

/* State of the recursion. */
typedef struct job {
    tree *made;
    uint64_t n, n_done;
    uint64_t *layers; /* how many cells each has, along the axis to cut */
    const lr_watch *watch;
    lr_error *error;
} job;

void lr_kdtree_free(void *data)
{
    tree *t = data;
    if (t == NULL)
        return;
    free(t->nodes);
    free(t);
}

/* False where stopped. */
static bool list_cells(const lr_volume *v, cell *list, const lr_watch *watch)
{
    int32_t b[3] = {-1, 0, 0};
    while (lr_next_surface_brick(v, watch, b))
        for (lr_cell_iterator i = lr_surface_cells_of(v, b); lr_next_cell(&i, list->c);)
            list++;
    return !lr_stopped(watch);
}

static void bound(const cell *list, uint64_t n, node *box)
{
    memcpy(box->lo, list[0].c, sizeof box->lo);
    memcpy(box->hi, list[0].c, sizeof box->hi);
    for (uint64_t i = 1; i < n; i++)
        for (int a = 0; a < 3; a++) {
            box->lo[a] = lr_min_i(box->lo[a], list[i].c[a]);
            box->hi[a] = lr_max_i(box->hi[a], list[i].c[a]);
        }
}

/* The plane that comes nearest to halving the cells; at least a layer is on each
 * side. */
static int32_t median_plane(const cell *list, uint64_t n, int32_t lo, int32_t hi, int axis,
                            uint64_t *layers)
{
    memset(layers, 0, (size_t)(hi - lo + 1) * sizeof *layers);
    for (uint64_t i = 0; i < n; i++)
        layers[list[i].c[axis] - lo]++;
    uint64_t below = layers[0];
    int32_t plane = lo + 1;
    while (plane < hi && 2 * below + layers[plane - lo] < n)
        below += layers[plane++ - lo];
    return plane;
}

static uint64_t partition(cell *list, uint64_t n, int axis, int32_t plane)
{
    uint64_t low = 0;
    for (uint64_t i = 0; i < n; i++)
        if (list[i].c[axis] < plane) {
            const cell swap = list[i];
            list[i] = list[low];
            list[low++] = swap;
        }
    return low;
}

static lr_status open_node(tree *t, lr_error *error)
{
    if (t->n == t->capacity) {
        const uint64_t capacity = t->capacity + t->capacity / 2 + 64;
        node *nodes = realloc(t->nodes, capacity * sizeof *nodes);
        if (nodes == NULL)
            return lr_fail_memory(error, capacity * sizeof *nodes, "a k-d tree");
        t->nodes = nodes;
        t->capacity = capacity;
    }
    if (t->n == UINT32_MAX)
        return lr_fail(error, LR_E_SIZE, "a k-d tree has at most 2^32 - 1 nodes");
    t->n++;
    return LR_OK;
}

/* The node of these cells and all below it. */
static lr_status add_node(job *j, cell *list, uint64_t n, int depth)
{
    lr_status status = open_node(j->made, j->error);
    if (status == LR_OK && lr_stopped(j->watch))
        status = lr_fail_stopped(j->error);
    if (status != LR_OK)
        return status;
    const uint64_t at = j->made->n - 1;
    node box = {.second = 0};
    bound(list, n, &box);
    uint64_t volume = 1;
    for (int a = 0; a < 3; a++) {
        volume *= (uint64_t)(box.hi[a] - box.lo[a] + 1);
        if (box.hi[a] - box.lo[a] > box.hi[box.axis] - box.lo[box.axis])
            box.axis = a;
    }
    j->made->nodes[at] = box;
    if (volume == n) {
        j->n_done += n;
        lr_progress(j->watch, (double)j->n_done / (double)j->n);
        return LR_OK;
    }
    const int32_t lo = box.lo[box.axis], hi = box.hi[box.axis];
    const int32_t plane = depth < MEDIAN_DEPTH ? median_plane(list, n, lo, hi, box.axis, j->layers)
                                               : lo + (hi - lo + 1) / 2;
    const uint64_t low = partition(list, n, box.axis, plane);
    status = add_node(j, list, low, depth + 1);
    if (status != LR_OK)
        return status;
    j->made->nodes[at].second = (uint32_t)j->made->n;
    return add_node(j, list + low, n - low, depth + 1);
}

lr_status lr_kdtree_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                          void **data, uint64_t *nbytes, lr_error *error)
{
    (void)choices;
    const uint64_t n = v->n_surface_cells;
    const int32_t *size = v->table_size;
    const size_t longest = LR_SIDE * (size_t)lr_max_i(size[0], lr_max_i(size[1], size[2]));
    tree *t = calloc(1, sizeof *t);
    cell *list = malloc((n + 1) * sizeof *list);
    job j = {t, n, 0, malloc(longest * sizeof(uint64_t)), watch, error};
    lr_status status = LR_OK;
    if (t == NULL || list == NULL || j.layers == NULL)
        status = lr_fail_memory(error, n * sizeof *list, "a list of cells");
    else if (!list_cells(v, list, watch))
        status = lr_fail_stopped(error);
    else if (n > 0)
        status = add_node(&j, list, n, 0);
    free(list);
    free(j.layers);
    if (status != LR_OK) {
        lr_kdtree_free(t);
        return status;
    }
    node *fitting = realloc(t->nodes, (t->n + 1) * sizeof *fitting);
    t->nodes = fitting != NULL ? fitting : t->nodes;
    *nbytes = sizeof *t + t->n * sizeof *t->nodes;
    *data = t;
    return LR_OK;
}

/* Nodes still to be visited, the next on top, and the leaf that the cursor is in. */
typedef struct stack {
    int n;
    uint32_t node[MAX_DEPTH + 1];
    const node *leaf;
} stack;

LR_INLINE void begin_walk(const tree *t, stack *s)
{
    s->n = t->n > 0;
    s->node[0] = 0;
    s->leaf = NULL;
}

LR_INLINE bool inside(const node *box, const int32_t c[3])
{
    bool in = true;
    for (int a = 0; a < 3; a++)
        in = in && c[a] >= box->lo[a] && c[a] <= box->hi[a];
    return in;
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_lattice lattice,
                    lr_cursor *u, stack *s, bool first, lr_tally *tally)
{
    (void)v, (void)first;
    const tree *t = data;
    if (s->leaf != NULL) {
        if (!lr_step(r, lattice, u))
            return false;
        lr_count_cell(tally);
        if (inside(s->leaf, u->c))
            return true;
    }
    while (s->n > 0) {
        const uint32_t at = s->node[--s->n];
        const node *box = &t->nodes[at];
        lr_cursor there = *u;
        lr_count_node(tally);
        if (!lr_advance_to_box(r, lattice, &there, box->lo, box->hi))
            continue;
        if (box->second == 0) {
            if (s->leaf == NULL || memcmp(there.c, u->c, sizeof u->c) != 0)
                lr_count_cell(tally); /* else counted when it left the leaf before */
            *u = there;
            s->leaf = box;
            return true;
        }
        const bool up = r->s[box->axis] >= 0;
        s->node[s->n++] = up ? box->second : at + 1; /* the far child below the near one */
        s->node[s->n++] = up ? at + 1 : box->second;
    }
    return false;
}

#define LR_NAME                                             kdtree
#define LR_STATE                                            stack
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(data, state)
#define LR_WALK                                             walk
#include "trace/walk_template.h"
