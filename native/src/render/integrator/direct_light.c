/* Direct light: what lights and the world send to surfaces.
 *
 * Primary hits sample every light, or a subset chosen by the light tree; later hits sample
 * one. Shadow rays are collected over all light samples until a wave is full. Opaque
 * surfaces stop them first, in a wave that only asks whether anything is hit; the rest goes
 * from one transparent surface to the next and is attenuated by each.
 *
 * Lights with extent are found by scattered rays too: multiple importance sampling
 * weights the two.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/direct_light.h"

#include "base/error.h"
#include "render/film/sampling.h"
#include "render/integrator/medium_stack.h"
#include "render/integrator/path_record.h"
#include "render/integrator/scatter.h"
#include "render/integrator/shading_point.h"
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
    lr_response group[LR_GROUPS];
    lr_bsdf_eval(&s->bsdf, sampled->ray.direction, group);
    double sum[3] = {0, 0, 0};
    for (int kind = LR_RAY_DIFFUSE; kind <= LR_RAY_TRANSMISSION; kind++) {
        const lr_response *response = &group[kind - LR_RAY_DIFFUSE];
        if ((sampled->visibility & lr_sees(kind)) == 0)
            continue;
        const double other = sampled->ray.delta ? 0 : s->probability[kind] * response->pdf;
        const double share = lr_mis(probability * sampled->ray.pdf, other);
        for (int a = 0; a < 3; a++)
            sum[a] += share * response->f_cos[a];
    }
    const double scale = 1 / (probability * sampled->ray.pdf);
    for (int a = 0; a < 3; a++)
        contribution[a] = sum[a] * sampled->ray.color[a] * s->path->throughput[a] * scale;
    return !is_black(contribution);
}

/* Aim ray `ray` of the wave, which carries shadow ray `shadow_ray`, from the surface of a shading
 * point. */
static void spawn_shadow_ray(const lr_job *job, uint32_t ray, uint32_t shadow_ray,
                             const lr_shading_point *s, const double d[3], double t_max,
                             bool beyond)
{
    lr_workspace *w = job->workspace;
    double origin[3];
    w->wave.start[ray] = lr_surface_light_start(s, beyond, d, origin);
    lr_aim(&w->wave, ray, origin, d, t_max);
    w->wave.from[ray] = s->instance;
    w->wave.visibility[ray] = LR_VISIBLE_SHADOW;
    w->carried[ray] = shadow_ray;
    if (job->scene->has_media && beyond)
        lr_surface_cross(job->scene, s, &w->shadow_media[shadow_ray]);
}

/* Shadow rays that no opaque surface has stopped; their rays are moved to the front. */
static uint32_t keep_free(const lr_job *job, uint32_t n)
{
    lr_workspace *w = job->workspace;
    uint32_t kept = 0;
    lr_wave *wave = &w->wave;
    for (uint32_t i = 0; i < n; i++) {
        lr_shadow_ray *shadow_ray = &w->shadow_rays[w->carried[i]];
        if (wave->instance[i] != LR_NOWHERE) {
            memset(shadow_ray->contribution, 0, sizeof shadow_ray->contribution);
            lr_record_blocked(job, shadow_ray, wave->instance[i]);
            continue;
        }
        double o[3], d[3];
        lr_get_ray(&wave->ray, i, o, d);
        lr_aim(wave, kept, o, d, wave->t[i]);
        wave->from[kept] = wave->from[i];
        wave->start[kept] = wave->start[i];
        wave->visibility[kept] = wave->visibility[i];
        w->carried[kept++] = w->carried[i];
    }
    return kept;
}

/* Take the rays through the transparent surfaces that they have hit. Returns how
 * many are still on their way. */
