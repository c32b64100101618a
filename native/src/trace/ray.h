/* Rays in storage space: set-up, clipping and the one exit kernel.
 *
 * Every traverser only chooses an empty box of cells around the present one;
 * lr_exit leaves it. The parameter t is recomputed from the integer plane that
 * is crossed, never accumulated. Lateral coordinates are clamped so that no
 * axis steps backwards; crossings are ordered by (t, axis). Hence a walk ends
 * after at most nx + ny + nz steps, whatever rounding does.
 *
 * Planes lie at the integers, or, in a rectilinear volume, where its tables say; then
 * the cell of a point is searched for within the box.
 *
 * Source: Amanatides and Woo 1987 for the order of crossings, Sramek 1994 for
 * leaving boxes, Slater 1992 for rectilinear ones. Departures: 1. recomputation; 2. clamping; 3. a
 * start on a plane belongs to the cell that the ray goes into.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_RAY_H
#define LR_TRACE_RAY_H

#include "base/affine.h"
#include "grid/brick_grid.h"

typedef struct lr_ray {
    double o[3], d[3];
    double inv[3];        /* 1 / d, 0 where the axis is not moved along */
    double never[3];      /* infinity where the axis is not moved along, else 0 */
    int32_t s[3];         /* sign of d: -1, 0, +1 */
    int32_t lo[3], hi[3]; /* cells to walk in, inclusive */
    double t_max;
    const double *const *planes; /* of LR_RECTILINEAR */
} lr_ray;

/* Do planes lie at the integers, or where r->planes says? Given as a constant, so that
 * planes at the integers pay nothing for the others. */
typedef enum lr_lattice { LR_REGULAR, LR_RECTILINEAR } lr_lattice;

/* Where a walk stands. */
typedef struct lr_cursor {
    int32_t c[3];
    int32_t axis; /* of the face it entered by; -1: it started inside the cell */
    double t;     /* at the entry */
} lr_cursor;

/* A component so small beside the others moves less than 1e-24 voxel over a
 * million voxels; taking it as 0 keeps its reciprocal finite. */
#define LR_TINY_COMPONENT  1e-30
#define LR_LEAST_COMPONENT 0x1p-1021

/* From object space; points: only what points along it need, not planes. False for a ray without
 * direction or with a NaN or an infinity; a component whose reciprocal is infinite is none. t is
 * the same in both spaces. */
LR_INLINE bool lr_ray_make(lr_ray *r, const lr_volume *v, const double o[3], const double d[3],
                           double t_max, bool points)
{
    r->planes = (const double *const *)v->planes;
    lr_map_point(v->storage_from_object, o, r->o);
    lr_map_vector(v->storage_from_object, d, r->d);
    double largest = 0.0, sum = 0.0;
    for (int a = 0; a < 3; a++) {
        double size = fabs(r->d[a]);
        largest = size > largest ? size : largest;
        sum += r->o[a] - r->o[a] + (size - size); /* 0, or NaN where one is not finite */
    }
    if (!(largest >= LR_LEAST_COMPONENT) || sum != 0.0)
        return false;
    const double least = fmax(LR_TINY_COMPONENT * largest, LR_LEAST_COMPONENT);
    for (int a = 0; a < 3; a++) {
        double x = r->d[a];
        r->s[a] = fabs(x) < least ? 0 : (x > 0.0) - (x < 0.0);
        if (points)
            continue;
        r->inv[a] = r->s[a] != 0 ? 1.0 / x : 0.0;
        r->never[a] = r->s[a] != 0 ? 0.0 : INFINITY;
    }
    r->t_max = t_max;
    return true;
}

LR_INLINE bool lr_ray_setup(lr_ray *r, const lr_volume *v, const double o[3], const double d[3],
                            double t_max)
{
    return lr_ray_make(r, v, o, d, t_max, false);
}

/* The cell along one axis that a ray at q goes on into: floor, but the lower
 * cell where it stands on a plane and moves down. */
LR_INLINE double lr_floor_along(double q, int32_t s)
{
    double c = floor(q);
    return s < 0 && c == q ? c - 1.0 : c;
}

/* Where plane k of an axis lies. */
LR_INLINE double lr_plane_at(const lr_ray *r, lr_lattice lattice, int a, int32_t k)
{
    return lattice == LR_RECTILINEAR ? r->planes[a][k] : (double)k;
}

