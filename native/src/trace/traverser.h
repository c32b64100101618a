/* What a traverser's file includes first: rays, the accessor and the prototypes
 * of the three functions that every line of the registry stands for.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_TRAVERSER_H
#define LR_TRACE_TRAVERSER_H

#include "grid/triangle_cells.h"
#include "trace/cell_common.h"
#include "trace/ray.h"
#include "trace/start_side.h"
#include "trace/structure.h"

#define LR_TRAVERSER(name, label, source, about, options, flags)                                   \
    lr_status lr_##name##_build(const lr_volume *, const int32_t *, const lr_watch *, void **,     \
                                uint64_t *, lr_error *);                                           \
    void lr_##name##_free(void *);                                                                 \
    lr_status lr_##name##_trace(const lr_volume *, const void *, const lr_rays *, uint64_t,        \
                                const lr_trace_options *, const lr_hits *, lr_counters *,          \
                                const lr_watch *, lr_error *);
#include "trace/traversers.def"
#undef LR_TRAVERSER

/* Cut an empty box to the cells that the ray may walk in: one that reaches out
 * of them would let it leave sideways unseen. */
LR_INLINE void lr_cut_box(const lr_ray *r, int32_t lo[3], int32_t hi[3])
{
    for (int a = 0; a < 3; a++) {
        lo[a] = lr_max_i(lo[a], r->lo[a]);
        hi[a] = lr_min_i(hi[a], r->hi[a]);
    }
}

/* A start inside an object cell is a binary hit before any step. */
LR_INLINE bool lr_starts_inside(const lr_volume *v, const lr_ray *r, lr_lattice lattice,
                                double t_min, lr_cursor *u)
{
    lr_ray copy = *r;
    const int32_t lo[3] = {1, 1, 1};
    const int32_t hi[3] = {v->desc.nx + 1, v->desc.ny + 1, v->desc.nz + 1};
    return lr_enter(&copy, lattice, u, lo, hi, t_min) && u->axis < 0 && lr_object_cell(v, u->c);
}

/* As lr_leave takes it. */
LR_INLINE const double *lr_way_of(const lr_rays *rays, uint64_t i)
{
    return rays->way != NULL ? rays->way[i] : NULL;
}

/* Leave a surface: stand on its cell, on the side of the triangles that it keeps, whatever rounding
 * says. way: see lr_ways_to_sides, where it is known; else NULL, or NaN. */
LR_INLINE bool lr_leave(const lr_volume *v, lr_ray *r, lr_cursor *u, const lr_start *start,
                        double t_min, const double *way)
{
    bool inside = true;
    for (int a = 0; a < 3; a++) {
        inside = inside && start->cell[a] >= v->surface_lo[a] - LR_PAD &&
                 start->cell[a] <= v->surface_hi[a] - LR_PAD;
        u->c[a] = inside ? start->cell[a] + LR_PAD : 0; /* the caller's may be any int32 */
        r->lo[a] = v->surface_lo[a];
        r->hi[a] = v->surface_hi[a];
    }
    u->axis = -1;
    u->t = t_min;
    if (inside && v->triangle_cells != NULL && lr_is_triangle_cell(v, u->c)) {
        const int32_t c[3] = {u->c[0], u->c[1], u->c[2]}; /* copies, for the registers' sake */
        double q[3], own[2][3];
        if (way == NULL || isnan(way[0])) {
            lr_point_at(r, t_min, q);
            lr_ways_to_sides(v, c, start->side, q, own);
            way = own[0];
        }
        for (int a = 0; a < 3; a++)
            r->o[a] += way[a];
    }
    return inside;
}

/* What a walk counts; NULL where nobody asked. */
typedef struct lr_tally {
    uint64_t cells, jumps, nodes;
} lr_tally;

LR_INLINE void lr_count_cell(lr_tally *tally)
{
    if (tally != NULL)
        tally->cells++;
}

LR_INLINE void lr_count_jump(lr_tally *tally, bool jump)
{
    if (tally != NULL)
        tally->jumps += jump;
}

LR_INLINE void lr_count_node(lr_tally *tally)
{
    if (tally != NULL)
        tally->nodes++;
}

#endif
