/* Direct light: what lights and the world send to surfaces.
 *
 * Shading points that the camera sees ask every light, or of many lights some, those behind
 * a mirror or deeper one light: there are many of them, and they weigh little. Lights
 * are chosen by what they may bring (light_tree.c). The rays are gathered over all
 * questions until a wave is full. What is opaque stops them first,
 * in a wave that only asks whether anything is hit; what is left then goes from
 * one transparent surface to the next and takes on its colour.
 *
 * Lights with extent are found by scattered rays too; either way gets the share
 * that its density deserves.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/direct_light.h"

#include "base/error.h"
#include "render/film/sampling.h"
#include "render/integrator/medium_stack.h"
#include "render/integrator/scatter.h"
#include "render/integrator/shading_point.h"
#include "render/lights/environment.h"
#include "render/lights/light.h"

enum { CHOOSE = 1, AMBIENT = 3, FIRST_LIGHT = 64 }; /* which choice: see lr_key */

/* A way from a shading point to a light. */
typedef struct lr_way {
    double direction[3], distance, color[3], pdf;
    uint32_t visibility;
    bool delta, shadow;
} lr_way;

static bool find_way(const lr_scene *scene, uint64_t light_index, const double p[3],
                     const double u[2], lr_way *way)
{
    if (light_index == scene->n_lights) {
        *way =
            (lr_way){.distance = INFINITY, .visibility = scene->world_visibility, .shadow = true};
        return lr_environment_sample(&scene->environment, u, way->direction, way->color, &way->pdf);
    }
    const lr_light *light = &scene->lights[light_index];
    lr_light_ray ray;
    if (!lr_light_sample(light, p, u, &ray))
        return false;
    *way = (lr_way){
        .direction = {ray.direction[0], ray.direction[1], ray.direction[2]},
        .distance = ray.distance,
        .color = {ray.color[0], ray.color[1], ray.color[2]},
        .pdf = ray.pdf,
        .visibility = light->visibility,
        .delta = ray.delta,
        .shadow = (light->visibility & LR_VISIBLE_SHADOW) != 0,
    };
    return true;
}

static bool black(const double c[3])
{
    return !(fabs(c[0]) > 0 || fabs(c[1]) > 0 || fabs(c[2]) > 0);
}

/* What the light of the way adds to the pixel; false where nothing. chance: how often
 * this light is asked. */
static bool weigh(const lr_shading_point *s, const lr_way *way, double chance, double brings[3])
{
    lr_response group[LR_GROUPS];
    lr_bsdf_eval(&s->bsdf, way->direction, group);
    double sum[3] = {0, 0, 0};
    for (int kind = LR_RAY_DIFFUSE; kind <= LR_RAY_TRANSMISSION; kind++) {
        const lr_response *response = &group[kind - LR_RAY_DIFFUSE];
        if ((way->visibility & lr_sees(kind)) == 0)
            continue;
        const double other = way->delta ? 0 : s->chance[kind] * response->pdf;
        const double share = lr_mis(chance * way->pdf, other);
        for (int a = 0; a < 3; a++)
            sum[a] += share * response->f_cos[a];
    }
    const double scale = 1 / (chance * way->pdf);
    for (int a = 0; a < 3; a++)
        brings[a] = sum[a] * way->color[a] * s->path->weight[a] * scale;
    return !black(brings);
}

/* Ray `ray` goes on as beam `beam` from the surface of a shading point. */
static void leave(const lr_job *job, uint32_t ray, uint32_t beam, const lr_shading_point *s,
                  const double d[3], double t_max, bool beyond)
{
    lr_workspace *w = job->workspace;
    double origin[3];
    w->wave.start[ray] = lr_surface_light_start(s, beyond, d, origin);
    lr_aim(&w->wave, ray, origin, d, t_max);
    w->wave.from[ray] = s->instance;
    w->wave.visibility[ray] = LR_VISIBLE_SHADOW;
    w->carried[ray] = beam;
    if (job->scene->has_media && beyond)
        lr_surface_cross(job->scene, s, &w->beam_insides[beam]);
}

/* Beams that what is opaque has not stopped; their rays are moved to the front. */
static uint32_t keep_free(lr_workspace *w, uint32_t n)
{
    uint32_t kept = 0;
    lr_wave *wave = &w->wave;
    for (uint32_t i = 0; i < n; i++) {
        lr_beam *beam = &w->beams[w->carried[i]];
        if (wave->instance[i] != LR_NOWHERE) {
            memset(beam->brings, 0, sizeof beam->brings);
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
        lr_beam *beam = &w->beams[k];
        const bool hit = wave->instance[i] != LR_NOWHERE;
        const double d[3] = {wave->ray.dx[i], wave->ray.dy[i], wave->ray.dz[i]};
        if (job->scene->has_media)
            lr_insides_absorb(job->scene, &w->beam_insides[k], wave->t[i], beam->brings);
        if (!hit || black(beam->brings))
            continue;
        lr_shading_point s;
        lr_surface_find(job->scene, wave, i, &w->beam_insides[k], &s);
        const bool through = beam->clear++ <= (uint32_t)job->tile->transparent_bounces;
        for (int a = 0; a < 3; a++)
            beam->brings[a] *= through ? s.bsdf.transparency[a] : 0;
        if (!black(beam->brings))
            leave(job, kept++, k, &s, d, beam->ends - wave->t[i], true);
        beam->ends -= wave->t[i];
    }
    return kept;
}

/* Send the n rays that are aimed, then add what the first n_beams beams bring, in
 * their order, which so does not depend on how full the wave was. */
static lr_status send(const lr_job *job, uint32_t n, uint32_t n_beams)
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
    uint32_t flying = keep_free(w, status == LR_OK ? n : 0);
    options.among = LR_AMONG_CLEAR;
    options.any = false;
    while (status == LR_OK && (clear || job->scene->has_media) && flying > 0) {
        status = lr_cast_wave(job, flying, &options);
        if (status == LR_OK)
            flying = pass_surfaces(job, flying);
    }
    for (uint32_t k = 0; k < n_beams && status == LR_OK; k++) {
        const lr_path *path = w->beams[k].shading_point->path;
        lr_add_light(job, path->pixel, path->bounces[LR_RAY_CAMERA], w->beams[k].brings);
    }
    return status;
}

