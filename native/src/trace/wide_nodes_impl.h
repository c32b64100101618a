/* A ray through a tree of wide nodes. Included by files compiled for their instructions, which
 * define LR_WIDE_CROSSED(in, out, last), the lanes in which in <= out and in <= last, as bits;
 * see triangle_tree_impl.h.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/wide_nodes.h"

typedef float wide_floats __attribute__((vector_size(LR_TREE_LANES * sizeof(float))));
typedef int32_t wide_mask __attribute__((vector_size(LR_TREE_LANES * sizeof(float))));

#define WIDE_EACH(x)       ((x) - (wide_floats){0.0f}) /* x in each lane */
#define WIDE_PICK(m, a, b) ((wide_floats)(((m) & (wide_mask)(a)) | (~(m) & (wide_mask)(b))))
#define WIDE_MORE(a, b)    WIDE_PICK((a) > (b), a, b) /* b where one is NaN */
#define WIDE_LESS(a, b)    WIDE_PICK((a) < (b), a, b)

#ifndef LR_WIDE_CROSSED
LR_INLINE uint32_t wide_crossed(const wide_floats *in, const wide_floats *out, float last)
{
    uint32_t lanes = 0;
    for (int l = 0; l < LR_TREE_LANES; l++)
        lanes |= (uint32_t)((*in)[l] <= (*out)[l] && (*in)[l] <= last) << l;
    return lanes;
}
#define LR_WIDE_CROSSED wide_crossed
#endif

/* The children whose boxes the ray enters, as bits, no later than `last`; *t: where. */
LR_INLINE uint32_t wide_enter(const lr_wide_node *node, const lr_slabs *s, float last,
                              wide_floats *t)
{
    const wide_floats *bound = (const wide_floats *)node->bound;
    wide_floats in = WIDE_EACH(s->begin), out = WIDE_EACH(INFINITY);
    for (int a = 0; a < 3; a++) {
        const wide_floats enters = (bound[s->near[a]] - s->near_o[a]) * s->inv[a];
        const wide_floats leaves = (bound[s->far[a]] - s->far_o[a]) * s->inv[a];
        in = WIDE_MORE(enters, in);
        out = WIDE_LESS(leaves, out);
    }
    out += (wide_floats)((wide_mask)out & INT32_MAX) * LR_WIDE_OFF;
    *t = in;
    return LR_WIDE_CROSSED(&in, &out, last);
}

/* The next leaf that the ray may meet until `last`, the nearer child of a node first; LR_NOWHERE:
 * there is none. The stack begins as {{begin, 0}} with *n = 1. */
LR_INLINE uint32_t wide_next(const lr_wide_node *nodes, const lr_slabs *s, float last,
                             lr_branch *stack, uint32_t *n, uint64_t *n_nodes)
{
    uint32_t top = *n;
    while (top > 0) {
        const lr_branch branch = stack[--top];
        if (branch.t > last)
            continue;
        uint32_t at = branch.child;
        while ((at & LR_LEAF) == 0) {
            wide_floats t;
            const lr_wide_node *node = &nodes[at];
            uint32_t lanes = wide_enter(node, s, last, &t);
            ++*n_nodes;
            if (lanes == 0)
                break;
            uint32_t first = top, l = (uint32_t)__builtin_ctz(lanes);
            lr_branch nearest = {t[l], node->child[l]};
            for (lanes &= lanes - 1; lanes != 0; lanes &= lanes - 1) {
                l = (uint32_t)__builtin_ctz(lanes);
                lr_branch put = {t[l], node->child[l]};
                if (put.t < nearest.t) {
                    const lr_branch swap = put;
                    put = nearest;
                    nearest = swap;
                }
                uint32_t to = top++;
                for (; to > first && stack[to - 1].t < put.t; to--)
                    stack[to] = stack[to - 1];
                stack[to] = put;
            }
            at = nearest.child;
        }
        if ((at & LR_LEAF) != 0) {
            *n = top;
            return at & ~LR_LEAF;
        }
    }
    *n = 0;
    return LR_NOWHERE;
}
