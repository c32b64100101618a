/* From a hit to the point that is lit.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/surface.h"

#include "volume/affine.h"

/* To world space and to unit length. A vanishing gradient tells nothing: then the
 * surface faces the ray. */
static void world_normal(const lr_placed *placed, const double gradient[3], const double d[3],
                         double n[3])
{
    lr_map_gradient(placed->object_from_world, gradient, n);
    double length = sqrt(lr_dot(n, n));
    if (!(length > 0)) {
        for (int a = 0; a < 3; a++)
            n[a] = -d[a];
        length = sqrt(lr_dot(n, n));
    }
    for (int a = 0; a < 3; a++)
        n[a] /= length;
}

static void turn(double n[3])
{
    for (int a = 0; a < 3; a++)
        n[a] = -n[a];
}

void lr_surface_find(const lr_scene *scene, const lr_wave *wave, uint32_t i, lr_surfel *surfel)
{
    const lr_placed *placed = &scene->instances[wave->instance[i]];
    const lr_hits *hit = &wave->hit;
    const double o[3] = {wave->ray.ox[i], wave->ray.oy[i], wave->ray.oz[i]};
    const double d[3] = {wave->ray.dx[i], wave->ray.dy[i], wave->ray.dz[i]};
    const double normal[3] = {hit->nx[i], hit->ny[i], hit->nz[i]};
    const double geometric[3] = {hit->gx[i], hit->gy[i], hit->gz[i]};
    for (int a = 0; a < 3; a++)
        surfel->position[a] = o[a] + wave->t[i] * d[a];
    world_normal(placed, normal, d, surfel->normal);
    world_normal(placed, geometric, d, surfel->geometric);
    const bool inside = lr_dot(d, surfel->geometric) > 0;
    if (inside) {
        turn(surfel->normal);
        turn(surfel->geometric);
    }
    surfel->instance = wave->instance[i];
    surfel->start = (lr_start){{hit->ci[i], hit->cj[i], hit->ck[i]}, inside ? 1 : -1};
    const uint32_t id = (uint32_t)lr_max_i(hit->id[i], 0);
    const uint32_t last = placed->n_materials - 1;
    const uint32_t slot = placed->first_material + (id < last ? id : last);
    memcpy(surfel->color, scene->materials[scene->slots[slot]].base_color, sizeof surfel->color);
}
