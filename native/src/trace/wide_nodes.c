/* Building trees of wide nodes: a binary hierarchy, collapsed.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/wide_nodes.h"

#include "base/error.h"
#include "base/pages.h"

/* A node of the binary hierarchy, as a branch of a wide one. */
typedef struct branch {
    uint32_t n_below;              /* boxes */
    float cost[LR_TREE_LANES - 1]; /* of so many children in its place, from 1 on: the sum of the
                                       areas of nodes and leaves */
} branch;

typedef struct builder {
    const lr_hierarchy *binary;
    const lr_leaf_maker *leaves;
    branch *branches; /* [binary->n_nodes] */
    uint32_t n_levels;
    lr_wide_tree *tree; /* whose nodes are NULL while they are counted */
} builder;

static uint32_t child_of(const builder *b, lr_child at)
{
    return b->binary->nodes[at.node].child[at.side];
}

static uint32_t n_below(const builder *b, lr_child at)
{
    const uint32_t child = child_of(b, at);
    return child == LR_NOWHERE ? 0 : (child & LR_LEAF) != 0 ? 1 : b->branches[child].n_below;
}

/* Is a branch one child whatever room there is? */
static bool is_leaf(const builder *b, lr_child at)
{
    return n_below(b, at) <= b->leaves->most;
}

static double half_area_of(const builder *b, lr_child at)
{
    lr_box box;
    const lr_node *node = &b->binary->nodes[at.node];
    for (int a = 0; a < 3; a++) {
        box.lo[a] = node->bound[0][a][at.side];
        box.hi[a] = node->bound[1][a][at.side];
    }
    return lr_half_area(&box);
}

/* What a branch costs with room for n children. */
static double cost_of(const builder *b, lr_child at, int n)
{
    return is_leaf(b, at) ? half_area_of(b, at) : b->branches[child_of(b, at)].cost[n - 1];
}

/* How many of n children are best for a node's first branch; the others are the second's. */
static int best_share(const builder *b, uint32_t node, int n, double *cost)
{
    int best = 1;
    *cost = INFINITY;
    for (int k = 1; k < n; k++) {
        const double own =
            cost_of(b, (lr_child){node, 0}, k) + cost_of(b, (lr_child){node, 1}, n - k);
        if (own < *cost) {
            *cost = own;
            best = k;
        }
    }
    return best;
}

/* Children come after their parents: what each costs is known before. */
static void count_costs(builder *b)
{
    for (uint32_t i = b->binary->n_nodes; i-- > 0;) {
        branch *own = &b->branches[i];
        double cost, open;
        lr_box box;
        const lr_node *node = &b->binary->nodes[i];
        for (int a = 0; a < 3; a++) {
            box.lo[a] = fmin((double)node->bound[0][a][0], (double)node->bound[0][a][1]);
            box.hi[a] = fmax((double)node->bound[1][a][0], (double)node->bound[1][a][1]);
        }
        own->n_below = n_below(b, (lr_child){i, 0}) + n_below(b, (lr_child){i, 1});
        best_share(b, i, LR_TREE_LANES, &cost);
        own->cost[0] = (float)(cost + lr_half_area(&box));
        for (int n = 2; n < LR_TREE_LANES; n++) {
            best_share(b, i, n, &open);
            own->cost[n - 1] = fminf((float)open, own->cost[n - 2]);
        }
    }
}

/* Put a branch's children, up to n of them, into wide[at..]; returns the next place. */
static int spread(const builder *b, lr_child branch_at, int n, lr_child wide[LR_TREE_LANES], int at)
{
    const uint32_t child = child_of(b, branch_at);
    double cost;
    if (child == LR_NOWHERE)
        return at;
    const bool opens = !is_leaf(b, branch_at) && n > 1 &&
                       b->branches[child].cost[n - 1] < b->branches[child].cost[0];
    if (!opens) {
        wide[at] = branch_at;
        return at + 1;
    }
    const int first = best_share(b, child, n, &cost);
    at = spread(b, (lr_child){child, 0}, first, wide, at);
    return spread(b, (lr_child){child, 1}, n - first, wide, at);
}

/* Up to eight branches in place of a node's two, such that all nodes below cost least. Returns how
 * many. */
static int widen(const builder *b, uint32_t node, lr_child wide[LR_TREE_LANES])
{
    double cost;
    const int first = best_share(b, node, LR_TREE_LANES, &cost);
    const int n = spread(b, (lr_child){node, 0}, first, wide, 0);
    return spread(b, (lr_child){node, 1}, LR_TREE_LANES - first, wide, n);
}

static uint32_t make_node(builder *b, uint32_t binary, uint32_t level);

/* Make a branch a child of a node, or only count what it takes. */
static uint32_t make_child(builder *b, lr_child at, uint32_t level)
{
    if (!is_leaf(b, at))
        return make_node(b, child_of(b, at), level);
    return b->leaves->make(b->leaves->own, b->binary, at) | LR_LEAF;
}

/* The same of a node of the binary hierarchy. */
static uint32_t make_node(builder *b, uint32_t binary, uint32_t level)
{
    lr_child wide[LR_TREE_LANES];
    const int n = widen(b, binary, wide);
    const uint32_t number = b->tree->n_nodes++;
    b->n_levels = level > b->n_levels ? level : b->n_levels;
    for (int l = 0; l < LR_TREE_LANES; l++) {
        const uint32_t child = l < n ? make_child(b, wide[l], level + 1) : LR_NOWHERE;
        if (b->tree->nodes == NULL)
            continue;
        lr_wide_node *node = &b->tree->nodes[number];
        node->child[l] = child;
        for (int a = 0; a < 3; a++)
            for (int end = 0; end < 2; end++)
                node->bound[end][a][l] =
                    l < n ? b->binary->nodes[wide[l].node].bound[end][a][wide[l].side]
                          : (end == 0 ? INFINITY : -INFINITY);
    }
    return number;
}

static uint32_t take_box(void *own, const lr_hierarchy *binary, lr_child at)
{
    (void)own;
    return binary->nodes[at.node].child[at.side] & ~LR_LEAF;
}

const lr_leaf_maker LR_ONE_BOX = {.most = 1, .make = take_box};

lr_status lr_wide_build(const lr_hierarchy *binary, const lr_leaf_maker *leaves, lr_wide_tree *tree,
                        lr_error *error)
{
    *tree = (lr_wide_tree){.n_branches = 1};
    if (binary->n_nodes == 0)
        return LR_OK;
    const size_t size = (size_t)binary->n_nodes * sizeof(branch);
    builder b = {binary, leaves, malloc(size), 0, tree};
    if (b.branches == NULL)
        return lr_fail_memory(error, size, "the making of a tree of boxes");
    count_costs(&b);
    make_node(&b, 0, 1);
    tree->n_branches = (LR_TREE_LANES - 1) * b.n_levels + 1; /* each level puts eight for one */
    tree->nodes = lr_pages_new(tree->n_nodes, sizeof *tree->nodes);
    lr_status status = LR_OK;
    if (tree->nodes == NULL)
        status =
            lr_fail_memory(error, tree->n_nodes * (uint64_t)sizeof *tree->nodes, "a tree of boxes");
    else if (leaves->counted != NULL)
        status = leaves->counted(leaves->own, error);
    tree->n_nodes = 0;
    if (status == LR_OK)
        make_node(&b, 0, 1);
    free(b.branches);
    return status;
}