static uint32_t pass_surfaces(const lr_job *job, uint32_t n)
{
    lr_workspace *w = job->workspace;
    lr_wave *wave = &w->wave;
    uint32_t kept = 0;
    for (uint32_t i = 0; i < n; i++) {
        const uint32_t k = w->carried[i];
        lr_shadow_ray *shadow_ray = &w->shadow_rays[k];
        const bool hit = wave->instance[i] != LR_NOWHERE;
        const double d[3] = {wave->ray.dx[i], wave->ray.dy[i], wave->ray.dz[i]};
        const double t = wave->t[i]; /* its place may be taken by the next ray that is kept */
        if (job->scene->has_media)
            lr_medium_stack_absorb(job->scene, &w->shadow_media[k], t, shadow_ray->contribution);
        if (!hit || is_black(shadow_ray->contribution))
            continue;
        lr_shading_point s;
        lr_surface_find(job->scene, wave, i, &w->shadow_media[k], &s);
        const bool through = shadow_ray->clear++ <= (uint32_t)job->tile->transparent_bounces;
        for (int a = 0; a < 3; a++)
            shadow_ray->contribution[a] *= through ? s.bsdf.transparency[a] : 0;
        shadow_ray->ends -= t;
        if (!is_black(shadow_ray->contribution))
            spawn_shadow_ray(job, kept++, k, &s, d, shadow_ray->ends, true);
        else
            lr_record_blocked(job, shadow_ray, wave->instance[i]);
    }
    return kept;
}

/* Trace the n rays of the wave, then add the contributions of the first n_shadow_rays, in
 * their order, which so does not depend on how full the wave was. */
static lr_status trace_shadow_rays(const lr_job *job, uint32_t n, uint32_t n_shadow_rays)
{
    lr_workspace *w = job->workspace;
    const bool clear = job->scene->has_clear;
    lr_cast_options options = {
        .among = clear ? LR_AMONG_OPAQUE : LR_AMONG_ALL,
        .any = true,
        .leaving = true,
        .trace = job->tile->trace,
    };
    lr_status status = lr_cast_wave(job, n, &options);
    uint32_t traced = keep_free(job, status == LR_OK ? n : 0);
    options.among = LR_AMONG_CLEAR;
    options.any = false;
    while (status == LR_OK && (clear || job->scene->has_media) && traced > 0) {
        status = lr_cast_wave(job, traced, &options);
        if (status == LR_OK)
            traced = pass_surfaces(job, traced);
    }
    for (uint32_t k = 0; k < n_shadow_rays && status == LR_OK; k++) {
        const lr_path *path = w->shadow_rays[k].shading_point->path;
        lr_add_light(job, path->pixel, path->bounces[LR_RAY_CAMERA],
                     w->shadow_rays[k].contribution);
        lr_record_contribution(job, &w->shadow_rays[k]);
    }
    return status;
}

/* The light of sample `ask` of a shading point, and the expected number of its samples. */
static uint64_t choose_light(const lr_job *job, const lr_shading_point *s, uint32_t ask,
                             double *probability)
{
    const lr_light_tree *light_tree = &job->scene->light_tree;
    const uint32_t bounces = s->path->bounces[LR_RAY_CAMERA];
    float side[3];
    *probability = 1;
    if (lr_light_tree_all(light_tree, bounces))
        return ask;
    lr_lit_side(s, side);
    const double n[3] = {side[0], side[1], side[2]};
    const uint32_t asked = lr_light_tree_asked(light_tree, bounces);
    const double u = lr_sample_one(lr_key(s->path->key, CHOOSE), s->path->sample);
    const uint64_t light_index =
        lr_light_tree_choose(light_tree, s->origin, n, (ask + u) / asked, probability);
    *probability *= asked;
    return light_index;
}

/* Cycles counts so: rays that meet the light by themselves find it all the same, with the share
 * that they would have. */
static bool is_beyond_limit(const lr_scene *scene, uint64_t light_index, const lr_path *path)
{
    const int32_t limit = light_index == scene->n_lights ? scene->world_bounces
                                                         : scene->lights[light_index].max_bounces;
    return path->bounces[LR_RAY_CAMERA] > limit;
}

/* Make shadow ray n of light sample `ask`, if it contributes anything; its ray, if it
 * needs one, is the next of the wave. */
