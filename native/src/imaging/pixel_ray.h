/* The ray through the centre of a pixel, up to where it enters the box of the surface cells.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_IMAGING_PIXEL_RAY_H
#define LR_IMAGING_PIXEL_RAY_H

#include "imaging/image_method.h"
#include "render/film/camera.h"
#include "trace/traverser.h"

typedef enum lr_pixel_start {
    LR_START_NOWHERE, /* it misses the box */
    LR_START_AHEAD,   /* the cursor is in the first cell of the box */
    LR_START_INSIDE,  /* it starts in an object cell, in which the cursor is: a hit */
} lr_pixel_start;

/* Set up the ray of pixel (x, y) of the image; the same bits as lr_trace has for it. */
LR_INLINE bool lr_pixel_ray(const lr_view *view, int32_t x, int32_t y, lr_ray *r)
{
    double o[3], d[3];
    lr_camera_ray(view->camera, view->image->x + x + 0.5, view->image->y + y + 0.5, o, d);
    return lr_ray_setup(r, view->volume, o, d, view->camera->clip_end);
}

LR_INLINE lr_pixel_start lr_start_pixel(const lr_view *view, int32_t x, int32_t y, lr_ray *r,
                                        lr_cursor *u)
{
    const lr_volume *v = view->volume;
    const double t_min = view->camera->clip_start;
    if (!lr_pixel_ray(view, x, y, r))
        return LR_START_NOWHERE;
    if (lr_starts_inside(v, r, LR_REGULAR, t_min, u))
        return LR_START_INSIDE;
    return lr_enter(r, LR_REGULAR, u, v->surface_lo, v->surface_hi, t_min) ? LR_START_AHEAD
                                                                           : LR_START_NOWHERE;
}

/* The number of a pixel of the image. */
LR_INLINE size_t lr_pixel_at(const lr_image *image, int32_t x, int32_t y)
{
    return (size_t)y * (size_t)image->width + (size_t)x;
}

/* Write a hit: the cursor is in the cell. */
LR_INLINE void lr_put_pixel(const lr_image *image, size_t at, const lr_cursor *u)
{
    image->pixel[at] = LR_PIXEL_HIT;
    image->t[at] = u->t;
    for (size_t a = 0; a < 3; a++)
        image->cell[3 * at + a] = u->c[a] - LR_PAD;
}

/* Would a walk cell by cell, from the cursor on, come through storage cell c? Then *at is as in
 * that walk. It comes through c if it crosses the last plane into c before the first plane out of
 * it, by (t, axis) as lr_step orders them. */
LR_INLINE bool lr_passes_cell(const lr_ray *r, const lr_cursor *u, const int32_t c[3],
                              lr_cursor *at)
{
    double in = -INFINITY, out = INFINITY;
    int into = -1, out_of = 3;
    for (int a = 0; a < 3; a++) {
        if ((c[a] - u->c[a]) * r->s[a] < 0 || (r->s[a] == 0 && c[a] != u->c[a]))
            return false;
        const double t_out = lr_plane_t(r, LR_REGULAR, a, c[a] + (r->s[a] > 0));
        if (t_out < out) {
            out = t_out;
            out_of = a;
        }
        if (c[a] == u->c[a])
            continue;
        const double t_in = lr_plane_t(r, LR_REGULAR, a, c[a] + (r->s[a] < 0));
        if (t_in >= in) {
            in = t_in;
            into = a;
        }
    }
    if (into >= 0 && !((in < out || (in == out && into <= out_of)) && in <= r->t_max))
        return false;
    *at = (lr_cursor){{c[0], c[1], c[2]}, into >= 0 ? into : u->axis, in > u->t ? in : u->t};
    return true;
}

#endif
