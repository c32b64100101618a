/* The light of eight cells side by side, each of a ray of its own.
 *
 * A cell's cubic is taken up to the next knot that it passes, or the next extremum, or the cell's
 * end: that part's light is added by the rule of emission_absorption.c, whose formulas these are,
 * and the rest of the cell waits for the next turn. What the rule's bound denies, and the part in
 * which a ray ends at its `stop`, goes to that file.
 *
 * Whoever includes this defines LR_VECTORS, see base/vectors.h.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/visible_lanes_impl.h"

#include "trace/cubic_lanes_impl.h"
#include "trace/emission_absorption.h"
#include "trace/light_rule.h"

enum {
    LR_ALL_LIGHT_LANES = (1 << LR_DOUBLE_LANES) - 1,
    LR_LIGHT_GROUPS = 4, /* of lanes */
    LR_MOST_ROOTS = LR_LIGHT_GROUPS * LR_DOUBLE_LANES
};

LR_INLINE lr_doubles lr_magnitude_lanes(lr_doubles a)
{
    return lr_absolute_doubles(a);
}

LR_INLINE lr_doubles lr_where_lanes(lr_longs m, lr_doubles a, lr_doubles b)
{
    return lr_pick_doubles(m, a, b);
}

#define LR_NUMBER        lr_doubles
#define LR_FORMULA(name) name##_lanes
#include "trace/light_stretch_impl.h"

typedef struct lr_light_lanes {
    /* rays, in storage space; d is 0 along an axis that is not moved along, */
    _Alignas(64) double o[3][LR_DOUBLE_LANES], d[3][LR_DOUBLE_LANES];
    double inv[3][LR_DOUBLE_LANES];   /* and its reciprocal, or 0, with */
    double never[3][LR_DOUBLE_LANES]; /* infinity there, else 0 */
    double graze[3][LR_DOUBLE_LANES]; /* what rounding does at most to t of the planes */
    double t_min[LR_DOUBLE_LANES], t_max[LR_DOUBLE_LANES], speed[LR_DOUBLE_LANES];
    double stop[LR_DOUBLE_LANES], end[LR_DOUBLE_LANES]; /* transmittances at which it ends */
    uint64_t ray[LR_DOUBLE_LANES];
    /* where they stand, and the empty box around that, cells */
    double c[3][LR_DOUBLE_LANES], t[LR_DOUBLE_LANES];
    double low[3][LR_DOUBLE_LANES], high[3][LR_DOUBLE_LANES];
    int32_t place[LR_DOUBLE_LANES], cell[LR_DOUBLE_LANES]; /* of the brick, in it */
    uint64_t rows[LR_CELL_ROWS][LR_DOUBLE_LANES];          /* its samples */
    /* the part of the ray in the cell: the value is sum cubic[i] x^i, x from 0 to 1 on it */
    double t_low[LR_DOUBLE_LANES], t_high[LR_DOUBLE_LANES], cubic[4][LR_DOUBLE_LANES];
    double from_x[LR_DOUBLE_LANES]; /* where what is not added yet begins, */
    double piece[LR_DOUBLE_LANES];  /* and the piece of the transfer function that sees it there, */
    double to_x[LR_DOUBLE_LANES];   /* where its next part ends, and */
    double next[LR_DOUBLE_LANES];   /* what sees what is behind that */
    double loaded[LR_DOUBLE_LANES]; /* the piece of which this is: */
    double from[LR_DOUBLE_LANES], extinction[2][LR_DOUBLE_LANES], turn[LR_DOUBLE_LANES];
    double hue[3][2][LR_DOUBLE_LANES], emission[3][2][LR_DOUBLE_LANES];
    double shines[LR_DOUBLE_LANES], emitted[LR_DOUBLE_LANES];
    /* so far */
    double color[3][LR_DOUBLE_LANES], transmittance[LR_DOUBLE_LANES], begins[LR_DOUBLE_LANES];
    double looked[LR_DOUBLE_LANES]; /* cells */
    uint64_t read, parts;           /* cells and parts of them, of all rays */
    /* a bit for each lane: has a ray; will have none; had one before; */
    uint32_t busy, idle, began;
    uint32_t fresh;   /* has not looked at its cell; */
    uint32_t found;   /* stands on a visible cell that is not added yet, */
    uint32_t unread;  /* whose cubic is not known, */
    uint32_t apart;   /* whose corners lie in several bricks; */
    uint32_t several; /* several pieces see it */
} lr_light_lanes;

