/* Direct light at surfaces and in volumes, from lights and the world.
 *
 * Primary hits sample every light, or a subset chosen by the light tree; later hits sample
 * one. Shadow rays are collected over all light samples until a wave is full. They are first
 * tested for any hit of an opaque surface; those left go from one transparent surface to the
 * next and are attenuated by each.
 *
 * Scattered rays meet lights with extent too: multiple importance sampling weights the two.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/direct_light.h"

#include "base/error.h"
#include "render/film/sampling.h"
#include "render/integrator/intersect_closest.h"
#include "render/integrator/medium_stack.h"
#include "render/integrator/path_record.h"
#include "render/integrator/scatter.h"
#include "render/integrator/shading_point.h"
#include "render/integrator/volume_light.h"
#include "render/lights/environment.h"
#include "render/lights/light.h"

enum { CHOOSE = 1, AMBIENT = 3, FIRST_LIGHT = 64 }; /* which choice: see lr_key */

static bool sample_light(const lr_scene *scene, uint64_t light_index, const double p[3],
                         const double u[2], lr_sampled_light *sampled)
{
    if (light_index == scene->n_lights) {
        sampled->visibility = scene->world_visibility | LR_VISIBLE_SHADOW;
        return lr_environment_sample(&scene->environment, u, &sampled->ray);
    }
    sampled->visibility = scene->lights[light_index].visibility;
    return lr_light_sample(&scene->lights[light_index], p, u, &sampled->ray);
}

static bool is_black(const double c[3])
{
    return !(fabs(c[0]) > 0 || fabs(c[1]) > 0 || fabs(c[2]) > 0);
}

/* The contribution of a light sample to the pixel; false where it is 0. probability: the
 * expected number of samples of this light. */
static bool evaluate(const lr_shading_point *s, const lr_sampled_light *sampled, double probability,
                     double contribution[3])
{
    lr_response group[LR_RAY_KINDS];
    lr_point_respond(s, sampled->ray.direction, group);
    double sum[3] = {0, 0, 0};
    for (int kind = lr_first_kind(s); kind <= lr_last_kind(s); kind++) {
        const lr_response *response = &group[kind];
        if ((sampled->visibility & lr_sees(kind)) == 0)
            continue;
        const double other = sampled->ray.delta ? 0 : s->probability[kind] * response->pdf;
        const double mis_weight = lr_mis(probability * sampled->ray.pdf, other);
        for (int a = 0; a < 3; a++)
            sum[a] += mis_weight * response->f_cos[a];
    }
    const double scale = 1 / (probability * sampled->ray.pdf);
    for (int a = 0; a < 3; a++)
        contribution[a] = sum[a] * sampled->ray.color[a] * s->path->throughput[a] * scale;
    return !is_black(contribution);
}

/* Reads a shading point; writes ray i, which leaves its surface along d. owner: see
 * lr_ray_queue. */
static void spawn_shadow_ray(const lr_scene *scene, const lr_shading_point *s, const double d[3],
                             double t_max, bool beyond, uint32_t owner, uint32_t i,
                             lr_ray_queue *rays)
{
    double origin[3];
    rays->start[i] = lr_surface_light_start(scene, s, beyond, d, origin);
    lr_surface_way(s, &rays->start[i], rays->way[i]);
    lr_aim(rays, i, origin, d, t_max);
    rays->from[i] = s->instance;
    rays->visibility[i] = LR_VISIBLE_SHADOW;
    rays->owner[i] = owner;
}

/* Reads the hits; writes the contributions of shadow rays that an opaque surface has stopped,
 * which are 0, and moves the rays of the others to the front. */
