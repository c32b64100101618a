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
#include "trace/discrete_line.h"
#include "trace/traverser.h"

enum { ADAPTIVE = 0, CONNECTED_26 = 1, CONNECTED_6 = 2 };

typedef struct flags {
    int32_t connectivity;
    lr_proximity near; /* of ADAPTIVE */
} flags;

void lr_lines_free(void *data)
{
    flags *f = data;
    if (f == NULL)
        return;
    lr_proximity_free(&f->near);
    free(f);
}

lr_status lr_lines_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                         void **data, uint64_t *nbytes, lr_error *error)
{
    lr_status status = LR_OK;
    flags *f = calloc(1, sizeof *f);
    if (f == NULL)
        return lr_fail_memory(error, sizeof *f, "flags");
    *nbytes = sizeof *f;
    f->connectivity = choices[0];
    if (f->connectivity == ADAPTIVE)
        status = lr_proximity_build(&f->near, v, watch, nbytes, error);
    if (status != LR_OK) {
        lr_lines_free(f);
        return status;
    }
    *data = f;
    return LR_OK;
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_cursor *u,
                    lr_discrete_line *l, bool first, lr_tally *tally)
{
    const flags *f = data;
    for (;; first = false) {
        int32_t c[3];
        lr_line_cell(l, c);
        if (!first) {
            const bool wide = f->connectivity == CONNECTED_26 ||
                              (f->connectivity == ADAPTIVE && !lr_is_near_surface(&f->near, v, c));
            if (!lr_step_line(l, wide))
                return false;
            lr_line_cell(l, c);
        }
        lr_count_cell(tally);
        if (lr_is_surface_cell(v, c))
            return lr_stand_on(r, u, c);
    }
}

#define LR_NAME  lines
#define LR_STATE lr_discrete_line
#define LR_START(data, volume, ray, lattice, cursor, state)                                        \
    lr_begin_line_of_ray(state, ray, (cursor)->c)
#define LR_REGULAR_WALK walk
#include "trace/walk_template.h"