/* ---- cells ----------------------------------------------------------------------------- */

LR_INLINE void lr_fetch_rows(lr_light_lanes *k, const lr_volume *v, size_t size)
{
    uint64_t row[LR_CELL_ROWS];
    for (uint32_t left = k->unread & ~k->apart; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        lr_load_rows_of(v, size, (size_t)k->place[l], k->cell[l], row);
        for (int n = 0; n < LR_CELL_ROWS; n++)
            k->rows[n][l] = row[n];
    }
    for (uint32_t left = k->unread & k->apart; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        lr_load_rows(v, size, (size_t)k->place[l], k->cell[l],
                     lr_along(k->cell[l], 0) == LR_SIDE - 1, row);
        for (int n = 0; n < LR_CELL_ROWS; n++)
            k->rows[n][l] = row[n];
    }
}

/* The part of the ray in each cell, by the cell's planes alone. */
LR_INLINE void lr_find_parts(lr_light_lanes *k, lr_longs m, lr_doubles *low, lr_doubles *size)
{
    const lr_doubles zero = {0};
    lr_doubles in = lr_all_doubles(-INFINITY), out = lr_all_doubles(INFINITY);
    lr_doubles graze_in = zero, graze_out = zero;
    for (int a = 0; a < 3; a++) {
        const lr_doubles c = lr_load_doubles(k->c[a]), o = lr_load_doubles(k->o[a]);
        const lr_doubles inv = lr_load_doubles(k->inv[a]), never = lr_load_doubles(k->never[a]);
        const lr_doubles graze = lr_load_doubles(k->graze[a]);
        const lr_doubles first = (c - o) * inv, second = (c + 1.0 - o) * inv;
        const lr_longs down = inv < zero;
        const lr_doubles t = lr_pick_doubles(down, second, first) - never;
        const lr_doubles end = lr_pick_doubles(down, first, second) + never;
        graze_in = lr_pick_doubles(t > in, graze, graze_in);
        graze_out = lr_pick_doubles(end < out, graze, graze_out);
        in = lr_greater_lanes(t, in);
        out = lr_lesser_lanes(end, out);
    }
    *low = lr_greater_lanes(in, lr_load_doubles(k->t_min));
    lr_doubles high = lr_lesser_lanes(out, lr_load_doubles(k->t_max));
    const lr_longs met = (out - in > lr_greater_lanes(graze_in, graze_out)) & (high > *low);
    *size = lr_pick_doubles(met, high - *low, zero);
    lr_store_doubles(k->t_low, lr_pick_doubles(m, *low, lr_load_doubles(k->t_low)));
    high = lr_pick_doubles(met, high, *low);
    lr_store_doubles(k->t_high, lr_pick_doubles(m, high, lr_load_doubles(k->t_high)));
}