/* t at which the ray crosses plane k of an axis; infinity where it never does. */
LR_INLINE double lr_plane_t(const lr_ray *r, lr_lattice lattice, int a, int32_t k)
{
    return (lr_plane_at(r, lattice, a, k) - r->o[a]) * r->inv[a] + r->never[a];
}

/* The cell among lo..hi, the nearest one for a point beside them, that a ray at q goes
 * on into. */
LR_INLINE int32_t lr_cell_of(const lr_ray *r, lr_lattice lattice, int a, double q, int32_t lo,
                             int32_t hi)
{
    if (lattice == LR_REGULAR) { /* cells are 0 and more: no need to round down */
        uint64_t bits;
        memcpy(&bits, &q, sizeof q);
        bits -= r->s[a] < 0; /* the next smaller number, of those over 0 */
        memcpy(&q, &bits, sizeof q);
        return (int32_t)lr_clamp(q, lo, hi);
    }
    const double *planes = r->planes[a];
    while (lo < hi) { /* the last cell whose lower plane the ray has reached */
        const int32_t middle = hi - (hi - lo) / 2;
        const bool reached = r->s[a] < 0 ? planes[middle] < q : planes[middle] <= q;
        lo = reached ? middle : lo;
        hi = reached ? hi : middle - 1;
    }
    return lo;
}

/* Clip to the cells lo..hi from t_min on and stand on the first; false: a miss. */
LR_INLINE bool lr_enter(lr_ray *r, lr_lattice lattice, lr_cursor *u, const int32_t lo[3],
                        const int32_t hi[3], double t_min)
{
    /* The far bound is widened by the error of lr_plane_t, so that no cell at the
     * far side is lost to rounding; lr_exit ends the walk by its cells. */
    const double wider = 1.0 + 8.0 * 0x1p-53;
    double t0 = t_min, t1 = r->t_max;
    int32_t axis = -1;
    if (lo[0] > hi[0]) /* no cells: nothing holds of such bounds */
        return false;
    for (int a = 0; a < 3; a++) {
        r->lo[a] = lo[a];
        r->hi[a] = hi[a];
        if (r->s[a] == 0) {
            if (!(r->o[a] >= lr_plane_at(r, lattice, a, lo[a]) &&
                  r->o[a] < lr_plane_at(r, lattice, a, hi[a] + 1)))
                return false;
            continue;
        }
        double near = lr_plane_t(r, lattice, a, r->s[a] > 0 ? lo[a] : hi[a] + 1);
        double far = lr_plane_t(r, lattice, a, r->s[a] > 0 ? hi[a] + 1 : lo[a]);
        if (near > t0) {
            t0 = near;
            axis = a;
        }
        far = far > 0.0 ? far * wider : far;
        t1 = far < t1 ? far : t1;
    }
    if (!(t0 <= t1))
        return false;
    for (int a = 0; a < 3; a++) {
        const double q = r->s[a] == 0 ? r->o[a] : r->o[a] + t0 * r->d[a];
        const int32_t first = r->s[a] > 0 ? lo[a] : hi[a];
        u->c[a] = a == axis ? first : lr_cell_of(r, lattice, a, q, lo[a], hi[a]);
    }
    u->axis = axis;
    u->t = t0;
    return true;
}

/* The crossing by which the ray leaves the box lo..hi of cells. */
LR_INLINE double lr_exit_t(const lr_ray *r, lr_lattice lattice, const int32_t lo[3],
                           const int32_t hi[3], int *axis)
{
    double t[3];
    for (int a = 0; a < 3; a++)
        t[a] = lr_plane_t(r, lattice, a, r->s[a] > 0 ? hi[a] + 1 : lo[a]);
    const bool second = t[1] < t[0];
    const double first = second ? t[1] : t[0];
    const bool third = t[2] < first;
    *axis = third ? 2 : second;
    return third ? t[2] : first;
}

/* Go through the face of one axis at t, whose plane next to u->c it is; false:
 * the ray has ended. An axis that is not moved along is chosen only where every t
 * has overflowed, by directions of some 1e-300. */
LR_INLINE bool lr_cross(const lr_ray *r, lr_cursor *u, int axis, double t)
{
    t = t > u->t ? t : u->t;
    for (int a = 0; a < 3; a++) /* no index that is only known then: cells stay in registers */
        u->c[a] += a == axis ? r->s[a] : 0;
    u->axis = axis;
    u->t = t;
    return r->s[axis] != 0 && t <= r->t_max && u->c[axis] >= r->lo[axis] &&
           u->c[axis] <= r->hi[axis];
}

