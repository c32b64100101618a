/* Discrete rays through voxels that know their normals and the lights that they see.
 *
 * A pixel's ray becomes the discrete line of the traverser that draws such lines: by 26-connected
 * steps, and by 6-connected ones where surface is near. The first surface voxel on it is shaded by
 * what it stores: of its normal, its colour, and of each light a bit in place of a shadow ray. Of a
 * mirror part of the light comes by the reflected line, which begins one voxel out along the stored
 * normal and goes on the same way.
 *
 * Not exact: lines are up to half a voxel off their rays, reflected ones leave from centres of
 * voxels, and normals are quantised; edges of shadows are those of voxels.
 *
 * Source: Yagel, Cohen and Kaufman 1992; the lines are those of Kaufman and Shimony 1986.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "imaging/pixel_ray.h"
#include "imaging/stored_voxels.h"

enum { MOST_REFLECTIONS = 4 };

typedef struct discrete {
    lr_stored_voxels voxels; /* first, as all methods with LR_IMAGE_LIGHTS have it */
    double mirror;           /* share of the light that is reflected */
} discrete;

void lr_discrete_free(void *data)
{
    discrete *d = data;
    lr_free_stored(&d->voxels);
    free(d);
}

lr_status lr_discrete_prepare(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                              void **data, uint64_t *nbytes, lr_error *error)
{
    static const double mirror[] = {0.0, 0.25, 0.5, 1.0};
    discrete *d = calloc(1, sizeof *d);
    if (d == NULL)
        return lr_fail_memory(error, sizeof *d, "surface voxels");
    d->mirror = mirror[choices[0]];
    const lr_status status = lr_store_voxels(&d->voxels, v, watch, error);
    if (status != LR_OK) {
        lr_discrete_free(d);
        return status;
    }
    d->voxels.nbytes += sizeof *d;
    *nbytes = 0; /* voxels.nbytes, which lights change */
    *data = d;
    return LR_OK;
}

/* The voxel's own light, and of a mirror that which comes by reflected lines. to: the way the line
 * came, in object space. */
static void shade_path(const discrete *d, const int32_t hit[3], const double to[3],
                       double first_normal[3], double rgb[3], lr_counters *counters)
{
    const lr_stored_voxels *s = &d->voxels;
    double way[3] = {to[0], to[1], to[2]}, weight = 1.0;
    int32_t c[3] = {hit[0], hit[1], hit[2]}, from[3];
    for (int n = 0;; n++) {
        const uint32_t number = lr_stored_number(s, c);
        const bool last = d->mirror == 0.0 || n == MOST_REFLECTIONS;
        double normal[3], own[3], along[3];
        lr_stored_normal(s, number, normal);
        if (n == 0)
            memcpy(first_normal, normal, sizeof normal);
        lr_shade_voxel(s, number, c, normal, own);
        for (int a = 0; a < 3; a++)
            rgb[a] += weight * (1.0 - d->mirror) * own[a];
        const double cosine = lr_dot(normal, way);
        if (last || !(cosine < 0.0))
            return;
        for (int a = 0; a < 3; a++)
            way[a] -= 2.0 * cosine * normal[a];
        weight *= d->mirror;
        lr_discrete_line l;
        lr_voxel_outside(s->volume, c, normal, from);
        lr_map_vector(s->volume->storage_from_object, way, along);
        lr_line_along(&l, s->volume, from, along, false);
        counters->rays++;
        if (!lr_next_surface_on_line(s, &l, false, c, &counters->cells))
            return;
    }
}

/* Does the pixel's line hit a surface voxel? Then the cursor is on it. */
static bool hit_surface(const discrete *d, const lr_ray *r, lr_cursor *u, lr_counters *counters)
{
    int32_t c[3];
    lr_discrete_line l;
    lr_begin_line_of_ray(&l, r, u->c);
    return lr_next_surface_on_line(&d->voxels, &l, true, c, &counters->cells) &&
           lr_stand_on(r, u, c);
}

static void render_pixel(const discrete *d, const lr_view *view, int32_t x, int32_t y,
                         lr_counters *counters)
{
    const lr_image *image = view->image;
    const size_t at = lr_pixel_at(image, x, y);
    double o[3], way[3], normal[3] = {0.0, 0.0, 0.0}, rgb[3] = {0.0, 0.0, 0.0};
    lr_ray r;
    lr_cursor u;
    const lr_pixel_start start = lr_start_pixel(view, x, y, &r, &u);
    counters->rays++;
    if (start == LR_START_NOWHERE || (start == LR_START_AHEAD && !hit_surface(d, &r, &u, counters)))
        return;
    counters->hits++;
    lr_put_pixel(image, at, &u);
    if (start == LR_START_AHEAD) {
        lr_camera_ray(view->camera, image->x + x + 0.5, image->y + y + 0.5, o, way);
        shade_path(d, u.c, way, normal, rgb, counters);
    }
    if (image->normal != NULL)
        memcpy(image->normal + 3 * at, normal, sizeof normal);
    if (image->shade != NULL)
        memcpy(image->shade + 3 * at, rgb, sizeof rgb);
}

lr_status lr_discrete_render(const void *data, const lr_view *view, lr_counters *counters,
                             const lr_watch *watch, lr_error *error)
{
    const lr_image *image = view->image;
    for (int32_t y = 0; y < image->height; y++) {
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        lr_progress(watch, (double)y / image->height);
        for (int32_t x = 0; x < image->width; x++)
            render_pixel(data, view, x, y, counters);
    }
    return LR_OK;
}