/* The trilinear field along the ray, by the field's own coefficients at the part's beginning. */
LR_INLINE void lr_find_cubics(const lr_light_lanes *k, lr_doubles low, lr_doubles size,
                              const lr_doubles s[8], lr_doubles c[4])
{
    const lr_doubles zero = {0}, one = lr_all_doubles(1.0);
    lr_doubles p[3], e[3];
    for (int a = 0; a < 3; a++) {
        const lr_doubles d = lr_load_doubles(k->d[a]);
        p[a] = lr_clamp_doubles(lr_load_doubles(k->o[a]) + low * d - lr_load_doubles(k->c[a]), zero,
                                one);
        e[a] = size * d;
    }
    const lr_doubles x = s[1] - s[0], y = s[2] - s[0], z = s[4] - s[0];
    const lr_doubles xy = s[3] - s[2] - x, xz = s[5] - s[4] - x, yz = s[6] - s[4] - y;
    const lr_doubles xyz = s[7] - s[6] - (s[5] - s[4]) - xy;
    const lr_doubles ax = x + xy * p[1] + (xz + xyz * p[1]) * p[2];
    const lr_doubles ay = y + xy * p[0] + (yz + xyz * p[0]) * p[2];
    const lr_doubles az = z + xz * p[0] + (yz + xyz * p[0]) * p[1];
    const lr_doubles exy = e[0] * e[1];
    c[0] = s[0] + x * p[0] + (y + xy * p[0]) * p[1] + az * p[2];
    c[1] = ax * e[0] + ay * e[1] + az * e[2];
    c[2] = (xy + xyz * p[2]) * exy + ((xz + xyz * p[1]) * e[0] + (yz + xyz * p[0]) * e[1]) * e[2];
    c[3] = xyz * exy * e[2];
}

/* Bounds of the cubics: by their Bernstein coefficients, and by the corners, beyond which rounding
 * must not take them, as what is not between these was not asked for whether it is visible. */
LR_INLINE void lr_find_bounds(const lr_doubles s[8], const lr_doubles c[4], lr_doubles *least,
                              lr_doubles *greatest)
{
    lr_doubles low = s[0], high = s[0];
    for (int b = 1; b < 8; b++) {
        low = lr_lesser_lanes(low, s[b]);
        high = lr_greater_lanes(high, s[b]);
    }
    const lr_doubles b1 = c[0] + c[1] * (1.0 / 3.0), b2 = b1 + (c[1] + c[2]) * (1.0 / 3.0);
    const lr_doubles b3 = c[0] + c[1] + c[2] + c[3];
    *least = lr_lesser_lanes(lr_lesser_lanes(c[0], b1), lr_lesser_lanes(b2, b3));
    *greatest = lr_greater_lanes(lr_greater_lanes(c[0], b1), lr_greater_lanes(b2, b3));
    *least = lr_clamp_doubles(*least, low, high);
    *greatest = lr_clamp_doubles(*greatest, low, high);
}

/* The ends of the monotone parts of the cubics of m that begin at a. */
LR_INLINE lr_doubles lr_monotone_end(const lr_doubles c[4], lr_doubles a, lr_longs m)
{
    lr_doubles x[2], end = lr_all_doubles(1.0);
    const lr_doubles zero = {0}, d1 = c[1] + c[2], d2 = d1 + c[2] + 3.0 * c[3];
    const lr_longs rises = (c[1] > zero) & (d1 > zero) & (d2 > zero); /* the slope's Bernstein */
    const lr_longs falls = (c[1] < zero) & (d1 < zero) & (d2 < zero); /* coefficients */
    const lr_longs turns = ~(rises | falls);
    if (!lr_any(m & turns))
        return end;
    lr_cubic_extrema_lanes(c, x);
    for (int i = 0; i < 2; i++)
        end = lr_pick_doubles(turns & (x[i] > a) & (x[i] < end), x[i], end);
    return end;
}

LR_INLINE lr_doubles lr_numbers_of_pieces(const lr_transfer *f, lr_doubles value)
{
    return lr_doubles_of_unsigned((lr_unsigned_longs)lr_pieces_of_lanes(f, value));
}

/* Which piece sees the beginning of each cubic, and do several see it? */
LR_INLINE void lr_find_pieces(lr_light_lanes *k, const lr_transfer *f, lr_longs m,
                              const lr_doubles s[8], const lr_doubles c[4])
{
    lr_doubles least, greatest;
    lr_find_bounds(s, c, &least, &greatest);
    const lr_doubles first = lr_numbers_of_pieces(f, least),
                     last = lr_numbers_of_pieces(f, greatest);
    const uint32_t several = lr_bits_of_longs(m & (first != last));
    lr_doubles piece = first;
    if (several != 0)
        piece = lr_clamp_doubles(lr_numbers_of_pieces(f, c[0]), first, last);
    k->several = (k->several & ~k->unread) | several;
    lr_store_doubles(k->piece, lr_pick_doubles(m, piece, lr_load_doubles(k->piece)));
}

