/* The table of whole-image methods, and images rendered through it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "imaging/film_map.h"
#include "imaging/image_method.h"
#include "imaging/stored_voxels.h"
#include "trace/structure.h"

typedef struct ops {
    lr_status (*prepare)(const lr_volume *volume, const int32_t *choices, const lr_watch *watch,
                         void **data, uint64_t *nbytes, lr_error *error);
    void (*free)(void *data);
    lr_status (*render)(const void *data, const lr_view *view, lr_counters *counters,
                        const lr_watch *watch, lr_error *error);
} ops;

static const struct {
    lr_image_method about;
    ops ops;
} registry[] = {
#define LR_IMAGE_METHOD(name, label, source, about, options, flags)                                \
    {{#name, label, source, about, options, flags},                                                \
     {lr_##name##_prepare, lr_##name##_free, lr_##name##_render}},
#include "imaging/image_methods.def"
#undef LR_IMAGE_METHOD
};

enum { COUNT = sizeof registry / sizeof registry[0] };

struct lr_prepared {
    const lr_volume *volume;
    int32_t method;
    void *data;
    uint64_t nbytes;
};

int32_t lr_image_method_count(void)
{
    return COUNT;
}

static lr_status check_method(int32_t index, lr_error *error)
{
    if (index < 0 || index >= COUNT)
        return lr_fail(error, LR_E_ARGUMENT, "there is no image method %d; there are %d", index,
                       (int)COUNT);
    return LR_OK;
}

lr_status lr_image_method_get(int32_t index, lr_image_method *method, lr_error *error)
{
    const lr_status status = check_method(index, error);
    if (status == LR_OK)
        *method = registry[index].about;
    return status;
}

lr_status lr_prepare(const lr_volume *volume, int32_t method, const int32_t *choices,
                     const lr_watch *watch, lr_prepared **prepared, lr_error *error)
{
    int32_t chosen[LR_MAX_OPTIONS];
    lr_status status = check_method(method, error);
    if (status != LR_OK)
        return status;
    const lr_image_method *about = &registry[method].about;
    status = lr_check_choices(about->name, about->options, choices, chosen, error);
    if (status != LR_OK)
        return status;
    if (!volume->finished)
        return lr_fail(error, LR_E_ARGUMENT, "the volume is not finished");
    if (volume->planes[0] != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "image methods count on voxels of one size, and this volume is rectilinear");
    if (lr_is_cubic(volume))
        return lr_fail(error, LR_E_ARGUMENT,
                       "first object cells are those of the trilinear field, and this volume is "
                       "cubic");
    if (volume->transfer != NULL)
        return lr_fail(
            error, LR_E_ARGUMENT,
            "the volume has a transfer function in the place of a surface, and no object "
            "cells");
    lr_prepared *p = calloc(1, sizeof *p);
    if (p == NULL)
        return lr_fail_memory(error, sizeof *p, "what an image method needs");
    p->volume = volume;
    p->method = method;
    status = registry[method].ops.prepare(volume, chosen, watch, &p->data, &p->nbytes, error);
    if (status != LR_OK) {
        free(p);
        return status;
    }
    p->nbytes += sizeof *p;
    lr_progress(watch, 1.0);
    *prepared = p;
    return LR_OK;
}

void lr_prepared_free(lr_prepared *p)
{
    if (p == NULL)
        return;
    registry[p->method].ops.free(p->data);
    free(p);
}

/* What a method with LR_IMAGE_LIGHTS keeps; NULL of others. */
static lr_stored_voxels *stored(const lr_prepared *p)
{
    return registry[p->method].about.flags & LR_IMAGE_LIGHTS ? p->data : NULL;
}

uint64_t lr_prepared_nbytes(const lr_prepared *p)
{
    return p->nbytes + (stored(p) != NULL ? stored(p)->nbytes : 0);
}

lr_status lr_prepared_light(lr_prepared *p, int32_t index, const lr_image_light *light,
                            const lr_watch *watch, lr_error *error)
{
    if (stored(p) == NULL)
        return lr_fail(error, LR_E_ARGUMENT, "%s shades by depth and has no lights",
                       registry[p->method].about.name);
    return lr_store_light(stored(p), index, light, watch, error);
}

uint64_t lr_prepared_voxel_count(const lr_prepared *p)
{
    return stored(p) != NULL ? stored(p)->n : 0;
}

void lr_prepared_voxels(const lr_prepared *p, int32_t *cell, double *normal, double *color,
                        uint32_t *lit)
{
    if (stored(p) != NULL)
        lr_list_stored(stored(p), cell, normal, color, lit);
}

/* ---- images -------------------------------------------------------------- */

