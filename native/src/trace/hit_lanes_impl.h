/* The hit test of eight cells of a trilinear field side by side, and the normals where it hits: the
 * arithmetic of cell.h and hit_normal.h, operation by operation, so that results are theirs to the
 * last bit. Roots are those of Newton's method.
 *
 * Whoever includes this has included base/vectors.h with the instruction set of its choice.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/hit_record.h"
#include "trace/cell.h"
#include "trace/cubic_lanes_impl.h"

/* Rays that stand on cells, and what is found of them. */
typedef struct lr_hit_lanes {
    _Alignas(64) double o[3][LR_DOUBLE_LANES], d[3][LR_DOUBLE_LANES]; /* storage space */
    double inv[3][LR_DOUBLE_LANES]; /* 0 where the axis is not moved along */
    double c[3][LR_DOUBLE_LANES];   /* cell */
    double axis[LR_DOUBLE_LANES];   /* by which it was entered; -1: the ray started in it */
    double side[LR_DOUBLE_LANES];   /* as of lr_hit_corners */
    double t_in[LR_DOUBLE_LANES], t_max[LR_DOUBLE_LANES];
    double corner[8][LR_DOUBLE_LANES];
    double t[LR_DOUBLE_LANES], p[3][LR_DOUBLE_LANES]; /* of hits */
    double own[3][LR_DOUBLE_LANES], shading[3][LR_DOUBLE_LANES];
    double around[64][LR_DOUBLE_LANES]; /* the samples that central differences take */
} lr_hit_lanes;

LR_INLINE void lr_hit_lane_put(lr_hit_lanes *k, int l, const lr_volume *v, const double o[3],
                               const double d[3], const double inv[3], double t_max,
                               const lr_cursor *u, int32_t side)
{
    double corner[8];
    lr_corners(v, u->c, corner);
    for (int b = 0; b < 8; b++)
        k->corner[b][l] = corner[b];
    for (int a = 0; a < 3; a++) {
        k->o[a][l] = o[a];
        k->d[a][l] = d[a];
        k->inv[a][l] = inv[a];
        k->c[a][l] = u->c[a];
    }
    k->axis[l] = u->axis;
    k->side[l] = side;
    k->t_in[l] = u->t;
    k->t_max[l] = t_max;
}

typedef struct lr_chord_lanes {
    lr_doubles s[8], in[3], out[3], t_in, t_out, f_in, f_out, c[4];
} lr_chord_lanes;

/* b on the upper face. */
LR_INLINE lr_doubles lr_mix_to(lr_doubles a, lr_doubles b, lr_doubles u, lr_longs upper)
{
    return lr_pick_doubles(upper, b, lr_mix_lanes(a, b, u));
}

/* As lr_face_value where p is on a face: on a lower one p is 0 there, and nothing is mixed. */
LR_INLINE lr_doubles lr_face_lanes(const lr_doubles s[8], const lr_doubles p[3],
                                   const lr_longs upper[3])
{
    lr_doubles x[4], y[2];
    for (int n = 0; n < 4; n++)
        x[n] = lr_mix_to(s[2 * n], s[2 * n + 1], p[0], upper[0]);
    for (int n = 0; n < 2; n++)
        y[n] = lr_mix_to(x[2 * n], x[2 * n + 1], p[1], upper[1]);
    return lr_mix_to(y[0], y[1], p[2], upper[2]);
}

/* As lr_chord_points and lr_chord_values. */
LR_INLINE void lr_chord_of_lanes(const lr_hit_lanes *k, lr_chord_lanes *h)
{
    const lr_doubles zero = {0}, one = lr_all_doubles(1.0), axis = lr_load_doubles(k->axis);
    lr_doubles t[3], low[3];
    lr_longs up[3], upper[3], upper_out[3];
    for (int b = 0; b < 8; b++)
        h->s[b] = lr_load_doubles(k->corner[b]);
    for (int a = 0; a < 3; a++) {
        const lr_doubles inv = lr_load_doubles(k->inv[a]);
        up[a] = inv > zero;
        low[a] = lr_load_doubles(k->c[a]);
        t[a] = (lr_pick_doubles(up[a], low[a] + 1.0, low[a]) - lr_load_doubles(k->o[a])) * inv;
        t[a] = lr_pick_doubles(inv == zero, lr_all_doubles(INFINITY), t[a]);
    }
    const lr_longs y = t[1] < t[0];
    const lr_doubles first = lr_pick_doubles(y, t[1], t[0]);
    const lr_longs z = t[2] < first;
    const lr_longs crossed[3] = {~y & ~z, y & ~z, z};
    h->t_in = lr_load_doubles(k->t_in);
    h->t_out = lr_pick_doubles(z, t[2], first);
    h->t_out = lr_pick_doubles(h->t_out > h->t_in, h->t_out, h->t_in);
    for (int a = 0; a < 3; a++) {
        const lr_doubles o = lr_load_doubles(k->o[a]), d = lr_load_doubles(k->d[a]);
        const lr_longs still = lr_load_doubles(k->inv[a]) == zero, entered = axis == (double)a;
        const lr_doubles in = lr_pick_doubles(still, o - low[a], o + h->t_in * d - low[a]);
        const lr_doubles out = lr_pick_doubles(still, o - low[a], o + h->t_out * d - low[a]);
        h->in[a] = lr_pick_doubles(entered, lr_pick_doubles(up[a], zero, one),
                                   lr_clamp_doubles(in, zero, one));
        h->out[a] = lr_pick_doubles(crossed[a], lr_pick_doubles(up[a], one, zero),
                                    lr_clamp_doubles(out, zero, one));
        upper[a] = entered & ~up[a];
        upper_out[a] = crossed[a] & up[a];
    }
    h->f_in = lr_face_lanes(h->s, h->in, upper);
    h->f_out = lr_face_lanes(h->s, h->out, upper_out);
}

