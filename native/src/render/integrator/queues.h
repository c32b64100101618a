/* The queues between the stages of a tile, laid out in the caller's buffer.
 *
 * Pixels are rendered in ranges of at most LR_STRETCH; one sample of each makes a first
 * wave. The rays that it spawns are queued, with a fixed number of slots per pixel. So
 * memory does not depend on the size of the image, the number of samples or bounces, and
 * what is left out where slots are full depends on the pixel alone.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_QUEUES_H
#define LR_RENDER_INTEGRATOR_QUEUES_H

#include "base/arena.h"
#include "render/integrator/path_state.h"
#include "render/scene/scene.h"

enum {
    /* Measured on samples, cores with 1 MiB of cache: twice as many take 3 to 5 % more in most, as
     * queues no longer fit; half as many differ by 2 %. */
    LR_STRETCH = 1 << 9
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

/* Rays in world space that are traced together. */
typedef struct lr_ray_queue {
    uint32_t n, capacity;
    lr_rays_buffer ray;
    double *t_max;
    uint32_t *from;       /* the instance whose surface the ray leaves */
    lr_start *start;      /* where there */
    double (*way)[3];     /* see lr_shading_point; NaN: not known */
    uint32_t *visibility; /* instances with one of these flags count */
    uint32_t *owner;      /* place of its path, shadow ray or shading point in their queue */
} lr_ray_queue;

/* Aim ray i. */
LR_INLINE void lr_aim(lr_ray_queue *rays, uint32_t i, const double o[3], const double d[3],
                      double t_max)
{
    lr_put_ray(&rays->ray, i, o, d);
    rays->t_max[i] = t_max;
}

/* Their hits. */
typedef struct lr_hit_queue {
    double *t;          /* where the ray ends if nothing is hit */
    uint32_t *instance; /* or LR_NOWHERE */
    lr_hits hit;        /* in object space; its t is not used */
} lr_hit_queue;

/* The rays of one instance in its object space. */
typedef struct lr_batch {
    uint32_t capacity;
    lr_rays_buffer ray;
    double *t_min, *t_max;
    double *length;   /* of its direction, as extinction counts */
    double *stop;     /* transmittance at which it ends */
    double *t_passed; /* where it starts on the wave's ray, in an instance that is cut */
    lr_start *start;
    double (*way)[3];
    lr_hits hit;
} lr_batch;

/* A batch for lr_trace, all of each ray from t = 0 to its end. */
LR_INLINE lr_rays lr_rays_of(const lr_batch *batch)
{
    const lr_rays_buffer *ray = &batch->ray;
    return (lr_rays){.ox = ray->ox,
                     .oy = ray->oy,
                     .oz = ray->oz,
                     .dx = ray->dx,
                     .dy = ray->dy,
                     .dz = ray->dz,
                     .t_max = batch->t_max};
}

/* Ray and instance that are to be traced. */
typedef struct lr_pair {
    uint32_t ray, instance;
} lr_pair;

/* Further memory of the search for hits. */
typedef struct lr_intersect_memory {
    lr_branch *stack; /* [n][scene->n_branches]: what each ray has still to visit */
    uint32_t *stacked;
    uint32_t *active; /* rays that are not done */
    lr_pair *pairs, *pairs_sorted;
    lr_batch batch;
} lr_intersect_memory;

/* What participating instances add to each ray before its end, and leave of what lies behind. */
typedef struct lr_volume_light {
    double (*color)[3];
    double *transmittance;
    uint32_t *n_met;  /* instances of which there is something along it */
    uint32_t *ray_of; /* of those in the batch */
} lr_volume_light;

/* In place of a participating instance: the medium that the ray is in. */
#define LR_IN_MEDIUM (LR_NOWHERE - 1)

/* Where volumes scatter each ray before its end: one of those that it meets, chosen by what it
 * extinguishes. */
typedef struct lr_volume_scatter {
    double (*u)[2];  /* 0..1: by which the place and the volume are chosen; below 0: none is */
    double *opacity; /* of the volumes that scatter, added up, */
    double *own;     /* and of the one that is chosen: */
    uint32_t *participant; /* its number, LR_IN_MEDIUM or LR_NOWHERE */
    uint32_t *medium;      /* which of the ray's medium stack, if it is chosen */
    double *t;             /* infinity: nowhere */
    double (*albedo)[3];   /* there */
} lr_volume_scatter;

