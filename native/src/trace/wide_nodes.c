/* Building trees of wide nodes: a binary hierarchy, collapsed.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/wide_nodes.h"

#include "base/error.h"
#include "base/pages.h"

typedef struct builder {
    const lr_hierarchy *binary;
    const lr_leaf_maker *leaves;
    uint32_t *n_below; /* [binary->n_nodes]: boxes */
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
    return child == LR_NOWHERE ? 0 : (child & LR_LEAF) != 0 ? 1 : b->n_below[child];
}

/* Children come after their parents. */
static void count_below(builder *b)
{
    for (uint32_t i = b->binary->n_nodes; i-- > 0;)
        b->n_below[i] = n_below(b, (lr_child){i, 0}) + n_below(b, (lr_child){i, 1});
}

static double half_area_of(const builder *b, lr_child at)
{
    double size[3];
    const lr_node *node = &b->binary->nodes[at.node];
    for (int a = 0; a < 3; a++)
        size[a] = (double)node->bound[1][a][at.side] - (double)node->bound[0][a][at.side];
    return size[0] * size[1] + size[1] * size[2] + size[2] * size[0];
}

/* Up to eight branches in place of a node's two: the largest that does not fit into a leaf is
 * opened, again and again. Returns how many. */
static int widen(const builder *b, uint32_t node, lr_child wide[LR_TREE_LANES])
{
    int n = 0;
    for (int side = 0; side < 2; side++)
        if (child_of(b, (lr_child){node, side}) != LR_NOWHERE)
            wide[n++] = (lr_child){node, side};
    while (n < LR_TREE_LANES) {
        int largest = -1;
        double most = -1.0;
        for (int i = 0; i < n; i++)
            if (n_below(b, wide[i]) > b->leaves->most && half_area_of(b, wide[i]) > most) {
                most = half_area_of(b, wide[i]);
                largest = i;
            }
        if (largest < 0)
            break;
        const uint32_t opened = child_of(b, wide[largest]);
        wide[largest] = (lr_child){opened, 0};
        wide[n++] = (lr_child){opened, 1};
    }
    return n;
}

static uint32_t make_node(builder *b, uint32_t binary, uint32_t level);

/* Make a branch a child of a node, or only count what it takes. */
static uint32_t make_child(builder *b, lr_child at, uint32_t level)
{
    if (n_below(b, at) > b->leaves->most)
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
    const size_t size = (size_t)binary->n_nodes * sizeof(uint32_t);
    builder b = {binary, leaves, malloc(size), 0, tree};
    if (b.n_below == NULL)
        return lr_fail_memory(error, size, "the making of a tree of boxes");
    count_below(&b);
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
    free(b.n_below);
    return status;
}