/* As lr_cubic_stays. */
LR_INLINE lr_longs lr_cubic_stays_lanes(const lr_doubles c[4], double level, lr_longs above)
{
    const lr_doubles slack =
        LR_CUBIC_SLACK * (lr_absolute_doubles(c[0]) + lr_absolute_doubles(c[1]) +
                          lr_absolute_doubles(c[2]) + lr_absolute_doubles(c[3]));
    const lr_doubles sign = lr_pick_doubles(above, lr_all_doubles(1.0), lr_all_doubles(-1.0));
    const lr_doubles b0 = sign * (c[0] - level), d0 = sign * c[1], d1 = d0 + sign * c[2];
    const lr_doubles b1 = b0 + d0 * (1.0 / 3.0), b2 = b1 + d1 * (1.0 / 3.0);
    const lr_doubles d2 = d1 + sign * (c[2] + 3.0 * c[3]), b3 = b2 + d2 * (1.0 / 3.0);
    return ((d0 > slack) & (d1 > slack) & (d2 > slack)) |
           ((b0 > slack) & (b1 > slack) & (b2 > slack) & (b3 > slack));
}

/* The first interval with a change of sides, of the lanes of m. */
LR_INLINE void lr_bracket_of_lanes(const lr_chord_lanes *h, double level, bool extrema,
                                   lr_doubles side, lr_longs m, lr_bracket_lanes *k,
                                   uint64_t *n_samples)
{
    const lr_doubles zero = {0};
    const lr_longs given = side != zero;
    k->above = (given & (side > zero)) | (~given & (h->f_in >= level));
    const lr_longs change = (h->f_out >= level) ^ k->above;
    const lr_longs searched = extrema ? m : m & given;
    lr_longs open = searched & (change | ~lr_cubic_stays_lanes(h->c, level, k->above));
    k->found = change & m;
    k->a = zero;
    k->b = lr_all_doubles(1.0);
    if (!lr_any(open))
        return;
    lr_doubles x[2];
    lr_cubic_extrema_lanes(h->c, x);
    for (int i = 0; i < 2; i++) {
        const lr_longs there = open & (x[i] > zero);
        const lr_longs other = (lr_cubic_lanes(h->c, x[i]) >= level) ^ k->above;
        *n_samples += (uint64_t)__builtin_popcount(lr_bits_of_longs(there));
        k->b = lr_pick_doubles(there & other, x[i], k->b);
        k->a = lr_pick_doubles(there & ~other, x[i], k->a);
        k->found |= there & other;
        open &= ~(there & other);
    }
}

/* Which of the lanes hit: a bit each; t and p of these. */
static uint32_t lr_find_hits(lr_hit_lanes *k, const lr_volume *v, uint32_t lanes,
                             const lr_trace_options *options, uint64_t *n_samples)
{
    lr_chord_lanes h;
    lr_bracket_lanes b;
    const lr_longs m = lr_longs_of(lanes);
    lr_chord_of_lanes(k, &h);
    lr_cubic_between_lanes(h.s, h.in, h.out, h.f_in, h.c);
    lr_bracket_of_lanes(&h, v->threshold, options->hit_test == LR_HIT_EXTREMA,
                        lr_load_doubles(k->side), m, &b, n_samples);
    *n_samples += 2 * (uint64_t)__builtin_popcount(lanes);
    if (!lr_any(b.found))
        return 0;
    const lr_doubles at = lr_newton_lanes(h.c, lr_all_doubles(v->threshold), b, n_samples);
    const lr_doubles t = h.t_in + at * (h.t_out - h.t_in);
    lr_store_doubles(k->t, t);
    for (int a = 0; a < 3; a++)
        lr_store_doubles(k->p[a], h.in[a] + at * (h.out[a] - h.in[a]));
    return lr_bits_of_longs(b.found & (t <= lr_load_doubles(k->t_max)));
}

