/* A scene as the renderer keeps it: checked, copied, ready for rays.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_SCENE_SCENE_H
#define LR_RENDER_SCENE_SCENE_H

#include "render/bsdf/material.h"
#include "render/lights/environment.h"
#include "render/lights/light_tree.h"
#include "render/scene/rebraid.h"

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
    lr_wide_tree boxes;     /* and for rays, */
    lr_rebraided opened;    /* which may go by trees */
    uint32_t n_branches;    /* that a ray's stack needs in either */
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