static void keep_free(const lr_hit_queue *hits, lr_ray_queue *rays, lr_shadow_queue *shadow_rays,
                      lr_record *record)
{
    const uint32_t n = rays->n;
    rays->n = 0;
    for (uint32_t i = 0; i < n; i++) {
        lr_shadow_ray *shadow_ray = &shadow_rays->rays[rays->owner[i]];
        if (hits->instance[i] != LR_NOWHERE) {
            memset(shadow_ray->contribution, 0, sizeof shadow_ray->contribution);
            lr_record_blocked(shadow_ray, hits->instance[i], record);
            continue;
        }
        const uint32_t kept = rays->n++;
        double o[3], d[3];
        lr_get_ray(&rays->ray, i, o, d);
        lr_aim(rays, kept, o, d, rays->t_max[i]);
        rays->from[kept] = rays->from[i];
        rays->start[kept] = rays->start[i];
        memcpy(rays->way[kept], rays->way[i], sizeof rays->way[i]);
        rays->visibility[kept] = rays->visibility[i];
        rays->owner[kept] = rays->owner[i];
    }
}

/* Continue the rays through the transparent surfaces that they have hit: reads the hits and what
 * volumes absorb before them; writes the shadow rays' contributions and media, and the rays that
 * continue. */
static void pass_surfaces(const lr_scene *scene, uint32_t transparent_bounces,
                          const lr_hit_queue *hits, const lr_volume_light *light,
                          lr_ray_queue *rays, lr_shadow_queue *shadow_rays, lr_record *record)
{
    const uint32_t n = rays->n;
    rays->n = 0;
    for (uint32_t i = 0; i < n; i++) {
        const uint32_t k = rays->owner[i];
        lr_shadow_ray *shadow_ray = &shadow_rays->rays[k];
        lr_medium_stack *media = &shadow_rays->media[k];
        const bool hit = hits->instance[i] != LR_NOWHERE;
        const double d[3] = {rays->ray.dx[i], rays->ray.dy[i], rays->ray.dz[i]};
        if (scene->has_media)
            lr_medium_stack_absorb(scene, media, LR_VISIBLE_SHADOW, hits->t[i],
                                   shadow_ray->contribution);
        for (int a = 0; a < 3 && scene->n_participants > 0; a++)
            shadow_ray->contribution[a] *= light->transmittance[i];
        if (!hit || is_black(shadow_ray->contribution))
            continue;
        lr_closure closures[LR_CLOSURES_MAX];
        lr_shading_point s;
        s.bsdf.closures = closures;
        lr_surface_find(scene, rays, hits, i, media, false, &s);
        const bool bare = (s.material->flags & LR_MATERIAL_BARE) != 0;
        const bool through = bare ? shadow_ray->bounds++ < LR_BOUNDS_MAX
                                  : shadow_ray->clear++ <= transparent_bounces;
        for (int a = 0; a < 3; a++)
            shadow_ray->contribution[a] *= through ? s.bsdf.transparency[a] : 0;
        shadow_ray->ends -= hits->t[i];
        if (is_black(shadow_ray->contribution)) {
            lr_record_blocked(shadow_ray, hits->instance[i], record);
            continue;
        }
        const lr_start start = lr_surface_straight_start(&s, rays->from[i], &rays->start[i]);
        spawn_shadow_ray(scene, &s, d, shadow_ray->ends, true, k, rays->n, rays);
        rays->start[rays->n++] = start;
        if (scene->has_media)
            lr_surface_cross(scene, &s, media);
    }
}

/* Trace shadow rays, then add their contributions in their order, so that sums do not depend on
 * the size of waves: reads the rays; writes shadow rays and the pixels' sums. Empties both
 * queues. */
