/* From points in storage space to film coordinates and depth.
 *
 * A camera's ray is eye + t (corner + x dx + y dy), or eye + corner + x dx + y dy + t forward: in
 * both cases a point minus some base is a sum of three vectors, whose factors are t, x and y, or t,
 * t x and t y in perspective. Each of them is an affine function of the point.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_IMAGING_FILM_MAP_H
#define LR_IMAGING_FILM_MAP_H

#include "base/affine.h"
#include "grid/brick_grid.h"

typedef struct lr_film_map {
    bool perspective;
    double base[3];    /* of storage space */
    double side[3][3]; /* the three vectors, of t, x and y: rays, but not to the bit */
    double row[3][3]; /* of a point minus base: t, then x and y, of which perspective has t times */
    double error[3];  /* bounds of the error of each, for points of the volume and all rays */
} lr_film_map;

/* One of the factors, see above, of a storage point. */
LR_INLINE double lr_film_factor(const lr_film_map *m, int i, const double p[3])
{
    double q[3];
    lr_sub(p, m->base, q);
    return lr_dot(m->row[i], q);
}

/* How far from the storage origin points lie that the camera or the volume can name. */
LR_INLINE double lr_extent_of(const lr_volume *v, const lr_camera *camera, const lr_image *image)
{
    const double width = (double)image->x + image->width, height = (double)image->y + image->height;
    double most = 0.0;
    for (int a = 0; a < 3 && most == most; a++) {
        const double *row = v->storage_from_object + 4 * a;
        double sum = fabs(row[3]) + LR_SIDE * (double)v->table_size[a];
        for (int b = 0; b < 3; b++)
            sum += fabs(row[b]) * (fabs(camera->eye[b]) + fabs(camera->corner[b]) +
                                   width * fabs(camera->dx[b]) + height * fabs(camera->dy[b]));
        most = most >= sum ? most : sum; /* NaN, once there, stays */
    }
    return most;
}

/* false: the film has no area, its rays lie in it, or numbers overflow. */
LR_INLINE bool lr_film_map_setup(lr_film_map *m, const lr_volume *v, const lr_camera *camera,
                                 const lr_image *image)
{
    double base[3], length[3];
    m->perspective = camera->projection == LR_PERSPECTIVE;
    for (int a = 0; a < 3; a++)
        base[a] = camera->eye[a] + (m->perspective ? 0.0 : camera->corner[a]);
    lr_map_point(v->storage_from_object, base, m->base);
    lr_map_vector(v->storage_from_object, m->perspective ? camera->corner : camera->forward,
                  m->side[0]);
    lr_map_vector(v->storage_from_object, camera->dx, m->side[1]);
    lr_map_vector(v->storage_from_object, camera->dy, m->side[2]);
    for (int i = 0; i < 3; i++) {
        length[i] = sqrt(lr_dot(m->side[i], m->side[i]));
        lr_cross_product(m->side[(i + 1) % 3], m->side[(i + 2) % 3], m->row[i]);
    }
    const double det = lr_dot(m->side[0], m->row[0]);
    /* Each factor is a triple product by det; all its roundings are below 2^-49 of the product of
     * lengths, and those of rays, their planes and the maps of points likewise. */
    const double extent = lr_extent_of(v, camera, image);
    for (int i = 0; i < 3; i++) {
        m->error[i] = 0x1p-46 * extent * length[(i + 1) % 3] * length[(i + 2) % 3] / fabs(det);
        for (int a = 0; a < 3; a++)
            m->row[i][a] /= det;
    }
    /* 1e-9: film and rays that are so nearly flat are taken for a mistake. */
    return fabs(det) > 1e-9 * length[0] * length[1] * length[2] && isfinite(det) &&
           lr_all_finite(m->row[0], 9) && lr_all_finite(m->error, 3);
}

/* Between which depths the box of the surface cells lies; false where it is empty. */
LR_INLINE bool lr_depth_range(const lr_film_map *m, const lr_volume *v, double range[2])
{
    if (v->n_surface_cells == 0)
        return false;
    range[0] = INFINITY;
    range[1] = -INFINITY;
    for (int n = 0; n < 8; n++) {
        double p[3];
        for (int a = 0; a < 3; a++)
            p[a] = n >> a & 1 ? v->surface_hi[a] + 1.0 : v->surface_lo[a];
        const double t = lr_film_factor(m, 0, p);
        range[0] = fmin(range[0], t);
        range[1] = fmax(range[1], t);
    }
    return true;
}

#endif