/* Read the cells that lanes have found. */
LR_INLINE void lr_read_cells(lr_light_lanes *k, const lr_volume *v, int32_t type)
{
    if (k->unread == 0)
        return;
    const lr_longs m = lr_longs_of(k->unread);
    const lr_doubles zero = {0};
    lr_unsigned_longs row[LR_CELL_ROWS];
    lr_doubles s[8], c[4], low, length;
    memcpy(row, k->rows, sizeof row);
    lr_unpack_rows(row, type, s);
    lr_find_parts(k, m, &low, &length);
    lr_find_cubics(k, low, length, s, c);
    lr_find_pieces(k, v->transfer, m, s, c);
    for (int i = 0; i < 4; i++)
        lr_store_doubles(k->cubic[i], lr_pick_doubles(m, c[i], lr_load_doubles(k->cubic[i])));
    lr_store_doubles(k->from_x, lr_pick_doubles(m, zero, lr_load_doubles(k->from_x)));
    k->read += (uint64_t)__builtin_popcount(k->unread);
    k->unread = 0;
}

/* ---- parts of them --------------------------------------------------------------------- */

/* Lines of the pieces that see what is next. */
LR_INLINE void lr_load_pieces(lr_light_lanes *k, const lr_transfer *f)
{
    const lr_longs other = lr_load_doubles(k->piece) != lr_load_doubles(k->loaded);
    for (uint32_t left = lr_bits_of_longs(other) & k->found; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        const lr_transfer_piece *p = &f->pieces[(int32_t)k->piece[l]];
        k->loaded[l] = k->piece[l];
        k->from[l] = p->from;
        k->turn[l] = p->turn;
        k->shines[l] = p->emits ? p->shines : 0.0;
        k->emitted[l] = p->emits ? p->emitted : 0.0;
        for (int i = 0; i < 2; i++) {
            k->extinction[i][l] = p->extinction[i];
            for (int a = 0; a < 3; a++)
                k->hue[a][i][l] = p->color[a][i];
            for (int a = 0; a < 3 && f->emits; a++)
                k->emission[a][i][l] = p->emission[a][i];
        }
    }
}

/* Knots that cubics pass, of all lanes: where, is found for eight at a time. */
typedef struct lr_light_roots {
    _Alignas(64) double c[4][LR_MOST_ROOTS], level[LR_MOST_ROOTS];
    double a[LR_MOST_ROOTS], b[LR_MOST_ROOTS], down[LR_MOST_ROOTS];
    double *to[LR_MOST_ROOTS];
    int n;
} lr_light_roots;

static void lr_note_root(lr_light_lanes *k, int l, double level, bool up, lr_light_roots *roots)
{
    const int n = roots->n++;
    for (int i = 0; i < 4; i++)
        roots->c[i][n] = k->cubic[i][l];
    roots->level[n] = level;
    roots->a[n] = k->from_x[l];
    roots->b[n] = k->to_x[l];
    roots->down[n] = up ? 0.0 : 1.0;
    roots->to[n] = &k->to_x[l];
}

LR_INLINE void lr_find_roots(lr_light_roots *roots)
{
    const lr_doubles zero = {0};
    const int n = roots->n;
    for (int l = n; l % LR_DOUBLE_LANES != 0; l++) /* those that fill up are found at once */
        roots->a[l] = roots->b[l] = 0.0;
    for (int first = 0; first < n; first += LR_DOUBLE_LANES) {
        lr_doubles c[4], x;
        uint64_t n_samples = 0;
        for (int i = 0; i < 4; i++)
            c[i] = lr_load_doubles(roots->c[i] + first);
        const lr_bracket_lanes bracket = {
            lr_load_doubles(roots->a + first), lr_load_doubles(roots->b + first),
            lr_load_doubles(roots->down + first) != zero, zero == zero};
        x = lr_newton_lanes(c, lr_load_doubles(roots->level + first), bracket, &n_samples);
        for (int l = 0; l < LR_DOUBLE_LANES && first + l < n; l++)
            *roots->to[first + l] = x[l];
    }
    roots->n = 0;
}

