/* Discrete lines between voxel centres, in integers.
 *
 * The ray becomes the line from the centre of the cell it starts in to the centre of
 * the one it leaves by. A 26-connected line takes a step of one voxel along its longest
 * axis and, where the line has come nearer to the next row, along the others with it; a
 * 6-connected one crosses one plane between voxels at a time. The adaptive one goes by
 * 26-steps and, where a flag says that surface is next to the voxel, by 6-steps.
 *
 * Not exact: ends are rounded to centres, so that the line is off the ray by up to half a
 * voxel and visits other cells; 26-steps slip through surfaces that are one voxel thick.
 * t is where the ray meets the cell, or would if it met the cell.
 *
 * Source: Kaufman and Shimony 1986; the adaptive line is that of discrete ray tracing
 * (Yagel, Cohen and Kaufman 1992). Departures: 1. both lines share their state, how far
 * they are along each axis, so that a switch does not bend the line; 2. the flag is set
 * in all 26 neighbours, one bit per cell, of bricks near the surface only.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "distance/narrow_band.h"
#include "trace/traverser.h"

enum { ADAPTIVE = 0, CONNECTED_26 = 1, CONNECTED_6 = 2 };

typedef struct flags {
    int32_t connectivity;
    uint32_t *bricks; /* [table]: index into near, or LR_FAR_BRICK */
    lr_mask *near;    /* as the store's surface cells: is one of them at most a step away? */
} flags;

void lr_lines_free(void *data)
{
    flags *f = data;
    if (f == NULL)
        return;
    free(f->bricks);
    free(f->near);
    free(f);
}

static void flag_cells(const lr_volume *v, const int32_t b[3], uint32_t number, void *context)
{
    const flags *f = context;
    uint64_t *mask = f->near[number];
    lr_window window;
    memset(mask, 0, sizeof(lr_mask));
    lr_window_fill(v, b, window);
    lr_window_grow(window);
    for (int z = 0; z < LR_SIDE; z++)
        for (int y = 0; y < LR_SIDE; y++)
            lr_mask_add_row(mask, y, z,
                            window[LR_NEAR_RADIUS + z][LR_NEAR_RADIUS + y] >> LR_NEAR_RADIUS);
}

lr_status lr_lines_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                         void **data, uint64_t *nbytes, lr_error *error)
{
    uint32_t n_near = 0;
    lr_status status = LR_OK;
    flags *f = calloc(1, sizeof *f);
    if (f == NULL)
        return lr_fail_memory(error, sizeof *f, "flags");
    *nbytes = sizeof *f;
    f->connectivity = choices[0];
    if (f->connectivity == ADAPTIVE) {
        status = lr_near_bricks(v, &f->bricks, &n_near, watch, error);
        *nbytes += lr_table_count(v) * sizeof *f->bricks + n_near * sizeof *f->near;
        f->near = malloc((n_near + (size_t)1) * sizeof *f->near);
        if (status == LR_OK && f->near == NULL)
            status = lr_fail_memory(error, n_near * sizeof *f->near, "flags");
        if (status == LR_OK)
            status = lr_near_each(v, f->bricks, flag_cells, f, watch, error);
    }
    if (status != LR_OK) {
        lr_lines_free(f);
        return status;
    }
    *data = f;
    return LR_OK;
}

/* Is a surface cell at most one step away? */
LR_INLINE bool flagged(const flags *f, const lr_volume *v, const int32_t c[3])
{
    const uint32_t number = f->bricks[lr_table_of(v, c[0], c[1], c[2])];
    if (number & LR_FAR_BRICK)
        return false;
    return lr_mask_has(f->near[number], c[0], c[1], c[2]);
}

typedef struct line {
    int32_t from[3];
    int64_t n[3]; /* steps from end to end along each axis */
    int64_t k[3]; /* steps done */
    int longest;
} line;

LR_INLINE void begin_walk(const lr_ray *r, const lr_cursor *u, line *l)
{
    int axis;
    const double t = lr_exit_t(r, LR_REGULAR, r->lo, r->hi, &axis);
    l->longest = 0;
    for (int a = 0; a < 3; a++) {
        const double q = a == axis ? (r->s[a] > 0 ? r->hi[a] : r->lo[a])
                                   : floor(r->o[a] + (r->s[a] != 0 ? t * r->d[a] : 0.0));
        const int32_t to = (int32_t)lr_clamp(q, r->lo[a], r->hi[a]);
        l->from[a] = u->c[a];
        l->k[a] = 0;
        l->n[a] = lr_max_i(0, (to - u->c[a]) * r->s[a]);
        l->longest = l->n[a] > l->n[l->longest] ? a : l->longest;
    }
}

/* The other coordinates where the line is one voxel on along its longest axis; false
 * where that is no step to a neighbour, after steps of the other kind. */
LR_INLINE bool step_26(line *l)
{
    const int m = l->longest;
    const int64_t along = 2 * (l->k[m] + 1);
    int64_t to[3];
    for (int a = 0; a < 3; a++) {
        to[a] = l->k[a] + (along * l->n[a] > (2 * l->k[a] + 1) * l->n[m]);
        if (a != m && along * l->n[a] > (2 * to[a] + 1) * l->n[m])
            return false;
    }
    to[m] = l->k[m] + 1;
    if (to[m] > l->n[m])
        return false;
    memcpy(l->k, to, sizeof to);
    return true;
}

/* Through the plane between two voxels that the line crosses next; false at its end. */
LR_INLINE bool step_6(line *l)
{
    int axis = -1;
    for (int a = 0; a < 3; a++) {
        if (l->k[a] == l->n[a])
            continue;
        if (axis < 0 || (2 * l->k[a] + 1) * l->n[axis] < (2 * l->k[axis] + 1) * l->n[a])
            axis = a;
    }
    if (axis < 0)
        return false;
    l->k[axis]++;
    return true;
}

/* Stand on cell c, though the ray may pass it by; false beyond the ray's end. */
LR_INLINE bool stand(const lr_ray *r, lr_cursor *u, const int32_t c[3])
{
    if (lr_advance_to_box(r, LR_REGULAR, u, c, c))
        return true;
    double in = u->t;
    for (int a = 0; a < 3; a++) {
        if (c[a] == u->c[a])
            continue;
        const double t = lr_plane_t(r, LR_REGULAR, a, c[a] + (r->s[a] < 0));
        if (t >= in) {
            in = t;
            u->axis = a;
        }
    }
    memcpy(u->c, c, sizeof u->c);
    u->t = in;
    return in <= r->t_max;
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_cursor *u, line *l,
                    bool first, lr_tally *tally)
{
    const flags *f = data;
    for (;; first = false) {
        int32_t c[3];
        for (int a = 0; a < 3; a++)
            c[a] = l->from[a] + r->s[a] * (int32_t)l->k[a];
        if (!first) {
            const bool wide = f->connectivity == CONNECTED_26 ||
                              (f->connectivity == ADAPTIVE && !flagged(f, v, c));
            if (!(wide && step_26(l)) && !step_6(l))
                return false;
            for (int a = 0; a < 3; a++)
                c[a] = l->from[a] + r->s[a] * (int32_t)l->k[a];
        }
        lr_count_cell(tally);
        if (lr_is_surface_cell(v, c))
            return stand(r, u, c);
    }
}

#define LR_NAME                                             lines
#define LR_STATE                                            line
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(ray, cursor, state)
#define LR_REGULAR_WALK                                     walk
#include "trace/walk_template.h"
