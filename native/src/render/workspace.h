/* The working memory of one tile: every array that the renderer writes beside
 * the passes, laid out in the caller's buffer.
 *
 * Pixels are rendered in stretches of at most LR_STRETCH; one sample of each
 * makes a wave. So memory depends neither on the size of the image nor on the
 * number of samples.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_WORKSPACE_H
#define LR_WORKSPACE_H

#include "render/scene.h"

/* Measured on one sphere, a thousand and a hundred thousand: 512 to 4096 differ by
 * less than a tenth. Small tiles of memory, batches that end soon. */
enum { LR_STRETCH = 1024 };

typedef struct lr_rays_buffer {
    double *ox, *oy, *oz, *dx, *dy, *dz;
} lr_rays_buffer;

/* Rays in world space and what they hit. */
typedef struct lr_wave {
    lr_rays_buffer ray;
    uint32_t *from;     /* the instance whose surface the ray leaves */
    lr_start *start;    /* where there */
    double *t;          /* of the nearest hit so far */
    uint32_t *instance; /* of that hit, or LR_NOWHERE */
    lr_hits hit;        /* in object space; its t is not used */
    lr_branch *stack;   /* [n][height]: what is left of each ray's walk */
    uint32_t *stacked;
} lr_wave;

/* The rays of one instance in its object space. */
typedef struct lr_batch {
    lr_rays_buffer ray;
    double *t_min, *t_max;
    lr_start *start;
    lr_hits hit;
} lr_batch;

/* Ray and instance that are to be traced. */
typedef struct lr_pair {
    uint32_t ray, instance;
} lr_pair;

/* A point of a surface that is to be lit. */
typedef struct lr_surfel {
    double position[3];
    double origin[3];    /* of rays of light */
    double normal[3];    /* unit, turned to the viewer's side */
    double color[3];     /* reflectance */
    uint32_t pixel;      /* of the stretch */
    uint32_t instance;
    int32_t object_index;
    lr_start start; /* of rays of light */
} lr_surfel;

typedef struct lr_workspace {
    lr_wave wave;
    lr_batch batch;
    lr_pair *pairs, *pairs_sorted;
    uint32_t *active; /* rays whose walk goes on */
    lr_surfel *surfels;
    uint32_t *lit;    /* the surfel of each ray of a wave of light */
    double *light;    /* what the ray brings: the cosine over the square of the distance */
    double (*sum)[4]; /* per pixel, over its samples */
    uint32_t *hash;   /* per pixel */
} lr_workspace;

/* Lay the arrays out from base, which may be NULL to ask for the size. Returns
 * the bytes used. */
uint64_t lr_workspace_lay(void *base, uint64_t n_pixels, uint32_t height, lr_workspace *workspace);

#endif