static lr_status trace_shadow_rays(const lr_context *context, lr_shadow_queue *shadow_rays,
                                   lr_wave *wave, lr_film *film)
{
    const lr_scene *scene = context->scene;
    lr_ray_queue *rays = &wave->rays;
    lr_hit_queue *hits = &wave->hits;
    lr_record *record = context->tile->record;
    lr_intersect_options options = {
        .among = scene->has_clear ? LR_AMONG_OPAQUE : LR_AMONG_ALL, .any = true, .leaving = true};
    lr_status status = lr_intersect_closest(context, &options, rays, hits, &wave->memory);
    if (status == LR_OK)
        keep_free(hits, rays, shadow_rays, record);
    const bool passes = scene->has_clear || scene->has_media || scene->n_participants > 0;
    options.among = LR_AMONG_CLEAR;
    options.any = false;
    while (status == LR_OK && passes && rays->n > 0) {
        status = lr_intersect_closest(context, &options, rays, hits, &wave->memory);
        if (status == LR_OK && scene->n_participants > 0)
            status = lr_find_volume_light(context, 0, NULL, rays, hits->t, &wave->memory.batch,
                                          &wave->volume_light, NULL);
        if (status == LR_OK)
            pass_surfaces(scene, (uint32_t)context->tile->transparent_bounces, hits,
                          &wave->volume_light, rays, shadow_rays, record);
    }
    for (uint32_t k = 0; k < shadow_rays->n && status == LR_OK; k++) {
        const lr_path *path = shadow_rays->rays[k].shading_point->path;
        lr_film_add(film, path->pixel, path->bounces[LR_RAY_CAMERA],
                    shadow_rays->rays[k].contribution);
        lr_record_contribution(&shadow_rays->rays[k], record);
    }
    shadow_rays->n = rays->n = 0;
    return status;
}

/* The light of light sample `sample` of a shading point, and the expected number of its samples. */
static uint64_t choose_light(const lr_light_tree *light_tree, const lr_shading_point *s,
                             uint32_t sample, double *probability)
{
    const uint32_t bounces = s->path->bounces[LR_RAY_CAMERA];
    float side[3];
    *probability = 1;
    if (lr_light_tree_all(light_tree, bounces))
        return sample;
    lr_lit_side(s, side);
    const double n[3] = {side[0], side[1], side[2]};
    const uint32_t n_chosen = lr_light_tree_n_samples(light_tree, bounces);
    const double u = lr_sample_one(lr_key(s->path->key, CHOOSE), s->path->sample);
    const uint64_t light_index =
        lr_light_tree_choose(light_tree, s->origin, n, (sample + u) / n_chosen, probability);
    *probability *= n_chosen;
    return light_index;
}

/* As in Cycles: scattered rays that meet the light still count, with an unchanged MIS weight. */
static bool is_beyond_limit(const lr_scene *scene, uint64_t light_index, const lr_path *path)
{
    const int32_t limit = light_index == scene->n_lights ? scene->world_bounces
                                                         : scene->lights[light_index].max_bounces;
    return path->bounces[LR_RAY_CAMERA] > limit;
}

/* Reads a shading point; writes the shadow ray of its light sample `sample`, if that contributes
 * anything, and its ray, if it needs one. */
static void light_by(const lr_context *context, const lr_shading_point *s, uint32_t sample,
                     lr_shadow_queue *shadow_rays, lr_ray_queue *rays)
{
    const lr_scene *scene = context->scene;
    double probability;
    const uint64_t light_index = choose_light(&scene->light_tree, s, sample, &probability);
    if (light_index == LR_LIGHT_NONE || is_beyond_limit(scene, light_index, s->path))
        return;
    const uint32_t key = lr_key(s->path->key, FIRST_LIGHT + sample), n = shadow_rays->n;
    const bool world = light_index == scene->n_lights;
    double u[2] = {0, 0};
    lr_sampled_light sampled;
    lr_shadow_ray *shadow_ray = &shadow_rays->rays[n];
    if (world || lr_light_has_extent(&scene->lights[light_index]))
        lr_sample_pair(key, s->path->sample, u);
    const bool lit = sample_light(scene, light_index, s->origin, u, &sampled) &&
                     evaluate(s, &sampled, probability, shadow_ray->contribution);
    lr_record_light(s, light_index, probability, lit ? &sampled : NULL, shadow_ray,
                    context->tile->record);
    if (!lit)
        return;
    if (world)
        sampled.ray.distance = lr_world_distance(context->tile, s->path,
                                                 s->in_volume ? LR_RAY_VOLUME : LR_RAY_DIFFUSE);
    shadow_ray->shading_point = s;
    shadow_ray->clear = s->path->bounces[LR_RAY_TRANSPARENT];
    shadow_ray->bounds = s->path->bounds;
    shadow_ray->ends = sampled.ray.distance;
    shadow_rays->media[n].n = 0;
    if (scene->has_media)
        shadow_rays->media[n] = s->path->media;
    shadow_rays->n++;
    if ((sampled.visibility & LR_VISIBLE_SHADOW) == 0)
        return;
    const bool beyond = lr_leads_beyond(s, sampled.ray.direction);
    spawn_shadow_ray(context->scene, s, sampled.ray.direction, sampled.ray.distance, beyond, n,
                     rays->n++, rays);
    if (scene->has_media && beyond)
        lr_surface_cross(scene, s, &shadow_rays->media[n]);
}

