/* From a hit to the point that is lit.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_SHADING_POINT_H
#define LR_RENDER_INTEGRATOR_SHADING_POINT_H

#include "render/integrator/queues.h"

/* The point that ray i, which is in these solids, has hit: reads the ray and its hit; writes all
 * of the shading point but what its path gives and its probabilities; its way only where several
 * rays are going to leave it. Surfaces have two sides;
 * the direction of the ray against the field's own normal tells which one is seen, and the
 * normals are turned to it. */
void lr_surface_find(const lr_scene *scene, const lr_ray_queue *rays, const lr_hit_queue *hits,
                     uint32_t i, const lr_medium_stack *media, bool leaves,
                     lr_shading_point *shading_point);

/* The point of a volume that scatters light: reads it; writes what holds of the shading point.
 * normal_kind: lr_normal, of its gradient. */
void lr_volume_point_find(const lr_scene *scene, const lr_volume_point *point, int32_t normal_kind,
                          lr_shading_point *shading_point);

/* What a ray is in after it has gone through the surface; true where that was too
 * much and something was forgotten. */
bool lr_surface_cross(const lr_scene *scene, const lr_shading_point *shading_point,
                      lr_medium_stack *media);

/* Where rays leave the surface: those on the viewer's side start at
 * shading point->origin, those beyond at shading point->position. */
lr_start lr_surface_start(const lr_shading_point *shading_point, bool beyond);

/* Where a ray goes on straight through the surface, which started from that instance so. Where a
 * ray on a border of cells leaves its cell at once, it may meet what it has just passed; then
 * nobody knows its side, so that it goes on all the same. */
lr_start lr_surface_straight_start(const lr_shading_point *shading_point, uint32_t from,
                                   const lr_start *before);

/* The way of a ray that starts so, if the shading point knows it. */
LR_INLINE void lr_surface_way(const lr_shading_point *s, const lr_start *start, double way[3])
{
    memcpy(way, s->way[start->side != s->start.side], sizeof s->way[0]);
}

/* Likewise, and from which point, for a shadow ray along d (unit). */
lr_start lr_surface_light_start(const lr_scene *scene, const lr_shading_point *shading_point,
                                bool beyond, const double d[3], double origin[3]);

/* The kinds of rays by which a shading point scatters light to others. */
LR_INLINE int lr_first_kind(const lr_shading_point *s)
{
    return s->in_volume ? LR_RAY_VOLUME : LR_RAY_DIFFUSE;
}

LR_INLINE int lr_last_kind(const lr_shading_point *s)
{
    return s->in_volume ? LR_RAY_VOLUME : LR_RAY_TRANSMISSION;
}

/* The responses of these kinds to light from a direction. */
LR_INLINE void lr_point_respond(const lr_shading_point *s, const double light[3],
                                lr_response response[LR_RAY_KINDS])
{
    if (s->in_volume)
        response[LR_RAY_VOLUME] = lr_hybrid_eval(&s->hybrid, &s->bsdf, s->point.view, light);
    else
        lr_bsdf_eval(&s->bsdf, light, response + LR_RAY_DIFFUSE);
}

/* Does a direction lead through the surface? Only where that refracts. */
LR_INLINE bool lr_leads_beyond(const lr_shading_point *s, const double d[3])
{
    return s->bsdf.albedo[LR_RAY_TRANSMISSION] > 0 && lr_dot(d, s->bsdf.basis.axis[2]) < 0;
}

/* Which side of a shading point gets light, as lr_path.normal: its normal, or 0 if both. */
LR_INLINE void lr_lit_side(const lr_shading_point *s, float normal[3])
{
    const bool both = s->in_volume || s->bsdf.bent || s->bsdf.albedo[LR_RAY_TRANSMISSION] > 0;
    for (int a = 0; a < 3; a++)
        normal[a] = both ? 0 : (float)s->bsdf.basis.axis[2][a];
}

#endif