static bool light_by(const lr_job *job, const lr_shading_point *s, uint32_t ask, uint32_t n,
                     uint32_t *n_rays)
{
    lr_workspace *w = job->workspace;
    double probability;
    const uint64_t light_index = choose_light(job, s, ask, &probability);
    if (light_index == LR_LIGHT_NONE || is_beyond_limit(job->scene, light_index, s->path))
        return false;
    const uint32_t key = lr_key(s->path->key, FIRST_LIGHT + ask);
    double u[2] = {0, 0};
    lr_sampled_light sampled;
    lr_shadow_ray *shadow_ray = &w->shadow_rays[n];
    if (light_index == job->scene->n_lights ||
        lr_light_has_extent(&job->scene->lights[light_index]))
        lr_sample_pair(key, s->path->sample, u);
    const bool lit = sample_light(job->scene, light_index, s->origin, u, &sampled) &&
                     evaluate(s, &sampled, probability, shadow_ray->contribution);
    lr_record_light(job, s, light_index, probability, lit ? &sampled : NULL, shadow_ray);
    if (!lit)
        return false;
    if (light_index == job->scene->n_lights)
        sampled.ray.distance = lr_world_distance(job, s->path, LR_RAY_DIFFUSE);
    shadow_ray->shading_point = s;
    shadow_ray->clear = s->path->bounces[LR_RAY_TRANSPARENT];
    shadow_ray->ends = sampled.ray.distance;
    w->shadow_media[n].n = 0;
    if (job->scene->has_media)
        w->shadow_media[n] = s->path->media;
    if ((sampled.visibility & LR_VISIBLE_SHADOW) != 0)
        spawn_shadow_ray(job, (*n_rays)++, n, s, sampled.ray.direction, sampled.ray.distance,
                         lr_leads_beyond(s, sampled.ray.direction));
    return true;
}

/* How many light samples this shading point takes. */
static uint32_t asked(const lr_job *job, const lr_shading_point *s)
{
    if (s->path->last || (s->material->flags & LR_MATERIAL_SCATTERS) == 0)
        return 0;
    return lr_light_tree_asked(&job->scene->light_tree, s->path->bounces[LR_RAY_CAMERA]);
}

lr_status lr_light_shading_points(const lr_job *job, uint32_t n)
{
    const uint32_t most = lr_light_tree_asked(&job->scene->light_tree, 0);
    uint32_t n_shadow_rays = 0, n_rays = 0;
    for (uint32_t ask = 0; ask < most; ask++)
        for (uint32_t k = 0; k < n; k++) {
            const lr_shading_point *s = &job->workspace->shading_points[k];
            if (lr_stopped(job->watch))
                return lr_fail_stopped(job->error);
            if (ask >= asked(job, s) || !light_by(job, s, ask, n_shadow_rays, &n_rays))
                continue;
            if (++n_shadow_rays < job->workspace->room)
                continue;
            const lr_status status = trace_shadow_rays(job, n_rays, n_shadow_rays);
            if (status != LR_OK)
                return status;
            n_shadow_rays = n_rays = 0;
        }
    return n_shadow_rays > 0 ? trace_shadow_rays(job, n_rays, n_shadow_rays) : LR_OK;
}

lr_status lr_ambient_occlusion(const lr_job *job, uint32_t n)
{
    lr_workspace *w = job->workspace;
    const lr_cast_options options = {.any = true, .leaving = true, .trace = job->tile->trace};
    uint32_t n_rays = 0;
    for (uint32_t k = 0; k < n; k++) {
        const lr_shading_point *s = &w->shading_points[k];
        double u[2], d[3];
        if (!s->path->seen)
            continue;
        lr_sample_pair(lr_key(s->path->key, AMBIENT), s->path->sample, u);
        lr_cosine_direction(s->bsdf.basis.axis[2], u[0], u[1], d);
        spawn_shadow_ray(job, n_rays++, k, s, d, job->tile->ao_distance, false);
    }
    const lr_status status = n_rays > 0 ? lr_cast_wave(job, n_rays, &options) : LR_OK;
    for (uint32_t i = 0; i < n_rays && status == LR_OK; i++) {
        const lr_shading_point *s = &w->shading_points[w->carried[i]];
        double open = 0;
        for (int a = 0; a < 3; a++)
            open += s->path->throughput[a] * (1 - s->bsdf.transparency[a]) / 3;
        if (w->wave.instance[i] == LR_NOWHERE)
            w->pixels[s->path->pixel].ao += open;
    }
    return status;
}