/* How many light samples this shading point takes. */
static uint32_t n_samples(const lr_light_tree *light_tree, const lr_shading_point *s)
{
    if (s->path->last || (s->material->flags & LR_MATERIAL_SCATTERS) == 0)
        return 0;
    return lr_light_tree_n_samples(light_tree, s->path->bounces[LR_RAY_CAMERA]);
}

lr_status lr_light_shading_points(const lr_context *context, const lr_shading_queue *shading_points,
                                  lr_shadow_queue *shadow_rays, lr_wave *wave, lr_film *film)
{
    const lr_light_tree *light_tree = &context->scene->light_tree;
    const uint32_t most = lr_light_tree_n_samples(light_tree, 0);
    lr_status status = LR_OK;
    shadow_rays->n = wave->rays.n = 0;
    for (uint32_t sample = 0; sample < most; sample++)
        for (uint32_t k = 0; k < shading_points->n && status == LR_OK; k++) {
            const lr_shading_point *s = &shading_points->points[k];
            if (lr_stopped(context->watch))
                return lr_fail_stopped(context->error);
            if (sample < n_samples(light_tree, s))
                light_by(context, s, sample, shadow_rays, &wave->rays);
            if (shadow_rays->n == shadow_rays->capacity)
                status = trace_shadow_rays(context, shadow_rays, wave, film);
        }
    if (status == LR_OK && shadow_rays->n > 0)
        status = trace_shadow_rays(context, shadow_rays, wave, film);
    return status;
}

lr_status lr_ambient_occlusion(const lr_context *context, const lr_shading_queue *shading_points,
                               lr_wave *wave, lr_film *film)
{
    const lr_intersect_options options = {.any = true, .leaving = true};
    lr_ray_queue *rays = &wave->rays;
    rays->n = 0;
    for (uint32_t k = 0; k < shading_points->n; k++) {
        const lr_shading_point *s = &shading_points->points[k];
        double u[2], d[3];
        if (!s->path->seen || (s->material->flags & LR_MATERIAL_BARE) != 0)
            continue;
        lr_sample_pair(lr_key(s->path->key, AMBIENT), s->path->sample, u);
        lr_cosine_direction(s->bsdf.basis.axis[2], u[0], u[1], d);
        spawn_shadow_ray(context->scene, s, d, context->tile->ao_distance, false, k, rays->n++,
                         rays);
    }
    if (rays->n == 0)
        return LR_OK;
    const lr_status status =
        lr_intersect_closest(context, &options, rays, &wave->hits, &wave->memory);
    for (uint32_t i = 0; i < rays->n && status == LR_OK; i++) {
        const lr_shading_point *s = &shading_points->points[rays->owner[i]];
        double open = 0;
        for (int a = 0; a < 3; a++)
            open += s->path->throughput[a] * (1 - s->bsdf.transparency[a]) / 3;
        if (wave->hits.instance[i] == LR_NOWHERE)
            film->pixels[s->path->pixel].ao += open;
    }
    return status;
}
