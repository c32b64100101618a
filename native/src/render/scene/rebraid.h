/* Instances whose boxes overlap, as the branches of their trees.
 *
 * A ray that comes to where instances overlap would go through the trees of all. Their branches
 * overlap less: the nearest is met first, and what it meets spares the ray the others.
 *
 * Source: Benthin, Woop, Wald, Afra 2017, Improved two-level BVHs using partial re-braiding.
 * Departure: instances are opened before the hierarchy is built over them, the largest first, and
 * only where they overlap.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_SCENE_REBRAID_H
#define LR_RENDER_SCENE_REBRAID_H

#include "render/scene/placed.h"
#include "trace/wide_nodes.h"

/* An instance that a ray meets by its tree, or a branch of that. */
typedef struct lr_scene_part {
    uint32_t instance, branch;
} lr_scene_part;

typedef struct lr_rebraided {
    lr_wide_tree boxes; /* over parts, each a leaf; of no nodes: no instance is opened */
    lr_scene_part *parts;
} lr_rebraided;

/* The box in world space of the box lo..hi in storage space, from which m leads there. */
lr_box lr_world_box(const double m[16], const double lo[3], const double hi[3]);

/* Open those of n instances that overlap, by their boxes. What `out` has got is the caller's to
 * free, even where something fails. */
lr_status lr_rebraid(const lr_placed *instances, uint32_t n, const lr_box *boxes, lr_rebraided *out,
                     lr_error *error);

#endif
