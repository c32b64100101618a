/* Waves of light.
 *
 * Lambertian surfaces: radiance = color / pi * irradiance. One wave per light
 * asks whether it reaches the surfels that face it; one wave of cosine-weighted
 * rays, one per surfel, asks for the world. Light from the other side of the
 * surface than the viewer's does not reach the viewer.
 *
 * A ray of light leaves in the very cell and on the very side of the hit, so
 * that it needs no offset to clear its own surface.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/waves.h"

#include "render/cast.h"
#include "render/sampling.h"

static const double PI = 3.141592653589793;

/* Where a light is seen from p: d leads there with t in 0..*t_max. Returns the
 * irradiance of a surface that faces it, as a share of the light's color. */
static double look(const lr_light *light, const double p[3], double d[3], double *t_max)
{
    if (light->kind == LR_LIGHT_SUN) {
        memcpy(d, light->direction, 3 * sizeof *d);
        *t_max = INFINITY;
        return 1;
    }
    for (int a = 0; a < 3; a++)
        d[a] = light->position[a] - p[a];
    *t_max = 1;
    return 1 / lr_dot(d, d);
}

static void aim(lr_workspace *w, uint32_t ray, uint32_t surfel, const double d[3])
{
    const lr_surfel *s = &w->surfels[surfel];
    lr_wave *wave = &w->wave;
    wave->ray.ox[ray] = s->origin[0];
    wave->ray.oy[ray] = s->origin[1];
    wave->ray.oz[ray] = s->origin[2];
    wave->ray.dx[ray] = d[0];
    wave->ray.dy[ray] = d[1];
    wave->ray.dz[ray] = d[2];
    wave->from[ray] = s->instance;
    wave->start[ray] = s->start;
    w->lit[ray] = surfel;
}

/* Add color x light x reflectance for every ray of the wave that nothing stops. */
static void receive(const lr_workspace *w, uint32_t n, const double color[3], bool all)
{
    for (uint32_t i = 0; i < n; i++) {
        if (!all && w->wave.instance[i] != LR_NOWHERE)
            continue;
        const lr_surfel *s = &w->surfels[w->lit[i]];
        for (int a = 0; a < 3; a++)
            w->sum[s->pixel][a] += w->light[i] * color[a] * s->color[a];
    }
}

static lr_status cast(const lr_job *job, uint32_t n, uint32_t visibility, double t_max)
{
    const lr_cast_options options = {
        .visibility = visibility,
        .t_max = t_max,
        .any = true,
        .leaving = true,
        .trace = job->trace,
    };
    return lr_cast(job->scene, job->workspace, n, &options, job->counters, job->watch, job->error);
}

static lr_status light_by(const lr_job *job, const lr_light *light, uint32_t n)
{
    lr_workspace *w = job->workspace;
    uint32_t n_rays = 0;
    double t_max = 0;
    for (uint32_t k = 0; k < n; k++) {
        const lr_surfel *s = &w->surfels[k];
        double d[3];
        const double facing = look(light, s->origin, d, &t_max);
        const double cosine = lr_dot(s->normal, d) / sqrt(lr_dot(d, d));
        if (!(cosine > 0) || !(facing < INFINITY))
            continue;
        aim(w, n_rays, k, d);
        w->light[n_rays++] = cosine * facing / PI;
    }
    const bool stopped = (light->visibility & LR_VISIBLE_SHADOW) != 0;
    if (stopped) {
        const lr_status status = cast(job, n_rays, LR_VISIBLE_SHADOW, t_max);
        if (status != LR_OK)
            return status;
    }
    receive(w, n_rays, light->color, !stopped);
    return LR_OK;
}

static lr_status light_by_world(const lr_job *job, uint32_t n, uint32_t sample)
{
    lr_workspace *w = job->workspace;
    uint32_t n_rays = 0;
    for (uint32_t k = 0; k < n; k++) {
        const lr_surfel *s = &w->surfels[k];
        double u, v, d[3];
        lr_sphere_sample(w->hash[s->pixel], sample, &u, &v);
        lr_cosine_direction(s->normal, u, v, d);
        aim(w, n_rays, k, d);
        w->light[n_rays++] = 1;
    }
    const lr_status status = cast(job, n_rays, LR_VISIBLE_DIFFUSE, INFINITY);
    if (status == LR_OK)
        receive(w, n_rays, job->scene->environment.color, false);
    return status;
}

lr_status lr_light_surfels(const lr_job *job, uint32_t n, uint32_t sample)
{
    const lr_scene *scene = job->scene;
    lr_status status = LR_OK;
    for (uint64_t k = 0; k < scene->n_lights && status == LR_OK; k++)
        status = light_by(job, &scene->lights[k], n);
    if (scene->world_shines && status == LR_OK)
        status = light_by_world(job, n, sample);
    return status;
}
