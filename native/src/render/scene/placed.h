/* Instances as the renderer keeps them.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_SCENE_PLACED_H
#define LR_RENDER_SCENE_PLACED_H

#include "render/bsdf/gradient_shading.h"
#include "render/scene/clip.h"
#include "render/scene/field_color.h"

/* An instance, as seen from a ray. */
typedef struct lr_placed {
    const lr_structure *structure;
    double object_from_world[16], world_from_object[16];
    uint32_t visibility; /* lr_visibility */
    int32_t object_index;
    uint32_t first_material, n_materials;
    int32_t volume_index;
    double error; /* of its surface, in world space */
    double volume_unit;
    lr_phase phase;               /* of what its volume scatters, */
    lr_gradient_shading gradient; /* and how that is shaded */
    bool clear;                   /* lets some light straight through */
    bool enterable;               /* a solid that bends light or is filled */
    bool holdout;
    bool has_tree;               /* rays meet it by the tree of its structure alone */
    const lr_placed_clip *clips; /* [n_clips] */
    uint64_t n_clips;
    lr_placed_color color;
} lr_placed;

#endif
