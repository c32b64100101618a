/* Eight cubics side by side: the arithmetic of trilinear.h, cell.h and cubic_root.h, operation by
 * operation, so that results are theirs to the last bit.
 *
 * Whoever includes this has included base/vectors.h with the instruction set of its choice.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/cubic_root.h"

#define LR_NUMBER        lr_doubles
#define LR_FORMULA(name) name##_lanes
#include "grid/trilinear_impl.h"

/* As lr_cubic_extrema; NaN where there is none. */
LR_INLINE void lr_cubic_extrema_lanes(const lr_doubles c[4], lr_doubles x[2])
{
    const lr_doubles none = lr_all_doubles(NAN);
    const lr_doubles a = 3.0 * c[3], b = 2.0 * c[2], square = b * b - 4.0 * a * c[1];
    const lr_longs real = square >= 0.0;
    const lr_doubles q = -0.5 * (b + lr_signed_as(lr_root_doubles(square), b));
    const lr_doubles first = q / a, second = c[1] / q;
    const lr_longs swapped = first > second;
    x[0] = lr_pick_doubles(swapped, second, first);
    x[1] = lr_pick_doubles(swapped, first, second);
    for (int i = 0; i < 2; i++)
        x[i] = lr_pick_doubles(real & (x[i] > 0.0) & (x[i] < 1.0), x[i], none);
}

typedef struct lr_bracket_lanes {
    lr_doubles a, b;
    lr_longs above, found;
} lr_bracket_lanes;

/* As lr_root_newton. */
LR_INLINE lr_doubles lr_newton_lanes(const lr_doubles c[4], lr_doubles level, lr_bracket_lanes k,
                                     uint64_t *n_samples)
{
    const lr_doubles zero = {0};
    const lr_doubles fa = lr_cubic_lanes(c, k.a) - level, fb = lr_cubic_lanes(c, k.b) - level;
    const lr_longs a_holds = ~((fa >= zero) ^ k.above), b_holds = (fb >= zero) ^ k.above;
    lr_doubles root = lr_pick_doubles(a_holds, k.b, k.a);
    lr_longs on = k.found & a_holds & b_holds;
    const lr_longs sought = on;
    lr_longs ended = ~sought; /* root is known */
    lr_doubles x = k.a + (k.b - k.a) * fa / (fa - fb);
    *n_samples += 2 * (uint64_t)__builtin_popcount(lr_bits_of_longs(k.found));
    for (int step = 0; step < 60; step++) {
        on = on & (k.b - k.a > LR_ROOT_ENOUGH) & ~ended;
        const uint32_t left = lr_bits_of_longs(on);
        if (left == 0)
            break;
        *n_samples += (uint64_t)__builtin_popcount(left);
        x = lr_pick_doubles((x > k.a) & (x < k.b), x, 0.5 * (k.a + k.b));
        const lr_doubles fx = lr_cubic_lanes(c, x) - level;
        const lr_longs before = ~((fx >= zero) ^ k.above);
        k.a = lr_pick_doubles(on & before, x, k.a);
        k.b = lr_pick_doubles(on & ~before, x, k.b);
        const lr_doubles next = x - fx / lr_cubic_slope_lanes(c, x);
        const lr_longs close = on & (lr_absolute_doubles(next - x) <= LR_ROOT_ENOUGH);
        root = lr_pick_doubles(close, lr_clamp_doubles(next, k.a, k.b), root);
        ended |= close;
        x = next;
    }
    return lr_pick_doubles(~ended, 0.5 * (k.a + k.b), root);
}
