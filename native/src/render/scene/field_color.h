/* Colours of hits by a scalar field.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_SCENE_FIELD_COLOR_H
#define LR_RENDER_SCENE_FIELD_COLOR_H

#include "base/base.h"

/* A placed field. */
typedef struct lr_placed_color {
    const lr_volume *volume;   /* NULL: there is none */
    const lr_program *program; /* NULL: hits take ids */
    double object_from_world[16];
    double scale, offset; /* of stored values */
    bool slope;           /* not the value */
} lr_placed_color;

/* LR_E_ARGUMENT with a sentence that names the instance, LR_E_SIZE as lr_program_run. */
lr_status lr_field_color_place(const lr_field_color *color, uint64_t instance,
                               lr_placed_color *placed, lr_error *error);

/* Linear RGB at a point of world space. */
void lr_field_color_at(const lr_placed_color *color, const double world[3], double rgb[3]);

/* The id that weighs most at a point of world space, of the samples inside in the cell and beside
 * it; 0 where there is none. */
int32_t lr_field_id_at(const lr_placed_color *color, const double world[3]);

#endif
