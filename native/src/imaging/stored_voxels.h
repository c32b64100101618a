/* What discrete ray tracing stores in surface voxels: normal, colour, and a bit for each light that
 * the voxel sees.
 *
 * A list beside the bricks has an entry per surface cell, in the order of bricks and of the bits of
 * their masks; so the number of a cell is its brick's first and its rank. Normals take two bytes:
 * the octahedral map, off by less than one degree. Colours take three, where the volume carries
 * some. Lights take a bit per voxel each, in an array per light, so that one of them can be moved
 * without a look at the others.
 *
 * Does a voxel see a light? A discrete line leads from it to the light, and where it meets a
 * surface cell, no. The line begins one voxel out along the stored normal, so that the voxel's own
 * neighbours in the surface do not stop it; a light behind the stored normal is not seen.
 *
 * Source: Yagel, Cohen and Kaufman 1992. Departures: 1. a list of surface voxels in place of a
 * dense volume; 2. octahedral normals (Meyer et al. 2010); 3. a start one voxel out.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_IMAGING_STORED_VOXELS_H
#define LR_IMAGING_STORED_VOXELS_H

#include "grid/surface_cells.h"
#include "trace/discrete_line.h"

typedef struct lr_stored_voxels {
    const lr_volume *volume;
    lr_proximity near;
    uint32_t *first;                    /* [table]: number of the first voxel of a brick */
    uint32_t n;                         /* voxels */
    uint16_t *normal;                   /* [n] */
    uint8_t (*color)[3];                /* [n], linear; or NULL: white */
    uint64_t *lit[LR_IMAGE_LIGHTS_MAX]; /* [n / 64 + 1]: a bit per voxel; NULL: no such light */
    lr_image_light light[LR_IMAGE_LIGHTS_MAX];
    uint64_t nbytes;
} lr_stored_voxels;

/* Ends by lr_free_stored in any case. LR_E_MEMORY, LR_E_STOPPED. */
lr_status lr_store_voxels(lr_stored_voxels *s, const lr_volume *v, const lr_watch *watch,
                          lr_error *error);
void lr_free_stored(lr_stored_voxels *s);

/* As lr_prepared_light and lr_prepared_voxels. */
lr_status lr_store_light(lr_stored_voxels *s, int32_t index, const lr_image_light *light,
                         const lr_watch *watch, lr_error *error);
void lr_list_stored(const lr_stored_voxels *s, int32_t *cell, double *normal, double *color,
                    uint32_t *lit);

/* The number of a surface cell. */
LR_INLINE uint32_t lr_stored_number(const lr_stored_voxels *s, const int32_t c[3])
{
    const uint32_t entry = lr_entry(s->volume, c[0], c[1], c[2]);
    return s->first[lr_table_of(s->volume, c[0], c[1], c[2])] +
           lr_mask_rank(lr_entry_mask(s->volume, entry), c[0], c[1], c[2]);
}

LR_INLINE bool lr_sees_light(const lr_stored_voxels *s, int light, uint32_t number)
{
    return s->lit[light][number >> 6] >> (number & 63) & 1;
}

/* The stored normal of a voxel, unit, in object space; 0 where it has none. */
void lr_stored_normal(const lr_stored_voxels *s, uint32_t number, double normal[3]);

/* Of a voxel with that normal: the voxel one out along it, in which rays that leave it begin. */
void lr_voxel_outside(const lr_volume *v, const int32_t c[3], const double normal[3],
                      int32_t out[3]);

/* The discrete line from the centre of voxel c on along d, of storage space: to the cell where it
 * leaves the box of the surface and one voxel around it, or at t = 1 if it ends there. */
void lr_line_along(lr_discrete_line *l, const lr_volume *v, const int32_t c[3], const double d[3],
                   bool ends);

/* Go on along a line to the next surface cell; false at its end. first: stay where it begins. */
LR_INLINE bool lr_next_surface_on_line(const lr_stored_voxels *s, lr_discrete_line *l, bool first,
                                       int32_t c[3], uint64_t *n_cells)
{
    for (lr_line_cell(l, c);; first = false) {
        if (!first) {
            if (!lr_step_line(l, !lr_is_near_surface(&s->near, s->volume, c)))
                return false;
            lr_line_cell(l, c);
        }
        ++*n_cells;
        if (lr_is_surface_cell(s->volume, c))
            return true;
    }
}

/* What the visible lights send to a surface voxel and it reflects, linear RGB. n: its normal. */
void lr_shade_voxel(const lr_stored_voxels *s, uint32_t number, const int32_t c[3],
                    const double n[3], double rgb[3]);

#endif
