/* A path: its present ray, and the throughput of the surfaces and volumes behind it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_PATH_STATE_H
#define LR_RENDER_INTEGRATOR_PATH_STATE_H

#include "render/bsdf/bsdf.h"

/* More nested solids than this are rare; the outermost are dropped, and counted. */
enum { LR_MEDIA_MAX = 6, LR_RAY_KINDS = LR_RAY_VOLUME + 1 };

/* Bounds of what has no surface that light passes on its way, at most; as in Cycles. */
enum { LR_BOUNDS_MAX = 1024 };

/* The visibility flag of instances and lights for rays of a kind. */
LR_INLINE uint32_t lr_sees(int kind)
{
    static const uint32_t flag[LR_RAY_KINDS] = {
        LR_VISIBLE_CAMERA,        LR_VISIBLE_DIFFUSE, LR_VISIBLE_GLOSSY, LR_VISIBLE_TRANSMISSION, 0,
        LR_VISIBLE_VOLUME_SCATTER};
    return flag[kind];
}

/* The solids that a ray is in, the last one entered at the end. */
typedef struct lr_medium_stack {
    uint32_t n;
    uint32_t instance[LR_MEDIA_MAX], material[LR_MEDIA_MAX];
} lr_medium_stack;

typedef struct lr_path {
    double origin[3];
    double direction[3]; /* unit, but for the camera's, whose t is depth */
    double throughput[3];
    double pdf; /* density of its direction where it was scattered last, times the probability of
                   its kind of ray; infinite where light samples cannot find the same */
    float normal[3];  /* of that surface; 0 where both sides are lit */
    double travelled; /* since then, through transparent surfaces */
    double t_max;
    uint32_t from; /* the instance whose surface it leaves, or LR_NOWHERE, */
    lr_start start;
    double way[3];                  /* there, see lr_shading_point */
    uint32_t pixel;                 /* of the stretch */
    uint32_t key;                   /* of its choices */
    uint32_t sample;                /* of the sequences that they are made by */
    uint32_t visibility;            /* instances with this flag count */
    uint16_t bounds;                /* of what has no surface, that it has passed */
    uint16_t bounces[LR_RAY_KINDS]; /* so far, per lr_ray_kind; [LR_RAY_CAMERA] is their sum without
                                       the transparent ones */
    bool seen;                      /* by the camera, at most through transparent surfaces */
    bool primary;                   /* from the camera on, but for what has no surface */
    bool last;                      /* beyond a limit: it may hit lights, but is not scattered */
    lr_medium_stack media;
} lr_path;

#endif