typedef struct lr_wave {
    lr_ray_queue rays;
    lr_hit_queue hits;
    lr_intersect_memory memory;
    lr_volume_light volume_light;
    lr_volume_scatter volume_scatter; /* of a scene that scatters, as all of that name */
} lr_wave;

/* A shading point, of a surface or within a volume. */
typedef struct lr_shading_point {
    lr_point point;
    double position[3];
    double origin[3];  /* of rays on the viewer's side */
    lr_start start;    /* in the cell of the hit, on the viewer's side */
    double way[2][3];  /* by which rays on that side, and beyond, get clear of triangles there, see
                          lr_ways_to_sides; NaN: not known */
    bool is_offset;    /* origin lies above the cell's own surface */
    uint32_t triangle; /* that was hit, or LR_NO_TRIANGLE */
    const lr_path *path;
    double t;    /* of the path's ray */
    double left; /* of the path's length */
    const lr_material *material;
    uint32_t instance, material_index;
    int32_t object_index;
    bool sure[LR_RAY_KINDS];          /* kinds that are all continued, */
    bool chooses_one;                 /* and one more of the others, chosen at random */
    double probability[LR_RAY_KINDS]; /* that rays of this kind are continued: 1 where sure */
    double share;     /* part of it that is left by a volume before the surface; 1: all, */
    bool gives_way;   /* nothing: its rays are continued, and none of these */
    bool in_volume;   /* no surface: of the members above only position, origin, the path, the
                         instance and its indices, and what decides on rays, hold */
    lr_hybrid hybrid; /* of light in a volume, with the bsdf where a share of it is a surface's */
    lr_bsdf bsdf;     /* whose closures are in the queue */
} lr_shading_point;

/* A ray towards a light. */
typedef struct lr_shadow_ray {
    double contribution[3]; /* to the pixel, unless something stops the ray */
    double ends;            /* distance to the light from where its ray is now */
    const lr_shading_point *shading_point;
    uint32_t clear;  /* transparent surfaces that its path has passed, */
    uint32_t bounds; /* and bounds of what has no surface */
    uint64_t event;  /* its place in the record, where there is one */
} lr_shadow_ray;

/* A point in a volume that scatters light. */
typedef struct lr_volume_point {
    lr_path path;   /* as it gets there, from its last point of a surface or a volume */
    uint32_t owner; /* place of the path that goes on behind it */
    uint32_t instance;
    lr_phase phase;
    double t;           /* of the wave's ray */
    double color[3];    /* of what it scatters, beside the throughput */
    double probability; /* that its ray is continued, */
    bool continues;     /* as is the case */
} lr_volume_point;

typedef struct lr_volume_queue {
    uint32_t n;
    lr_volume_point *points;
} lr_volume_queue;

typedef struct lr_shading_queue {
    uint32_t n, n_closures;
    lr_shading_point *points;
    lr_closure *closures; /* of one point after the other; most have few */
} lr_shading_queue;

/* The next point of the queue, to be found and then kept or not. */
LR_INLINE lr_shading_point *lr_next_point(const lr_shading_queue *queue)
{
    lr_shading_point *s = &queue->points[queue->n];
    s->bsdf.closures = queue->closures + queue->n_closures;
    return s;
}

LR_INLINE void lr_keep_point(lr_shading_queue *queue)
{
    queue->n_closures += queue->points[queue->n++].bsdf.n;
}

typedef struct lr_shadow_queue {
    uint32_t n, capacity;
    lr_shadow_ray *rays;
    lr_medium_stack *media; /* that each ray is in */
} lr_shadow_queue;

/* Paths of one wave, some for every pixel: those of pixel p are the first n[p] of its slots. */
typedef struct lr_path_queue {
    uint32_t slots; /* per pixel */
    lr_path *paths; /* [pixels][slots] */
    uint32_t *n;
    uint32_t *free_slots; /* per pixel: those that no path of the previous queue needs */
} lr_path_queue;

/* The first slot of a pixel. */
LR_INLINE size_t lr_slot_of(const lr_path_queue *queue, uint32_t pixel)
{
    return (size_t)pixel * queue->slots;
}

typedef struct lr_queues {
    lr_path_queue now, next;
    lr_wave wave;
    lr_shading_queue shading_points;
    lr_volume_queue volume_points;
    lr_shadow_queue shadow_rays;
} lr_queues;

/* Lay the queues of a scene out for that many pixels and paths of each; where volumes scatter, of
 * one more. */
void lr_queues_lay(lr_arena *arena, uint64_t n_pixels, uint32_t paths_per_pixel,
                   const lr_scene *scene, lr_queues *queues);

#endif
