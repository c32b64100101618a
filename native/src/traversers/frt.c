/* One cell at a time, by comparing the distances to the next plane of each axis.
 *
 * Symmetric in the axes: the ray steps along the axis of the least of the three distances,
 * which grows by the constant spacing of its planes. With integers the distances
 * are not kept but their pairwise differences, cleared of the denominators:
 * e_ij = x_i |D_j| - x_j |D_i|, where x_i is how far the next plane of axis i is along
 * that axis. A step along i adds unit |D_j| to every e_ij; nothing is ever rounded, so
 * the walk is exact however long it is. With floats the sums drift.
 *
 * Source: Cleary and Wyvill 1988. Departures: 1. differences in place of distances; 2. t
 * is recomputed where a plane is crossed. Precision of integers: the ray is first
 * rounded to multiples of 2^-62 of the largest component of its direction (a
 * component below that counts as 0) and its origin to 2^(m-61) voxels, where 2^m is
 * larger than the origin's coordinates and the volume: to 2^-51 for 1024. All of a
 * double's 53 bits are kept where a component is at least 2^-9 of the largest.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/traverser.h"

__extension__ typedef __int128 big;

enum { INTEGER = 0, FLOAT = 1 };

lr_status lr_frt_build(const lr_volume *volume, const int32_t *choices, const lr_watch *watch,
                       void **data, uint64_t *nbytes, lr_error *error)
{
    (void)volume, (void)watch;
    return lr_build_choices(choices, 1, data, nbytes, error);
}

void lr_frt_free(void *data)
{
    free(data);
}

typedef struct differences {
    big xy, xz, yz;          /* e_ij */
    big grow[3];             /* unit |D| */
    float next[3], delta[3]; /* voxels along the ray, from where the walk began */
    double start, per_voxel; /* t there, and what a voxel along the ray is of it */
} differences;

/* x |D_j| - y |D_i|; an axis that is not moved along is infinitely far away. */
LR_INLINE big difference(int64_t x, int64_t d_i, int64_t y, int64_t d_j)
{
    const big never = (big)1 << 126;
    if (d_i == 0 || d_j == 0)
        return d_j != 0 ? never : d_i != 0 ? -never : 0;
    return (big)x * d_j - (big)y * d_i;
}

typedef struct quantised {
    int64_t d[3]; /* |D| */
    int64_t o[3]; /* in units */
    int64_t unit; /* of a voxel */
} quantised;

LR_INLINE void quantise(const lr_ray *r, quantised *q)
{
    double d = 0.0, o = 1.0;
    int d_exponent, m;
    for (int a = 0; a < 3; a++) {
        d = fmax(d, fabs(r->d[a]));
        o = fmax(o, fmax(fabs(r->o[a]), r->hi[a] + 1.0));
    }
    frexp(d, &d_exponent);
    frexp(o, &m);
    for (int a = 0; a < 3; a++) {
        q->d[a] = r->s[a] != 0 ? (int64_t)rint(ldexp(fabs(r->d[a]), 62 - d_exponent)) : 0;
        q->o[a] = (int64_t)rint(ldexp(r->o[a], 61 - m));
    }
    q->unit = m <= 61 ? (int64_t)1 << (61 - m) : 0; /* 0: too far away to resolve planes */
}

/* How far the next plane of the cell is along its axis, in units. */
LR_INLINE int64_t ahead(const lr_ray *r, const quantised *q, int a, int32_t c)
{
    const int64_t plane = (int64_t)(c + (r->s[a] > 0)) * q->unit;
    return r->s[a] > 0 ? plane - q->o[a] : q->o[a] - plane;
}

/* Where the ray enters by a face, its other coordinates have been rounded; correct them, within
 * the volume. */
LR_INLINE void correct_entry(const lr_ray *r, const quantised *q, lr_cursor *u)
{
    const int f = u->axis;
    if (f < 0 || q->d[f] == 0)
        return;
    const int64_t entry = ahead(r, q, f, u->c[f]) - q->unit;
    for (int a = 0; a < 3; a++) {
        if (a == f || q->d[a] == 0)
            continue;
        const int64_t next = ahead(r, q, a, u->c[a]);
        int32_t c = u->c[a];
        if (difference(next, q->d[a], entry, q->d[f]) < 0)
            c += r->s[a];
        else if (difference(next - q->unit, q->d[a], entry, q->d[f]) > 0)
            c -= r->s[a];
        u->c[a] = lr_max_i(r->lo[a], lr_min_i(r->hi[a], c));
    }
}

LR_INLINE void begin_integer(const lr_ray *r, lr_cursor *u, differences *e)
{
    quantised q;
    quantise(r, &q);
    correct_entry(r, &q, u);
    int64_t x[3];
    for (int a = 0; a < 3; a++) {
        x[a] = ahead(r, &q, a, u->c[a]);
        e->grow[a] = (big)q.unit * q.d[a];
    }
    e->xy = difference(x[0], q.d[0], x[1], q.d[1]);
    e->xz = difference(x[0], q.d[0], x[2], q.d[2]);
    e->yz = difference(x[1], q.d[1], x[2], q.d[2]);
}

LR_INLINE bool step_integer(const lr_ray *r, lr_cursor *u, differences *e)
{
    int axis;
    if (e->xy <= 0 && e->xz <= 0) {
        axis = 0;
        e->xy += e->grow[1];
        e->xz += e->grow[2];
    } else if (e->xy > 0 && e->yz <= 0) {
        axis = 1;
        e->xy -= e->grow[0];
        e->yz += e->grow[2];
    } else {
        axis = 2;
        e->xz -= e->grow[0];
        e->yz -= e->grow[1];
    }
    return lr_cross(r, u, axis, lr_next_t(r, LR_REGULAR, u, axis));
}

LR_INLINE void begin_float(const lr_ray *r, const lr_cursor *u, differences *e)
{
    const double length = hypot(hypot(r->d[0], r->d[1]), r->d[2]);
    e->start = u->t;
    e->per_voxel = 1.0 / length;
    for (int a = 0; a < 3; a++) {
        e->next[a] = (float)((lr_next_t(r, LR_REGULAR, u, a) - u->t) * length);
        e->delta[a] = (float)(fabs(r->inv[a]) * length);
    }
}

LR_INLINE bool step_float(const lr_ray *r, lr_cursor *u, differences *e)
{
    int axis = e->next[1] < e->next[0];
    axis = e->next[2] < e->next[axis] ? 2 : axis;
    const double t = e->start + (double)e->next[axis] * e->per_voxel;
    e->next[axis] += e->delta[axis];
    return lr_cross(r, u, axis, t);
}

LR_INLINE void begin_walk(const int32_t *choices, const lr_ray *r, lr_cursor *u, differences *e)
{
    if (choices[0] == INTEGER)
        begin_integer(r, u, e);
    else
        begin_float(r, u, e);
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_cursor *u,
                    differences *e, bool first, lr_tally *tally)
{
    const bool integer = *(const int32_t *)data == INTEGER;
    for (;; first = false) {
        if (!first && !(integer ? step_integer(r, u, e) : step_float(r, u, e)))
            return false;
        lr_count_cell(tally);
        if (lr_is_surface_cell(v, u->c))
            return true;
    }
}

#define LR_NAME                                             frt
#define LR_STATE                                            differences
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(data, ray, cursor, state)
#define LR_REGULAR_WALK                                     walk
#include "trace/walk_template.h"
