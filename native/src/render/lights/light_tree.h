/* Chooses among many lights for sampling, and finds those that a ray may meet.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_LIGHTS_LIGHT_TREE_H
#define LR_RENDER_LIGHTS_LIGHT_TREE_H

#include "render/lights/environment.h"

enum {
    LR_LIGHTS_ALL = 8,    /* up to so many, all are sampled at primary hits; of more, */
    LR_LIGHTS_CHOSEN = 4, /* so many are chosen */
    LR_LIGHT_WALK = 96    /* see lr_light_walk */
};

#define LR_LIGHT_NONE UINT64_MAX

/* Some lights, or one. */
typedef struct lr_light_node {
    lr_light_bounds bounds;
    uint32_t child;  /* the first of two neighbours; or the light | LR_LIGHT_LEAF */
    uint32_t parent; /* of the root itself */
    bool met;        /* by rays: some has extent */
} lr_light_node;

#define LR_LIGHT_LEAF 0x80000000u

typedef struct lr_light_tree {
    uint64_t n_lights;
    uint64_t n;           /* with the world as the last, if that is sampled */
    lr_light_node *nodes; /* first the distant lights, then the root */
    uint32_t n_nodes, n_distant;
    uint32_t *leaf; /* [n_lights] its node */
    double world;   /* its irradiance, of lr_brightness */
} lr_light_tree;

lr_status lr_light_tree_make(const lr_light *lights, uint64_t n_lights,
                             const lr_environment *environment, lr_light_tree *light_tree,
                             lr_error *error);
void lr_light_tree_free(lr_light_tree *light_tree);

/* A light for the point p of a surface with normal n (unit; zero: it gets light from either side),
 * the likelier the more it may contribute, and its selection probability; LR_LIGHT_NONE where
 * none contributes anything. u: 0..1, 1 not included. */
uint64_t lr_light_tree_choose(const lr_light_tree *light_tree, const double p[3], const double n[3],
                              double u, double *probability);
double lr_light_tree_probability(const lr_light_tree *light_tree, uint64_t light_index,
                                 const double p[3], const double n[3]);

/* Lights of extent that the ray from o along d may meet before t_max, one after the other: distant
 * ones, then those whose boxes it meets. The tree is at most so high. */
typedef struct lr_light_walk {
    uint32_t n_distant; /* behind it */
    uint32_t n, node[LR_LIGHT_WALK];
} lr_light_walk;

void lr_light_tree_start(const lr_light_tree *light_tree, lr_light_walk *walk);
uint64_t lr_light_tree_next(const lr_light_tree *light_tree, lr_light_walk *walk, const double o[3],
                            const double d[3], double t_max);

/* The number of lights that a surface samples after `bounces` bounces. */
LR_INLINE uint32_t lr_light_tree_n_samples(const lr_light_tree *light_tree, uint32_t bounces)
{
    if (light_tree->n <= 1)
        return (uint32_t)light_tree->n;
    return bounces > 0                      ? 1
           : light_tree->n <= LR_LIGHTS_ALL ? (uint32_t)light_tree->n
                                            : LR_LIGHTS_CHOSEN;
}

/* Whether these are all of them. */
LR_INLINE bool lr_light_tree_all(const lr_light_tree *light_tree, uint32_t bounces)
{
    return light_tree->n <= 1 || (bounces == 0 && light_tree->n <= LR_LIGHTS_ALL);
}

#endif
