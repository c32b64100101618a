/* Building the hierarchy: the surface area heuristic over 16 bins per axis.
 *
 * Source: Wald, On fast construction of SAH-based bounding volume hierarchies,
 * 2007.
 * Departures: 1. one box per leaf, so no cost decides about leaves; 2. the
 * height is bounded: where no plane separates the boxes, or only halving still fits
 * under LR_HEIGHT_MAX, the list is halved in its present order.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/bvh.h"

#include <float.h>

#include "base/error.h"

enum { N_BINS = 16 };

typedef struct lr_builder {
    const lr_box *boxes;
    uint32_t *order; /* boxes; a node owns a range of them */
    uint32_t at_once;
    lr_hierarchy *out;
} lr_builder;

typedef struct lr_split {
    double cost;
    int axis, bin; /* bins up to this one go left */
} lr_split;

/* The bins along one axis. */
typedef struct lr_bin_row {
    double lo, scale;
    lr_box box[N_BINS];
    uint32_t n[N_BINS];
} lr_bin_row;

static const lr_box EMPTY = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

/* Of numbers, which fmin and fmax would ask for. */
LR_INLINE double lesser(double a, double b)
{
    return a < b ? a : b;
}

LR_INLINE double greater(double a, double b)
{
    return a > b ? a : b;
}

LR_INLINE void include(lr_box *box, const lr_box *other)
{
    for (int a = 0; a < 3; a++) {
        box->lo[a] = lesser(box->lo[a], other->lo[a]);
        box->hi[a] = greater(box->hi[a], other->hi[a]);
    }
}

/* Halved before the sum, which could overflow. */
static double centre(const lr_box *box, int axis)
{
    return 0.5 * box->lo[axis] + 0.5 * box->hi[axis];
}

static int bin_of(const lr_bin_row *bins, const lr_box *box, int axis)
{
    return (int)lr_clamp((centre(box, axis) - bins->lo) * bins->scale, 0, N_BINS - 1);
}

/* False where all centres coincide. */
static bool lay_bins(lr_bin_row *bins, double lo, double hi)
{
    bins->lo = lo;
    bins->scale = N_BINS / (hi - lo);
    for (int b = 0; b < N_BINS; b++) {
        bins->box[b] = EMPTY;
        bins->n[b] = 0;
    }
    return hi > lo && isfinite(bins->scale);
}

/* What it costs to meet n boxes in a box. */
static double cost_of(const lr_box *box, uint32_t n, uint32_t at_once)
{
    return n > 0 ? lr_half_area(box) * ((n + at_once - 1) / at_once) : INFINITY;
}

static void best_of_axis(const lr_bin_row *bins, uint32_t at_once, int axis, lr_split *best)
{
    double cost_right[N_BINS];
    lr_box box = EMPTY;
    uint32_t n = 0;
    for (int b = N_BINS - 1; b > 0; b--) {
        include(&box, &bins->box[b]);
        n += bins->n[b];
        cost_right[b] = cost_of(&box, n, at_once);
    }
    box = EMPTY;
    n = 0;
    for (int b = 0; b < N_BINS - 1; b++) {
        include(&box, &bins->box[b]);
        n += bins->n[b];
        const double cost = cost_of(&box, n, at_once) + cost_right[b + 1];
        if (cost < best->cost)
            *best = (lr_split){cost, axis, b};
    }
}

static uint32_t log2_up(uint32_t n)
{
    uint32_t k = 0;
    while ((uint64_t)1 << k < n)
        k++;
    return k;
}

/* As bins would sort two boxes: along the first axis on which their centres differ. */
static void sort_two(const lr_builder *b, uint32_t order[2])
{
    for (int a = 0; a < 3; a++) {
        const double first = centre(&b->boxes[order[0]], a);
        const double second = centre(&b->boxes[order[1]], a);
        const double apart = fabs(second - first);
        if (!(apart > 0.0 && isfinite(N_BINS / apart)))
            continue;
        if (second < first) {
            const uint32_t box = order[0];
            order[0] = order[1];
            order[1] = box;
        }
        return;
    }
}

