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
 * So it is with triangles that carry normals: each corner's normal has a plane, the hit is
 * moved onto these planes where it lies below, and what comes of it is mixed as the normals
 * are. There only light that grazes the triangle starts from the smooth surface, the more so
 * the more it grazes, as in Cycles: triangles may be large.
 *
 * Source: Hanika, Hacking the shadow terminator, 2021 (for triangles). Departure: of the
 * field the samples know the smooth surface itself.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/shading_point.h"

#include "base/affine.h"
#include "grid/attributes/attributes.h"
#include "grid/triangle_cells.h"
#include "grid/trilinear.h"
#include "grid/value_gradient.h"
#include "render/integrator/medium_stack.h"
#include "trace/start_side.h"
#include "trace/structure.h"

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
static const double OFFSET_MAX = 0.25, OFFSET_MIN = 0x1p-20;

/* What linear interpolation leaves out of f at p in storage cell c, and the
 * gradient of f there, in storage space. */
static double second_difference_height(const lr_volume *v, int32_t object, const int32_t c[3],
                                       const double p[3], double g[3])
{
    double b[64], sum = 0;
    const int stride[3] = {1, 4, 16};
    lr_block_of(v, object, c[0] - 1, c[1] - 1, c[2] - 1, 4, b);
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

/* Where the hit lies: its storage cell, q in storage space, and the place p in its cell. */
static void locate(const lr_placed *placed, const lr_shading_point *s, int32_t c[3], double q[3],
                   double p[3])
{
    const lr_volume *v = lr_structure_volume(placed->structure);
    double object[3];
    for (int a = 0; a < 3; a++)
        c[a] = s->start.cell[a] + LR_PAD;
    lr_map_point(placed->object_from_world, s->position, object);
    lr_map_point(v->storage_from_object, object, q);
    for (int a = 0; a < 3; a++)
        p[a] = lr_clamp(q[a] - c[a], 0, 1);
}

/* The ways of rays to both sides, from q in storage cell c; NaN where none of them needs one. */
static void find_ways(const lr_volume *v, const int32_t c[3], const double q[3], bool leaves,
                      lr_shading_point *s)
{
    if (leaves && !s->is_offset && v->triangle_cells != NULL && lr_is_triangle_cell(v, c))
        lr_ways_to_sides(v, c, s->start.side, q, s->way);
    else
        s->way[0][0] = s->way[1][0] = NAN;
}

/* From the hit, at p of storage cell c, to the smooth surface above it, in world
 * space; false where that is not above. Hits on triangles have smooth_offset. A hit in a triangle
 * cell lies on a triangle, which is no facet of anything smoother that the samples know; nor are
 * those beside it, where second differences reach over a crease. That of a cubic field is smooth
 * itself. */
static bool terminator_offset(const lr_placed *placed, const lr_shading_point *s, int32_t id,
                              const int32_t c[3], const double p[3], double offset[3])
{
    const lr_volume *v = lr_structure_volume(placed->structure);
    double g[3], g_object[3], g_world[3];
    if (s->triangle != LR_NO_TRIANGLE || lr_is_cubic(v) || lr_near_doubt(v, c))
        return false;
    const double left_out = second_difference_height(v, lr_object_of(v, id), c, p, g);
    const double slope = sqrt(lr_dot(g, g));
    lr_map_gradient(v->storage_from_object, g, g_object);
    lr_map_gradient(placed->object_from_world, g_object, g_world);
    const double scale =
        lr_clamp(left_out, -OFFSET_MAX * slope, OFFSET_MAX * slope) / lr_dot(g_world, g_world);
    for (int a = 0; a < 3; a++)
        offset[a] = -scale * g_world[a];
    return fabs(left_out) > OFFSET_MIN * slope && lr_dot(offset, s->point.facing) > 0;
}

/* The same for a hit on a triangle that carries normals. */
static bool smooth_offset(const lr_placed *placed, const lr_shading_point *s, double offset[3])
{
    lr_smooth_triangle t;
    double side = 0, q[3], p[3];
    int32_t c[3];
    if (s->triangle == LR_NO_TRIANGLE)
        return false;
    memset(offset, 0, 3 * sizeof *offset);
    locate(placed, s, c, q, p);
    if (!lr_volume_smooth_triangle(lr_structure_volume(placed->structure), c, p, s->triangle, &t))
        return false;
    for (int b = 0; b < 3; b++) {
        double corner[3], normal[3], below = 0, length2 = 0;
        lr_map_point(placed->world_from_object, t.corner[b], corner);
        lr_map_gradient(placed->object_from_world, t.normal[b], normal);
        side += t.at[b] * lr_dot(normal, s->point.facing);
        for (int a = 0; a < 3; a++) {
            below += (corner[a] - s->position[a]) * normal[a];
            length2 += normal[a] * normal[a];
        }
        t.corner[b][0] = below / length2; /* how far, in its normals */
        memcpy(t.normal[b], normal, sizeof normal);
    }
    for (int b = 0; b < 3; b++)
        for (int a = 0; a < 3; a++)
            if ((t.corner[b][0] > 0) == (side > 0))
                offset[a] += t.at[b] * t.corner[b][0] * t.normal[b][a];
    return lr_dot(offset, s->point.facing) > 0;
}

/* Indices of refraction on the viewer's side over that on the far side. Where
 * the viewer is inside, the solid is left, else entered. */
static double eta(const lr_scene *scene, const lr_shading_point *s, const lr_medium_stack *media)
{
    const bool solid = scene->instances[s->instance].enterable;
    lr_medium_stack beyond = *media;
    if (s->point.inside && solid) {
        lr_medium_stack_leave(&beyond, s->instance);
        const bool known = beyond.n < media->n;
        return (known ? lr_medium_stack_ior(scene, media) : s->material->ior) /
               lr_medium_stack_ior(scene, &beyond);
    }
    const double around = lr_medium_stack_ior(scene, &beyond);
    return s->point.inside ? s->material->ior / around : around / s->material->ior;
}

void lr_surface_find(const lr_scene *scene, const lr_ray_queue *rays, const lr_hit_queue *hits,
                     uint32_t i, const lr_medium_stack *media, bool leaves,
                     lr_shading_point *shading_point)
{
    const lr_placed *placed = &scene->instances[hits->instance[i]];
    const lr_hits *hit = &hits->hit;
    lr_point *point = &shading_point->point;
    double o[3], d[3];
    lr_get_ray(&rays->ray, i, o, d);
    const double normal[3] = {hit->nx[i], hit->ny[i], hit->nz[i]};
    const double field_normal[3] = {hit->gx[i], hit->gy[i], hit->gz[i]};
    const double length = sqrt(lr_dot(d, d));
    shading_point->t = hits->t[i];
    shading_point->share = 1;
    shading_point->gives_way = shading_point->in_volume = false;
    for (int a = 0; a < 3; a++) {
        shading_point->position[a] = o[a] + shading_point->t * d[a];
        point->view[a] = -d[a] / length;
        point->color[a] = 1;
    }
    world_normal(placed, normal, d, point->normal);
    world_normal(placed, field_normal, d, point->facing);
    point->inside = lr_dot(d, point->facing) > 0;
    if (point->inside)
        for (int a = 0; a < 3; a++) {
            point->normal[a] = -point->normal[a];
            point->facing[a] = -point->facing[a];
        }
    shading_point->instance = hits->instance[i];
    shading_point->triangle = hit->triangle[i];
    shading_point->start = (lr_start){{hit->ci[i], hit->cj[i], hit->ck[i]}, point->inside ? 1 : -1};
    const lr_volume *volume = lr_structure_volume(placed->structure);
    double offset[3], q[3], p[3];
    int32_t c[3];
    point->bends = hit->triangle[i] != LR_NO_TRIANGLE || lr_carries_normals(volume);
    if (!point->bends && !(lr_dot(point->normal, point->view) > 0)) /* at the rim of the field */
        memcpy(point->normal, point->facing, sizeof point->normal);
    locate(placed, shading_point, c, q, p);
    int32_t id = hit->id[i];
    if (placed->color.program != NULL)
        lr_field_color_at(&placed->color, shading_point->position, point->color);
    else if (placed->color.volume != NULL)
        id = lr_field_id_at(&placed->color, shading_point->position);
    else
        lr_volume_color(volume, c, p, hit->id[i], hit->triangle[i], 0.0, point->color);
    memcpy(shading_point->origin, shading_point->position, sizeof shading_point->origin);
    shading_point->is_offset = terminator_offset(placed, shading_point, hit->id[i], c, p, offset);
    for (int a = 0; a < 3 && shading_point->is_offset; a++)
        shading_point->origin[a] += offset[a];
    find_ways(volume, c, q, leaves, shading_point);
    uint32_t slot;
    shading_point->material_index = lr_material_of(scene, shading_point->instance, id, &slot);
    shading_point->material = &scene->materials[shading_point->material_index];
    const int32_t index = scene->slot_objects != NULL ? scene->slot_objects[slot] : LR_OWN_INDEX;
    shading_point->object_index = index != LR_OWN_INDEX ? index : placed->object_index;
    const bool bends = (shading_point->material->flags & LR_MATERIAL_REFRACTS) != 0;
    point->eta = !bends ? 1 : scene->lone_media ? 0 : eta(scene, shading_point, media);
    lr_bsdf_at(shading_point->material, point, &shading_point->bsdf);
}

/* The gradient of values at a point of world space, in object space; false where there is none. */
static bool gradient_at(const lr_placed *placed, const double world[3], int32_t normal_kind,
                        double gradient[3])
{
    const lr_volume *v = lr_structure_volume(placed->structure);
    double object[3], p[3];
    int32_t c[3];
    lr_map_point(placed->object_from_world, world, object);
    lr_map_point(v->storage_from_object, object, p);
    if (!lr_all_finite(p, 3))
        return false;
    for (int a = 0; a < 3; a++) {
        c[a] = (int32_t)lr_clamp(floor(p[a]), lr_first_cell(v), lr_last_cell(v, a));
        p[a] = lr_clamp(p[a] - c[a], 0, 1);
    }
    return lr_value_gradient(v, c, p, normal_kind, gradient);
}

/* Let a point of a volume, all of which is known but this, be a surface in part: writes its share,
 * its normals, and its BSDF. */
static void shade_by_gradient(const lr_placed *placed, const double color[3], int32_t normal_kind,
                              lr_shading_point *s)
{
    double gradient[3];
    if (!gradient_at(placed, s->position, normal_kind, gradient))
        return;
    s->hybrid.share = lr_gradient_share(&placed->gradient, sqrt(lr_dot(gradient, gradient)));
    if (!(s->hybrid.share > 0))
        return;
    lr_point *at = &s->point;
    const double d[3] = {-at->view[0], -at->view[1], -at->view[2]};
    world_normal(placed, gradient, d, at->normal);
    const double side = lr_dot(d, at->normal) > 0 ? -1 : 1;
    for (int a = 0; a < 3; a++)
        at->normal[a] = at->facing[a] = side * at->normal[a];
    lr_gradient_surface(&placed->gradient, color, at, &s->bsdf);
}

void lr_volume_point_find(const lr_scene *scene, const lr_volume_point *point, int32_t normal_kind,
                          lr_shading_point *s)
{
    static const lr_material scatters = {.flags = LR_MATERIAL_SCATTERS};
    const lr_placed *placed = &scene->instances[point->instance];
    const lr_path *path = &point->path;
    memset(s, 0, offsetof(lr_shading_point, bsdf));
    memcpy(s->position, path->origin, sizeof s->position);
    memcpy(s->origin, path->origin, sizeof s->origin);
    for (int a = 0; a < 3; a++)
        s->point.view[a] = -path->direction[a];
    s->triangle = LR_NO_TRIANGLE;
    s->path = path;
    s->t = point->t;
    s->material = &scatters;
    s->instance = point->instance;
    s->object_index = placed->object_index;
    s->share = 1;
    s->in_volume = true;
    s->hybrid = (lr_hybrid){.phase = point->phase};
    memcpy(s->hybrid.color, point->color, sizeof s->hybrid.color);
    s->sure[LR_RAY_VOLUME] = point->continues;
    s->probability[LR_RAY_VOLUME] = point->probability;
    s->bsdf.bent = false;
    s->bsdf.n = 0;
    memset(s->bsdf.albedo, 0, sizeof s->bsdf.albedo);
    memset(s->bsdf.transparency, 0, sizeof s->bsdf.transparency);
    if (placed->gradient.amount > 0)
        shade_by_gradient(placed, point->color, normal_kind, s);
    s->bsdf.albedo[LR_RAY_VOLUME] = 1;
}

lr_start lr_surface_start(const lr_shading_point *shading_point, bool beyond)
{
    lr_start start = shading_point->start;
    start.side = beyond ? -start.side : shading_point->is_offset ? 0 : start.side;
    return start;
}

lr_start lr_surface_straight_start(const lr_shading_point *s, uint32_t from, const lr_start *before)
{
    lr_start start = lr_surface_start(s, true);
    const bool again = s->t == 0 && from == s->instance && before->side == start.side &&
                       memcmp(before->cell, start.cell, sizeof start.cell) == 0;
    if (again)
        start.side = 0;
    return start;
}

lr_start lr_surface_light_start(const lr_scene *scene, const lr_shading_point *s, bool beyond,
                                const double d[3], double origin[3])
{
    static const double GRAZES = 0.1; /* sine: Blender's Shadow Terminator Geometry Offset */
    const double amount = beyond ? 0 : 1 - lr_dot(d, s->point.facing) / GRAZES;
    lr_start start = lr_surface_start(s, beyond);
    double offset[3];
    memcpy(origin, beyond ? s->position : s->origin, 3 * sizeof *origin);
    if (!(amount > 0) || !smooth_offset(&scene->instances[s->instance], s, offset))
        return start;
    for (int a = 0; a < 3; a++)
        origin[a] += fmin(amount, 1) * offset[a];
    start.side = 0;
    return start;
}

bool lr_surface_cross(const lr_scene *scene, const lr_shading_point *shading_point,
                      lr_medium_stack *media)
{
    const uint32_t kinds = LR_MATERIAL_REFRACTS | LR_MATERIAL_FILLS;
    if (!scene->instances[shading_point->instance].enterable)
        return false;
    if (!shading_point->point.inside && (shading_point->material->flags & kinds) != 0)
        return lr_medium_stack_enter(media, shading_point->instance, shading_point->material_index);
    if (shading_point->point.inside)
        lr_medium_stack_leave(media, shading_point->instance);
    return false;
}