/* The light for question `ask` of a shading point, and how often it is asked. */
static uint64_t choose_light(const lr_job *job, const lr_shading_point *s, uint32_t ask,
                             double *chance)
{
    const lr_light_tree *light_tree = &job->scene->light_tree;
    const uint32_t bounces = s->path->bounces[LR_RAY_CAMERA];
    float side[3];
    *chance = 1;
    if (lr_light_tree_all(light_tree, bounces))
        return ask;
    lr_lit_side(s, side);
    const double n[3] = {side[0], side[1], side[2]};
    const uint32_t asked = lr_light_tree_asked(light_tree, bounces);
    const double u = lr_sample_one(lr_key(s->path->key, CHOOSE), s->path->sample);
    const uint64_t light_index =
        lr_light_tree_choose(light_tree, s->origin, n, (ask + u) / asked, chance);
    *chance *= asked;
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

/* Make beam n by question `ask`, if it brings anything; its ray, if it needs one, is
 * the next one. */
static bool light_by(const lr_job *job, const lr_shading_point *s, uint32_t ask, uint32_t n,
                     uint32_t *n_rays)
{
    lr_workspace *w = job->workspace;
    double chance;
    const uint64_t light_index = choose_light(job, s, ask, &chance);
    if (light_index == LR_LIGHT_NONE || is_beyond_limit(job->scene, light_index, s->path))
        return false;
    const uint32_t key = lr_key(s->path->key, FIRST_LIGHT + ask);
    double u[2] = {0, 0};
    lr_way way;
    lr_beam *beam = &w->beams[n];
    if (light_index == job->scene->n_lights ||
        lr_light_has_extent(&job->scene->lights[light_index]))
        lr_sample_pair(key, s->path->sample, u);
    if (!find_way(job->scene, light_index, s->origin, u, &way) ||
        !weigh(s, &way, chance, beam->brings))
        return false;
    if (light_index == job->scene->n_lights)
        way.distance = lr_world_distance(job, s->path, LR_RAY_DIFFUSE);
    beam->shading_point = s;
    beam->clear = s->path->bounces[LR_RAY_TRANSPARENT];
    beam->ends = way.distance;
    if (job->scene->has_media)
        w->beam_insides[n] = s->path->insides;
    if (way.shadow)
        leave(job, (*n_rays)++, n, s, way.direction, way.distance,
              lr_leads_beyond(s, way.direction));
    return true;
}

/* How many lights this shading point asks. */
static uint32_t asked(const lr_job *job, const lr_shading_point *s)
{
    if (s->path->last || (s->material->flags & LR_MATERIAL_SCATTERS) == 0)
        return 0;
    return lr_light_tree_asked(&job->scene->light_tree, s->path->bounces[LR_RAY_CAMERA]);
}

lr_status lr_light_shading_points(const lr_job *job, uint32_t n)
{
    const uint32_t most = lr_light_tree_asked(&job->scene->light_tree, 0);
    uint32_t n_beams = 0, n_rays = 0;
    for (uint32_t ask = 0; ask < most; ask++)
        for (uint32_t k = 0; k < n; k++) {
            const lr_shading_point *s = &job->workspace->shading_points[k];
            if (lr_stopped(job->watch))
                return lr_fail_stopped(job->error);
            if (ask >= asked(job, s) || !light_by(job, s, ask, n_beams, &n_rays))
                continue;
            if (++n_beams < job->workspace->room)
                continue;
            const lr_status status = send(job, n_rays, n_beams);
            if (status != LR_OK)
                return status;
            n_beams = n_rays = 0;
        }
    return n_beams > 0 ? send(job, n_rays, n_beams) : LR_OK;
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
        leave(job, n_rays++, k, s, d, job->tile->ao_distance, false);
    }
    const lr_status status = n_rays > 0 ? lr_cast_wave(job, n_rays, &options) : LR_OK;
    for (uint32_t i = 0; i < n_rays && status == LR_OK; i++) {
        const lr_shading_point *s = &w->shading_points[w->carried[i]];
        double open = 0;
        for (int a = 0; a < 3; a++)
            open += s->path->weight[a] * (1 - s->bsdf.transparency[a]) / 3;
        if (w->wave.instance[i] == LR_NOWHERE)
            w->pixels[s->path->pixel].ao += open;
    }
    return status;
}