/* How many of the n boxes go left. */
static uint32_t partition(lr_builder *b, uint32_t *order, uint32_t n, uint32_t level)
{
    if (level + 1 + log2_up(n) >= LR_HEIGHT_MAX)
        return n / 2;
    if (n == 2) {
        sort_two(b, order);
        return 1;
    }
    lr_split best = {INFINITY, 0, 0};
    lr_bin_row bins[3];
    lr_box centres = EMPTY;
    for (uint32_t i = 0; i < n; i++)
        for (int a = 0; a < 3; a++) {
            const double c = centre(&b->boxes[order[i]], a);
            centres.lo[a] = lesser(centres.lo[a], c);
            centres.hi[a] = greater(centres.hi[a], c);
        }
    bool spread[3];
    for (int a = 0; a < 3; a++)
        spread[a] = lay_bins(&bins[a], centres.lo[a], centres.hi[a]);
    for (uint32_t i = 0; i < n; i++) {
        const lr_box *box = &b->boxes[order[i]];
        for (int a = 0; a < 3; a++) {
            if (!spread[a])
                continue;
            const int bin = bin_of(&bins[a], box, a);
            include(&bins[a].box[bin], box);
            bins[a].n[bin]++;
        }
    }
    for (int a = 0; a < 3; a++)
        if (spread[a])
            best_of_axis(&bins[a], b->at_once, a, &best);
    if (!(best.cost < INFINITY))
        return n / 2;
    uint32_t left = 0;
    for (uint32_t i = 0; i < n; i++) {
        const uint32_t box = order[i];
        if (bin_of(&bins[best.axis], &b->boxes[box], best.axis) > best.bin)
            continue;
        order[i] = order[left];
        order[left++] = box;
    }
    return left;
}

static float round_down(double x)
{
    const float y = (float)x;
    return (double)y > x ? nextafterf(y, -INFINITY) : y;
}

static float round_up(double x)
{
    const float y = (float)x;
    return (double)y < x ? nextafterf(y, INFINITY) : y;
}

static uint32_t build(lr_builder *b, uint32_t *order, uint32_t n, uint32_t level);

/* Make child c of a node from n boxes; none leave an empty box. */
static void adopt(lr_builder *b, uint32_t node, int c, uint32_t *order, uint32_t n, uint32_t level)
{
    lr_box box = EMPTY;
    for (uint32_t i = 0; i < n; i++)
        include(&box, &b->boxes[order[i]]);
    for (int a = 0; a < 3; a++) {
        b->out->nodes[node].bound[0][a][c] = round_down(box.lo[a]);
        b->out->nodes[node].bound[1][a][c] = round_up(box.hi[a]);
    }
    b->out->nodes[node].child[c] = n > 1    ? build(b, order, n, level)
                                   : n == 1 ? order[0] | LR_LEAF
                                            : LR_NOWHERE;
}

/* A node over n boxes. Only the root can have fewer than two. */
static uint32_t build(lr_builder *b, uint32_t *order, uint32_t n, uint32_t level)
{
    const uint32_t node = b->out->n_nodes++;
    const uint32_t left = n > 1 ? partition(b, order, n, level) : n;
    adopt(b, node, 0, order, left, level + 1);
    adopt(b, node, 1, order + left, n - left, level + 1);
    return node;
}

lr_status lr_hierarchy_build(const lr_box *boxes, uint32_t n, uint32_t at_once,
                             lr_hierarchy *hierarchy, lr_error *error)
{
    *hierarchy = (lr_hierarchy){.nodes = NULL};
    uint32_t *order = malloc((size_t)n * sizeof *order + 1);
    if (order == NULL)
        return lr_fail_memory(error, (uint64_t)n * sizeof *order, "the order of boxes");
    uint32_t n_leaves = 0;
    for (uint32_t i = 0; i < n; i++)
        if (boxes[i].lo[0] <= boxes[i].hi[0])
            order[n_leaves++] = i;
    if (n_leaves > 0) {
        const size_t nbytes = (size_t)n_leaves * sizeof(lr_node);
        hierarchy->nodes = malloc(nbytes);
        if (hierarchy->nodes == NULL) {
            free(order);
            return lr_fail_memory(error, nbytes, "the hierarchy over boxes");
        }
        build(&(lr_builder){boxes, order, at_once, hierarchy}, order, n_leaves, 0);
    }
    free(order);
    return LR_OK;
}
