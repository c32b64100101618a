/* A scene as the renderer keeps it: checked, copied, ready for rays.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_SCENE_SCENE_H
#define LR_RENDER_SCENE_SCENE_H

#include "render/bsdf/gradient_shading.h"
#include "render/bsdf/material.h"
#include "render/lights/environment.h"
#include "render/lights/light_tree.h"
#include "render/scene/clip.h"
#include "render/scene/field_color.h"
#include "trace/wide_nodes.h"

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

/* An instance without a surface: its volume emits, absorbs and scatters light along rays. */
typedef struct lr_participant {
    uint32_t instance;
    lr_box box; /* in world space, of what is visible */
    bool scatters;
} lr_participant;

struct lr_scene {
    lr_camera camera;
    lr_placed *instances;
    uint32_t n_instances;
    lr_participant *participants;
    uint32_t n_participants;
    bool scatters;         /* some participant or medium does */
    bool has_fog;          /* media that scatter or emit light */
    lr_placed_clip *clips; /* of all instances */
    lr_light *lights;      /* directions of unit length */
    uint64_t n_lights;
    lr_light_tree light_tree;
    lr_material *materials;
    lr_lobe *lobes; /* of all materials */
    uint32_t *slots;
    int32_t *slot_objects; /* or NULL */
    lr_environment environment;
    uint32_t world_visibility; /* lr_visibility */
    int32_t world_bounces;     /* bounces beyond which it does not contribute */
    bool world_emits;          /* its color is not black */
    bool has_clear, has_media; /* instances that are clear, enterable */
    bool has_lights;           /* lights that rays can meet */
    bool emits;                /* some material emits */
    double mist_start, mist_depth, mist_power;
    bool film_transparent;
    bool lone_media;        /* see lr_scene_desc */
    lr_hierarchy hierarchy; /* of instances: for points, */
    lr_wide_tree boxes;     /* and for rays */
    const struct lr_tree_ops *tree_ops;
};

/* The material of id `id` of an instance; its slot, unless slot is NULL. */
LR_INLINE uint32_t lr_material_of(const lr_scene *scene, uint32_t instance, int32_t id,
                                  uint32_t *slot)
{
    const lr_placed *placed = &scene->instances[instance];
    const uint32_t last = placed->n_materials - 1;
    const uint32_t m = id > 0 ? (uint32_t)id : 0;
    const uint32_t at = placed->first_material + (m < last ? m : last);
    if (slot != NULL)
        *slot = at;
    return scene->slots[at];
}

#endif