static lr_status check_camera(const lr_image_method *about, const lr_camera *c, lr_error *error)
{
    if (c->projection != LR_ORTHOGRAPHIC && c->projection != LR_PERSPECTIVE)
        return lr_fail(error, LR_E_ARGUMENT, "the camera's projection must be %d or %d, it is %d",
                       LR_PERSPECTIVE, LR_ORTHOGRAPHIC, c->projection);
    if (c->projection == LR_PERSPECTIVE && !(about->flags & LR_IMAGE_PERSPECTIVE))
        return lr_fail(error, LR_E_ARGUMENT,
                       "%s counts on parallel rays: the camera must be orthographic", about->name);
    if (c->projection == LR_PERSPECTIVE && !(c->clip_start >= 0.0))
        return lr_fail(error, LR_E_ARGUMENT,
                       "a perspective camera sees nothing behind it: it must clip from 0 or more, "
                       "it clips from %g",
                       c->clip_start);
    if (!(c->clip_start <= c->clip_end) || !isfinite(c->clip_start))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the camera must clip from a finite depth to a larger one, it clips from "
                       "%g to %g",
                       c->clip_start, c->clip_end);
    return LR_OK;
}

static lr_status check_image(const lr_image_method *about, const lr_image *image,
                             const lr_frame_before *before, lr_error *error)
{
    if (image->width < 1 || image->height < 1 || image->x < 0 || image->y < 0)
        return lr_fail(error, LR_E_ARGUMENT,
                       "an image needs pixels from 0 on; there are %d x %d from (%d, %d)",
                       image->width, image->height, image->x, image->y);
    if (image->normal != NULL && !(about->flags & LR_IMAGE_LIGHTS))
        return lr_fail(error, LR_E_ARGUMENT, "%s gives no normals", about->name);
    if ((image->empty != NULL || before != NULL) && !(about->flags & LR_IMAGE_FRAMES))
        return lr_fail(error, LR_E_ARGUMENT, "%s renders every frame by itself", about->name);
    if (before != NULL && (before->width < 1 || before->height < 1))
        return lr_fail(error, LR_E_ARGUMENT, "the frame before needs pixels; there are %d x %d",
                       before->width, before->height);
    return LR_OK;
}

/* false: stopped. */
static bool clear_image(const lr_image *image, const lr_watch *watch)
{
    const size_t n = (size_t)image->width;
    for (size_t row = 0; row < (size_t)image->height; row++) {
        if (lr_stopped(watch))
            return false;
        memset(image->pixel + row * n, LR_PIXEL_MISS, n);
        for (size_t i = row * n; i < (row + 1) * n; i++) {
            image->t[i] = INFINITY;
            for (size_t a = 0; a < 3; a++)
                image->cell[3 * i + a] = INT32_MIN;
        }
        if (image->shade != NULL)
            memset(image->shade + 3 * row * n, 0, 3 * n * sizeof *image->shade);
        if (image->normal != NULL)
            memset(image->normal + 3 * row * n, 0, 3 * n * sizeof *image->normal);
    }
    return true;
}

/* The nearer a hit, the brighter it is: from 1 at the nearest corner of the surface's box that the
 * camera does not cut off to 0 at the farthest. false: stopped. */
static bool shade_by_depth(const lr_view *view, const lr_watch *watch)
{
    const lr_image *image = view->image;
    const size_t n = (size_t)image->width;
    double range[2];
    lr_film_map map;
    lr_film_map_setup(&map, view->volume, view->camera, image);
    if (!lr_depth_range(&map, view->volume, range))
        return true;
    const double near = fmax(range[0], view->camera->clip_start);
    const double length = fmin(range[1], view->camera->clip_end) - near;
    for (size_t row = 0; row < (size_t)image->height; row++) {
        if (lr_stopped(watch))
            return false;
        for (size_t i = row * n; i < (row + 1) * n; i++) {
            const double depth = length > 0.0 ? (image->t[i] - near) / length : 0.0;
            for (size_t a = 0; a < 3 && image->pixel[i] == LR_PIXEL_HIT; a++)
                image->shade[3 * i + a] = lr_clamp(1.0 - depth, 0.0, 1.0);
        }
    }
    return true;
}

static void add_counters(lr_counters *to, const lr_counters *from)
{
    to->rays += from->rays;
    to->cells += from->cells;
    to->jumps += from->jumps;
    to->nodes += from->nodes;
    to->tests += from->tests;
    to->hits += from->hits;
}

lr_status lr_render_image(const lr_prepared *p, const lr_camera *camera,
                          const lr_frame_before *before, const lr_image *image,
                          lr_counters *counters, const lr_watch *watch, lr_error *error)
{
    const lr_image_method *about = &registry[p->method].about;
    const lr_view view = {p->volume, camera, before, image};
    lr_film_map map;
    lr_counters sum = {0};
    lr_status status = check_camera(about, camera, error);
    if (status == LR_OK)
        status = check_image(about, image, before, error);
    if (status != LR_OK)
        return status;
    if (!lr_film_map_setup(&map, p->volume, camera, image) ||
        (before != NULL && !lr_film_map_setup(&map, p->volume, &before->camera, image)))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the camera's dx and dy must span a film that its rays cross, by finite "
                       "numbers");
    if (!clear_image(image, watch))
        return lr_fail_stopped(error);
    status = registry[p->method].ops.render(p->data, &view, &sum, watch, error);
    if (status != LR_OK)
        return status;
    if (image->shade != NULL && !(about->flags & LR_IMAGE_LIGHTS) && !shade_by_depth(&view, watch))
        return lr_fail_stopped(error);
    lr_progress(watch, 1.0);
    if (counters != NULL)
        add_counters(counters, &sum);
    return LR_OK;
}