/* The ends of the parts that one piece sees, and which piece sees what is behind them; of knots
 * that are passed the place is left to lr_find_roots. */
LR_INLINE void lr_find_ends(lr_light_lanes *k, const lr_transfer *f, lr_light_roots *roots)
{
    lr_store_doubles(k->to_x, lr_all_doubles(1.0));
    lr_store_doubles(k->next, lr_load_doubles(k->piece));
    const uint32_t several = k->several & k->found;
    if (several == 0)
        return;
    lr_doubles c[4];
    for (int i = 0; i < 4; i++)
        c[i] = lr_load_doubles(k->cubic[i]);
    const lr_longs m = lr_longs_of(several);
    const lr_doubles a = lr_load_doubles(k->from_x), end = lr_monotone_end(c, a, m);
    const lr_doubles fa = lr_cubic_lanes(c, a), fb = lr_cubic_lanes(c, end);
    const uint32_t rising = lr_bits_of_longs(fb > fa);
    lr_store_doubles(k->to_x, lr_pick_doubles(m, end, lr_all_doubles(1.0)));
    for (uint32_t left = several; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        const uint64_t piece = (uint64_t)k->piece[l];
        const bool up = (rising >> l & 1) != 0;
        if (up ? piece == f->n || f->values[piece] >= fb[l]
               : piece == 0 || f->values[piece - 1] <= fb[l])
            continue;
        lr_note_root(k, l, f->values[up ? piece : piece - 1], up, roots);
        k->next[l] = k->piece[l] + (up ? 1.0 : -1.0);
    }
}

/* Are the rule's errors within the parts' share? As lr_light_sum_within. */
LR_INLINE lr_longs lr_lanes_within(const lr_light_lanes *k, const lr_stretch_lanes *s, bool emits,
                                   double tolerance)
{
    const lr_doubles turn = lr_load_doubles(k->turn), zero = {0};
    lr_doubles error[3];
    lr_stretch_bound_lanes(s, 4.0, error);
    lr_longs within =
        (turn == zero) | (turn * error[0] <= 0.6 * tolerance * s->depth + LR_LOST_LIGHT);
    if (emits) {
        const lr_doubles emitted = lr_load_doubles(k->emitted);
        const lr_doubles shines =
            lr_load_doubles(k->shines) + emitted * lr_absolute_doubles(s->middle);
        within &=
            (shines == zero) | (shines * error[1] + emitted * error[2] <= tolerance * s->half);
    }
    return within;
}

/* What the parts of m add, but for those that the rule does not suffice for: these are left. */
LR_INLINE uint32_t lr_add_light(lr_light_lanes *k, const lr_transfer *f, const lr_stretch_lanes *s,
                                double tolerance, lr_longs m)
{
    const lr_doubles zero = {0}, left = lr_load_doubles(k->transmittance);
    const lr_doubles after = lr_lane_exp_lanes(-s->depth), opacity = 1.0 - after;
    lr_doubles sums[3] = {zero, zero, zero};
    if (f->emits || lr_any(m & (lr_load_doubles(k->turn) != zero))) {
        m &= lr_lanes_within(k, s, f->emits, tolerance);
        lr_stretch_integrate_lanes(s, sums);
    }
    for (int a = 0; a < 3; a++) {
        const lr_doubles rise = lr_load_doubles(k->hue[a][1]);
        lr_doubles light = (lr_load_doubles(k->hue[a][0]) + rise * s->middle) * opacity;
        light += rise * sums[0];
        if (f->emits) {
            const lr_doubles grows = lr_load_doubles(k->emission[a][1]);
            light += (lr_load_doubles(k->emission[a][0]) + grows * s->middle) * sums[1];
            light += grows * sums[2];
        }
        const lr_doubles color = lr_load_doubles(k->color[a]);
        lr_store_doubles(k->color[a], lr_pick_doubles(m, color + left * light, color));
    }
    lr_store_doubles(k->transmittance, lr_pick_doubles(m, left * after, left));
    return lr_bits_of_longs(m);
}

