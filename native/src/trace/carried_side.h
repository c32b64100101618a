/* Sides that go from triangle cells on through the field: see carried_side.c.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_CARRIED_SIDE_H
#define LR_TRACE_CARRIED_SIDE_H

#include "trace/cell.h"

/* The hit test in a cell of a solid's field, where a triangle cell has handed a side on. */
bool lr_hit_handed(const lr_volume *v, const lr_ray *r, const lr_cursor *u,
                   const lr_trace_options *options, int *side, lr_found *found,
                   uint64_t *n_samples);

/* The same of a sheet, which rays may pass by: the side on which the search starts, 0: as the
 * field says; or LR_STILL where the field leaves the cell on the other side, by no more than
 * it may be off: then there is nothing to be hit yet. */
enum { LR_STILL = INT32_MAX };
int lr_handed_on(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int side,
                 uint64_t *n_samples);

/* Does the field say that the ray, which leaves a surface on this side, starts on the
 * other one, and by more than rounding? Then it leaves the triangle of a triangle cell, but
 * from a point beyond that cell. */
bool lr_starts_off(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int side);

#endif
