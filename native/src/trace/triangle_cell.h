/* The hit test of triangle cells, and of the cells that a ray enters from one.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_TRIANGLE_CELL_H
#define LR_TRACE_TRIANGLE_CELL_H

#include "grid/triangle_cells.h"
#include "trace/carried_side.h"
#include "trace/object_cell.h"
#include "trace/tricubic_cell.h"
#include "trace/uniform_samples.h"

/* How a ray left a surface. */
typedef struct lr_leaving {
    double t;        /* where */
    int32_t side;    /* on which side, -1 or +1; 0: it left none, or nobody knows */
    int32_t cell[3]; /* storage cell; where there is a side */
} lr_leaving;

/* start: NULL where rays leave nothing. Where its cell is none, the ray is given up
 * before it meets anything. */
LR_INLINE lr_leaving lr_leaving_of(const lr_start *start, double t_min)
{
    lr_leaving leaving = {.t = t_min, .side = start != NULL ? start->side : 0};
    for (int a = 0; a < 3 && leaving.side != 0; a++)
        leaving.cell[a] = (int32_t)((uint32_t)start->cell[a] + LR_PAD);
    return leaving;
}

/* A frame in which the ray is an axis: what x and y lose along it. */
typedef struct lr_shear {
    int x, y, z; /* axes; z: the longest of the direction */
    double sx, sy, sz;
} lr_shear;

LR_INLINE lr_shear lr_shear_of(const lr_ray *r)
{
    lr_shear s = {.z = 0};
    for (int a = 1; a < 3; a++)
        s.z = fabs(r->d[a]) > fabs(r->d[s.z]) ? a : s.z;
    s.x = (s.z + 1) % 3;
    s.y = (s.z + 2) % 3;
    s.sz = 1.0 / r->d[s.z];
    s.sx = r->d[s.x] * s.sz;
    s.sy = r->d[s.y] * s.sz;
    return s;
}

/* How far the ray gets from the plane of a normal per unit of t, voxels. */
LR_INLINE double lr_plane_speed(const lr_ray *r, const double n[3])
{
    return fabs(lr_dot(n, r->d)) / sqrt(lr_dot(n, n));
}

/* Does the ray meet a triangle in the triangle cell it stands on? *side: see lr_hit. */
bool lr_hit_triangle_cell(const lr_volume *v, const lr_ray *r, const lr_cursor *u,
                          const lr_leaving *leaving, const lr_trace_options *options, int *side,
                          lr_found *found, uint64_t *n_samples);

/* The hit test of any cell. *side as in lr_hit_cell, but twice that where a triangle
 * cell has handed it on; what it is afterwards goes with the next cell. What the rare
 * branches are given are copies, so that the ray and the cursor may live in registers. */
LR_INLINE bool lr_hit(const lr_volume *v, const lr_ray *r, lr_lattice lattice, const lr_cursor *u,
                      const lr_leaving *leaving, int *side, const lr_trace_options *options,
                      lr_found *found, uint64_t *n_samples)
{
    int start = *side;
    if (lr_is_cubic(v)) {
        const lr_ray ray = *r;
        const lr_cursor cursor = *u;
        lr_found own = {.triangle = LR_NO_TRIANGLE, .object = LR_NO_OBJECT};
        uint64_t more = 0;
        const bool hit =
            lr_hit_tricubic(v, &ray, &cursor, leaving->t, &start, options, &own, &more);
        *n_samples += more;
        *side = start;
        if (hit)
            *found = own;
        return hit;
    }
    if (v->triangle_cells != NULL) {
        const lr_ray ray = *r;
        const lr_cursor cursor = *u;
        uint64_t more = 0;
        if (lr_is_triangle_cell(v, cursor.c)) {
            lr_found own;
            const lr_leaving left = *leaving;
            const bool hit =
                lr_hit_triangle_cell(v, &ray, &cursor, &left, options, &start, &own, &more);
            *n_samples += more;
            *side = start;
            if (hit)
                *found = own;
            return hit;
        }
        if (abs(start) == 1 && lr_starts_off(v, &ray, &cursor, start))
            *side = start = 2 * start;
        if (abs(start) > 1 && v->desc.kind == LR_KIND_SOLID && v->objects == NULL) {
            lr_found own;
            const bool hit = lr_hit_handed(v, &ray, &cursor, options, &start, &own, &more);
            *n_samples += more;
            *side = start;
            if (hit)
                *found = own;
            return hit;
        }
        if (abs(start) > 1)
            start = lr_handed_on(v, &ray, &cursor, start, &more);
        *n_samples += more;
        if (start == LR_STILL)
            return false;
    }
    *side = 0;
    if (v->objects != NULL) {
        const lr_ray ray = *r;
        const lr_cursor cursor = *u;
        lr_found own;
        uint64_t more = 0;
        const bool hit = lr_hit_objects(v, &ray, &cursor, start, options, &own, &more);
        *n_samples += more;
        if (hit)
            *found = own;
        found->triangle = LR_NO_TRIANGLE;
        return hit;
    }
    found->triangle = LR_NO_TRIANGLE;
    found->object = LR_NO_OBJECT;
    return options->hit_test == LR_HIT_UNIFORM
               ? lr_hit_uniform(v, r, u, leaving->t, start, options, found, n_samples)
               : lr_hit_cell(v, r, lattice, u, start, options, found, n_samples);
}

#endif