/* Of rays that end at a transmittance, without colours; those parts are left in which they do. */
LR_INLINE uint32_t lr_let_through(lr_light_lanes *k, const lr_stretch_lanes *s, lr_longs m)
{
    const lr_doubles left = lr_load_doubles(k->transmittance);
    const lr_doubles after = left * lr_lane_exp_lanes(-s->depth);
    m &= after > lr_load_doubles(k->stop);
    lr_store_doubles(k->transmittance, lr_pick_doubles(m, after, left));
    return lr_bits_of_longs(m);
}

/* The part of one lane from a to b, alone. */
static void lr_add_alone(lr_light_lanes *k, int l, const lr_transfer *f, double tolerance, double a,
                         double b)
{
    const double size = k->t_high[l] - k->t_low[l];
    const double c[4] = {k->cubic[0][l], k->cubic[1][l], k->cubic[2][l], k->cubic[3][l]};
    lr_light_sum sum = {.tolerance = tolerance,
                        .color = {k->color[0][l], k->color[1][l], k->color[2][l]},
                        .transmittance = k->transmittance[l],
                        .stop = k->stop[l]};
    lr_add_piece(&sum, &f->pieces[(int32_t)k->piece[l]], c, NULL, a, b, size * k->speed[l]);
    for (int i = 0; i < 3; i++)
        k->color[i][l] = sum.ended ? sum.albedo[i] : sum.color[i];
    k->transmittance[l] = sum.transmittance;
    if (sum.ended)
        k->begins[l] = lr_mix(k->t_low[l], k->t_high[l], sum.at);
}

/* Note where lanes begin to see something. */
LR_INLINE void lr_note_beginnings(lr_light_lanes *k, lr_longs m)
{
    const lr_doubles begins = lr_load_doubles(k->begins);
    const lr_doubles light =
        lr_load_doubles(k->color[0]) + lr_load_doubles(k->color[1]) + lr_load_doubles(k->color[2]);
    const lr_longs sees =
        m & (begins == INFINITY) & ((lr_load_doubles(k->transmittance) < 1.0) | (light > 0.0));
    lr_store_doubles(k->begins, lr_pick_doubles(sees, lr_load_doubles(k->t_low), begins));
}

/* Add the next part of each cell that was found. stops: rays end at their `stop`. */
LR_INLINE void lr_add_parts(lr_light_lanes *k, const lr_transfer *f, double tolerance, bool stops)
{
    const lr_longs m = lr_longs_of(k->found);
    const lr_doubles a = lr_load_doubles(k->from_x), b = lr_load_doubles(k->to_x);
    lr_doubles c[4];
    for (int i = 0; i < 4; i++)
        c[i] = lr_load_doubles(k->cubic[i]);
    lr_load_pieces(k, f);
    const lr_doubles extinction[2] = {lr_load_doubles(k->extinction[0]),
                                      lr_load_doubles(k->extinction[1])};
    const lr_doubles length =
        (lr_load_doubles(k->t_high) - lr_load_doubles(k->t_low)) * lr_load_doubles(k->speed);
    lr_stretch_lanes s;
    lr_stretch_of_lanes(&s, c, a, b, length, lr_load_doubles(k->from), extinction);
    const uint32_t added = stops ? lr_let_through(k, &s, m) : lr_add_light(k, f, &s, tolerance, m);
    for (uint32_t left = k->found & ~added; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        lr_add_alone(k, l, f, tolerance, a[l], b[l]);
    }
    if (!stops)
        lr_note_beginnings(k, m);
    const lr_longs ended = m & (lr_load_doubles(k->transmittance) <= lr_load_doubles(k->end));
    const uint32_t done = lr_bits_of_longs(m & (b >= 1.0)) | lr_bits_of_longs(ended);
    lr_store_doubles(k->from_x, b);
    lr_store_doubles(k->piece, lr_load_doubles(k->next));
    k->parts += (uint64_t)__builtin_popcount(k->found);
    k->busy &= ~lr_bits_of_longs(ended);
    k->found &= ~done;
}