/* The plane of its cell that the ray goes towards. */
LR_INLINE double lr_next_t(const lr_ray *r, lr_lattice lattice, const lr_cursor *u, int a)
{
    return lr_plane_t(r, lattice, a, u->c[a] + (r->s[a] > 0));
}

/* Leave the one cell u->c: as lr_exit does, and shorter, since no other
 * coordinate can change. */
LR_INLINE bool lr_step(const lr_ray *r, lr_lattice lattice, lr_cursor *u)
{
    const double x = lr_next_t(r, lattice, u, 0), y = lr_next_t(r, lattice, u, 1),
                 z = lr_next_t(r, lattice, u, 2);
    if (y < x)
        return z < y ? lr_cross(r, u, 2, z) : lr_cross(r, u, 1, y);
    return z < x ? lr_cross(r, u, 2, z) : lr_cross(r, u, 0, x);
}

/* Go on to the box lo..hi of cells, cut to what lies ahead of the cursor; false: the
 * ray passes it by, and the cursor stays. Nothing moves where u->c is in the box.
 *
 * A box counts as met where the last plane into it comes before the first plane
 * out, both from lr_plane_t, whose rounding is monotonous in the plane: hence the
 * cells that are met so are those that lr_step would visit, boxes of cells are met
 * wherever one of their cells is, and none needs to be widened. */
LR_INLINE bool lr_advance_to_box(const lr_ray *r, lr_lattice lattice, lr_cursor *u,
                                 const int32_t lo[3], const int32_t hi[3])
{
    int32_t near[3], far[3];
    double in = -INFINITY, out = INFINITY;
    int axis = -1;
    for (int a = 0; a < 3; a++) {
        const int32_t low = r->s[a] < 0 ? lo[a] : lr_max_i(lo[a], u->c[a]);
        const int32_t high = r->s[a] > 0 ? hi[a] : lr_min_i(hi[a], u->c[a]);
        if (low > high)
            return false;
        near[a] = r->s[a] < 0 ? high : low;
        far[a] = r->s[a] < 0 ? low : high;
        const double t_far = lr_plane_t(r, lattice, a, far[a] + (r->s[a] > 0));
        out = t_far < out ? t_far : out;
        if (near[a] == u->c[a])
            continue;
        const double t_near = lr_plane_t(r, lattice, a, near[a] + (r->s[a] < 0));
        if (t_near >= in) {
            in = t_near;
            axis = a;
        }
    }
    if (axis < 0)
        return true;
    if (!(in <= out && in <= r->t_max))
        return false;
    u->t = in > u->t ? in : u->t;
    for (int a = 0; a < 3; a++) {
        if (r->s[a] == 0)
            continue;
        const bool up = r->s[a] > 0;
        u->c[a] = a == axis ? near[a]
                            : lr_cell_of(r, lattice, a, r->o[a] + u->t * r->d[a],
                                         up ? near[a] : far[a], up ? far[a] : near[a]);
    }
    u->axis = axis;
    return true;
}

/* Leave the box lo..hi around u->c; false: the ray has ended. Which axis is crossed nothing
 * foretells: it is no branch. */
LR_INLINE bool lr_exit(const lr_ray *r, lr_lattice lattice, lr_cursor *u, const int32_t lo[3],
                       const int32_t hi[3])
{
    int axis;
    double t = lr_exit_t(r, lattice, lo, hi, &axis);
    t = t > u->t ? t : u->t;
    if (!(t <= r->t_max))
        return false;
    bool on = true;
    for (int a = 0; a < 3; a++) {
        const int32_t up = -(r->s[a] > 0), moves = -(r->s[a] != 0), crossed = -(a == axis);
        const int32_t low = (u->c[a] & up) | (lo[a] & ~up), high = (hi[a] & up) | (u->c[a] & ~up);
        const int32_t within = lr_cell_of(r, lattice, a, r->o[a] + t * r->d[a], low, high);
        const int32_t beyond = ((hi[a] + 1) & up) | ((lo[a] - 1) & ~up);
        const int32_t to = (within & moves) | (u->c[a] & ~moves);
        u->c[a] = (beyond & crossed) | (to & ~crossed);
        on &= (u->c[a] >= r->lo[a]) & (u->c[a] <= r->hi[a]);
    }
    u->axis = axis;
    u->t = t;
    return on;
}

#endif