/* ---- normals ----------------------------------------------------------------- */

/* As lr_outward: of which lanes there is one, a bit each. */
LR_INLINE uint32_t lr_outward_lanes(const lr_volume *v, const lr_doubles g[3],
                                    double normal[3][LR_DOUBLE_LANES])
{
    const double *m = v->storage_from_object;
    lr_doubles n[3];
    for (int i = 0; i < 3; i++)
        n[i] = m[i] * g[0] + m[4 + i] * g[1] + m[8 + i] * g[2];
    const lr_doubles length = lr_root_doubles(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int i = 0; i < 3; i++)
        lr_store_doubles(normal[i], n[i] / -length);
    return lr_bits_of_longs((length > 0.0) & (length < INFINITY));
}

/* As lr_field_normal. */
LR_INLINE uint32_t lr_find_own_normals(lr_hit_lanes *k, const lr_volume *v)
{
    lr_doubles s[8], p[3], g[3];
    for (int b = 0; b < 8; b++)
        s[b] = lr_load_doubles(k->corner[b]);
    for (int a = 0; a < 3; a++)
        p[a] = lr_load_doubles(k->p[a]);
    lr_trilinear_gradient_lanes(s, p, g);
    return lr_outward_lanes(v, g, k->own);
}

/* Those by central differences. */
LR_INLINE uint32_t lr_find_central_normals(lr_hit_lanes *k, const lr_volume *v)
{
    const int stride[3] = {1, 4, 16};
    lr_doubles p[3], g[3];
    for (int a = 0; a < 3; a++)
        p[a] = lr_load_doubles(k->p[a]);
    for (int a = 0; a < 3; a++) {
        lr_doubles corner[8];
        for (int n = 0; n < 8; n++) {
            const int at = 21 + (n & 1) + 4 * (n >> 1 & 1) + 16 * (n >> 2);
            corner[n] = 0.5 * (lr_load_doubles(k->around[at + stride[a]]) -
                               lr_load_doubles(k->around[at - stride[a]]));
        }
        g[a] = lr_trilinear_lanes(corner, p);
    }
    return lr_outward_lanes(v, g, k->shading);
}

/* Write the hits of lanes, which are rays i[]; as lr_put_surface. */
static void lr_put_hits(lr_hit_lanes *k, const lr_volume *v, uint32_t lanes,
                        const lr_trace_options *options, const lr_rays *rays,
                        const uint64_t i[LR_DOUBLE_LANES], const lr_hits *hits)
{
    const bool normals = hits->nx != NULL || hits->gx != NULL;
    const bool central = hits->nx != NULL && options->normal == LR_NORMAL_CENTRAL &&
                         v->faces == NULL && !v->flat && v->triangle_cells == NULL;
    const bool others = hits->nx != NULL && options->normal != LR_NORMAL_ANALYTIC && !central;
    const uint32_t own = normals ? lr_find_own_normals(k, v) : 0;
    uint32_t shading = 0;
    if (central) {
        for (uint32_t left = lanes; left != 0; left &= left - 1) {
            const int l = __builtin_ctz(left);
            const int32_t c[3] = {(int32_t)k->c[0][l], (int32_t)k->c[1][l], (int32_t)k->c[2][l]};
            lr_cross_around(v, c, &k->around[0][l], LR_DOUBLE_LANES);
        }
        shading = lr_find_central_normals(k, v);
    }
    for (uint32_t left = lanes; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        const uint64_t n = i[l];
        const int32_t c[3] = {(int32_t)k->c[0][l], (int32_t)k->c[1][l], (int32_t)k->c[2][l]};
        const double p[3] = {k->p[0][l], k->p[1][l], k->p[2][l]};
        int32_t id = 0;
        hits->t[n] = k->t[l];
        lr_put_cell(hits, n, c);
        if (v->ids != NULL && (hits->id != NULL || others)) {
            double corner[8];
            for (int b = 0; b < 8; b++)
                corner[b] = k->corner[b][l];
            id = lr_nearest_id(v, c, corner, p);
        }
        if (hits->id != NULL)
            hits->id[n] = id;
        if (!normals)
            continue;
        double g[3] = {k->own[0][l], k->own[1][l], k->own[2][l]};
        if (!(own >> l & 1))
            lr_towards_origin((double[3]){rays->dx[n], rays->dy[n], rays->dz[n]}, g);
        lr_put_triple(hits->gx, hits->gy, hits->gz, n, g);
        if (others) {
            double s[3];
            lr_field_shading_normal(v, LR_NO_OBJECT, id, c, p, options->normal, g, s);
            memcpy(g, s, sizeof g);
        }
        for (int a = 0; a < 3 && shading >> l & 1; a++)
            g[a] = k->shading[a][l];
        lr_put_triple(hits->nx, hits->ny, hits->nz, n, g);
    }
}
