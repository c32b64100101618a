/* From a hit to the point that is lit.
 *
 * The trilinear surface of a curved object is made of facets as large as cells,
 * which touch the smooth surface of the normals at their corners and lie below it
 * between them. Light that grazes the smooth surface would be stopped by the
 * facets: the terminator would have steps. So rays of light start from the smooth
 * surface, where that is above the facet. Its height follows from the second
 * differences of the samples, the first term of what linear interpolation leaves
 * out; flat surfaces have none, and there the ray starts in the very cell and on
 * the very side of the hit.
 *
 * Source: the idea is that of Hanika, Hacking the shadow terminator, 2021 (for
 * triangles with normals of their own). Departure: the samples know the smooth
 * surface itself.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/surface.h"

#include "trace/structure.h"
#include "volume/affine.h"
#include "volume/field.h"

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

/* A sphere of one voxel's radius rises 1/4 voxel over its facets; nothing that
 * samples can tell is more curved. Below 2^-20 voxel rounding has a say. */
static const double RISE_MAX = 0.25, RISE_MIN = 0x1p-20;

/* What linear interpolation leaves out of f at p in storage cell c, and the
 * gradient of f there, in storage space. */
static double remainder_at(const lr_volume *v, const int32_t c[3], const double p[3], double g[3])
{
    double b[64], sum = 0;
    const int stride[3] = {1, 4, 16};
    lr_block(v, c[0] - 1, c[1] - 1, c[2] - 1, 4, b);
    for (int a = 0; a < 3; a++) {
        double corner[8];
        for (int n = 0; n < 8; n++) {
            const double *at = b + 21 + (n & 1) + 4 * (n >> 1 & 1) + 16 * (n >> 2);
            corner[n] = at[stride[a]] - 2 * at[0] + at[-stride[a]];
        }
        sum -= 0.5 * p[a] * (1 - p[a]) * lr_trilinear(corner, p);
    }
    const double cell[8] = {b[21], b[22], b[25], b[26], b[37], b[38], b[41], b[42]};
    lr_trilinear_gradient(cell, p, g);
    return sum;
}

/* From the hit to the smooth surface above it, in world space; false where that
 * is not above. */
static bool rise(const lr_placed *placed, const lr_surfel *s, double offset[3])
{
    const lr_volume *v = lr_structure_volume(placed->structure);
    double object[3], p[3], g[3], g_object[3], g_world[3];
    int32_t c[3];
    lr_map_point(placed->object_from_world, s->position, object);
    lr_map_point(v->storage_from_object, object, p);
    for (int a = 0; a < 3; a++) {
        c[a] = s->start.cell[a] + LR_PAD;
        p[a] = lr_clamp(p[a] - c[a], 0, 1);
    }
    const double left_out = remainder_at(v, c, p, g);
    const double slope = sqrt(lr_dot(g, g));
    lr_map_gradient(v->storage_from_object, g, g_object);
    lr_map_gradient(placed->object_from_world, g_object, g_world);
    const double share =
        lr_clamp(left_out, -RISE_MAX * slope, RISE_MAX * slope) / lr_dot(g_world, g_world);
    for (int a = 0; a < 3; a++)
        offset[a] = -share * g_world[a];
    return fabs(left_out) > RISE_MIN * slope && lr_dot(offset, s->normal) > 0;
}

void lr_surface_find(const lr_scene *scene, const lr_wave *wave, uint32_t i, lr_surfel *surfel)
{
    const lr_placed *placed = &scene->instances[wave->instance[i]];
    const lr_hits *hit = &wave->hit;
    const double o[3] = {wave->ray.ox[i], wave->ray.oy[i], wave->ray.oz[i]};
    const double d[3] = {wave->ray.dx[i], wave->ray.dy[i], wave->ray.dz[i]};
    const double normal[3] = {hit->nx[i], hit->ny[i], hit->nz[i]};
    const double field_normal[3] = {hit->gx[i], hit->gy[i], hit->gz[i]};
    double facing[3];
    for (int a = 0; a < 3; a++)
        surfel->position[a] = o[a] + wave->t[i] * d[a];
    world_normal(placed, normal, d, surfel->normal);
    world_normal(placed, field_normal, d, facing);
    const bool inside = lr_dot(d, facing) > 0;
    if (inside)
        for (int a = 0; a < 3; a++)
            surfel->normal[a] = -surfel->normal[a];
    surfel->instance = wave->instance[i];
    surfel->start = (lr_start){{hit->ci[i], hit->cj[i], hit->ck[i]}, inside ? 1 : -1};
    double offset[3];
    memcpy(surfel->origin, surfel->position, sizeof surfel->origin);
    if (rise(placed, surfel, offset)) {
        for (int a = 0; a < 3; a++)
            surfel->origin[a] += offset[a];
        surfel->start.side = 0;
    }
    const uint32_t id = (uint32_t)lr_max_i(hit->id[i], 0);
    const uint32_t last = placed->n_materials - 1;
    const uint32_t slot = placed->first_material + (id < last ? id : last);
    surfel->object_index =
        scene->slot_objects != NULL ? scene->slot_objects[slot] : placed->object_index;
    const lr_material *material = &scene->materials[scene->slots[slot]];
    memset(surfel->color, 0, sizeof surfel->color);
    if (material->n_lobes > 0)
        memcpy(surfel->color, material->lobes[0].color, sizeof surfel->color);
}
