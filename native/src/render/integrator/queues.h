/* The working memory of one tile: every array that the renderer writes beside
 * the passes, laid out in the caller's buffer.
 *
 * Pixels are rendered in stretches of at most LR_STRETCH; one sample of each
 * makes a first wave. What its rays spawn waits in a queue with a fixed number of
 * places per pixel. So memory depends neither on the size of the image nor on the
 * number of samples nor on the depth of recursion, and what is left out where the
 * queue is full depends on the pixel alone.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_QUEUES_H
#define LR_RENDER_INTEGRATOR_QUEUES_H

#include "render/film/pixel_filter.h"
#include "render/integrator/path_state.h"
#include "render/scene/scene.h"

enum {
    /* Measured on one sphere, a thousand and a hundred thousand: 512 to 4096 differ by
     * less than a tenth. Small tiles of memory, batches that end soon. */
    LR_STRETCH = 1024,
    LR_PARTS = 4 /* of a pixel's samples, for the estimate of its noise */
};

typedef struct lr_rays_buffer {
    double *ox, *oy, *oz, *dx, *dy, *dz;
} lr_rays_buffer;

LR_INLINE void lr_put_ray(lr_rays_buffer *rays, uint32_t i, const double o[3], const double d[3])
{
    rays->ox[i] = o[0];
    rays->oy[i] = o[1];
    rays->oz[i] = o[2];
    rays->dx[i] = d[0];
    rays->dy[i] = d[1];
    rays->dz[i] = d[2];
}

LR_INLINE void lr_get_ray(const lr_rays_buffer *rays, uint32_t i, double o[3], double d[3])
{
    o[0] = rays->ox[i];
    o[1] = rays->oy[i];
    o[2] = rays->oz[i];
    d[0] = rays->dx[i];
    d[1] = rays->dy[i];
    d[2] = rays->dz[i];
}

/* Rays in world space and what they hit. */
typedef struct lr_wave {
    lr_rays_buffer ray;
    uint32_t *from;       /* the instance whose surface the ray leaves */
    lr_start *start;      /* where there */
    uint32_t *visibility; /* instances with one of these flags count */
    double *t;            /* at first where the ray ends, then of the nearest hit so far */
    uint32_t *instance;   /* of that hit, or LR_NOWHERE */
    lr_hits hit;          /* in object space; its t is not used */
    lr_branch *stack;     /* [n][height]: what is left of each ray's walk */
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

/* A point of a surface that is to be lit and scatters. */
typedef struct lr_shading_point {
    lr_point point;
    double position[3];
    double origin[3]; /* of rays on the viewer's side */
    lr_start start;   /* in the cell of the hit, on the viewer's side */
    bool risen;       /* origin lies above the cell's own surface */
    bool lifts;       /* of a triangle with normals of its own: from position to the smooth
                         surface, */
    double lift[3];   /* for light that grazes the triangle */
    const lr_path *path;
    uint32_t ray; /* of the wave that found it */
    double left;  /* of the path's way */
    const lr_material *material;
    uint32_t instance, material_index;
    int32_t object_index;
    bool sure[LR_RAY_KINDS]; /* kinds that are followed, */
    bool chooses_one;        /* and one more of the others, chosen at random */
    double
        probability[LR_RAY_KINDS]; /* that rays of this kind are followed: 1 where that is sure */
    lr_bsdf bsdf;                  /* large, and mostly not used: so it comes last */
} lr_shading_point;

/* A ray towards a light. */
typedef struct lr_shadow_ray {
    double contribution[3]; /* to the pixel, unless something stops the ray */
    double ends;            /* distance to the light from where its ray is now */
    const lr_shading_point *shading_point;
    uint32_t clear; /* transparent surfaces that its path has passed */
    uint64_t event; /* its place in the record, where there is one */
} lr_shadow_ray;

/* The sums over a pixel's samples. */
typedef struct lr_sum {
    double part[LR_PARTS][3]; /* radiance */
    double alpha, mist, ao;
    double emission[3], environment[3];
} lr_sum;

/* Paths of one wave, some for every pixel: those of pixel p are n[p] at its
 * `branches` places. */
typedef struct lr_queue {
    lr_path *paths;
    uint32_t *n;
} lr_queue;

typedef struct lr_workspace {
    lr_wave wave;
    lr_batch batch;
    lr_pair *pairs, *pairs_sorted;
    uint32_t *active; /* rays whose walk goes on */
    uint32_t room;    /* rays in a wave */
    lr_queue now, next;
    uint32_t *free_slots; /* per pixel, places of the next queue that no path of this one needs */
    lr_path **traced;     /* the path of each ray of a wave */
    lr_shading_point *shading_points;
    lr_shadow_ray *shadow_rays;
    lr_medium_stack *shadow_media; /* of each shadow ray's ray */
    uint32_t *carried;             /* the shadow ray of each ray of a wave */
    lr_sum *pixels;
    uint32_t *hash;    /* per pixel */
    uint32_t *sampled; /* per pixel, how often */
    bool *settled;     /* per pixel, whether it wants no more */
    double *filter;    /* offsets from the pixel's centre by the integral of the filter */
} lr_workspace;

/* Lay the arrays out from base, which may be NULL to ask for the size. Returns
 * the bytes used. */
uint64_t lr_workspace_lay(void *base, uint64_t n_pixels, uint32_t branches, uint32_t height,
                          lr_workspace *workspace);

#endif
