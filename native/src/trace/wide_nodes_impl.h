/* A ray through a tree of wide nodes. Included after vectors.h, by files compiled for their
 * instructions.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/wide_nodes.h"

/* The children whose boxes the ray enters, as bits, no later than `last`; *t: where. NaN narrows
 * nothing. */
LR_INLINE uint32_t wide_enter(const lr_wide_node *node, const lr_slabs *s, float last,
                              lr_eight_floats *t)
{
    const float (*bound)[LR_TREE_LANES] = node->bound[0];
    lr_eight_floats in = s->begin - (lr_eight_floats){0}, out = INFINITY - (lr_eight_floats){0};
    for (int a = 0; a < 3; a++) {
        const lr_eight_floats enters =
            (lr_load_eight_floats(bound[s->near[a]]) - s->near_o[a]) * s->inv[a];
        const lr_eight_floats leaves =
            (lr_load_eight_floats(bound[s->far[a]]) - s->far_o[a]) * s->inv[a];
        in = lr_pick_eight_floats(enters > in, enters, in);
        out = lr_pick_eight_floats(leaves < out, leaves, out);
    }
    out += (lr_eight_floats)((lr_eight_ints)out & INT32_MAX) * LR_WIDE_OFF;
    *t = in;
    return lr_bits_of_eight((in <= out) & (in <= last));
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
            lr_eight_floats t;
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
