/* Path tracing in waves: all paths of a stretch of pixels, one bounce at a time.
 *
 * Every round empties one queue and fills the next. A wave takes whole pixels, so that a
 * pixel's sums are added in the same order whatever the stretch. Paths at their last bounce
 * are traced in waves of their own: where these can only find the world, they ask no more
 * than whether anything is hit.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/path_trace.h"

#include "base/error.h"
#include "render/integrator/direct_light.h"
#include "render/integrator/medium_stack.h"
#include "render/integrator/passes.h"
#include "render/integrator/path_record.h"
#include "render/integrator/scatter.h"
#include "render/integrator/shading_point.h"
#include "render/lights/environment.h"
#include "render/lights/light.h"

/* Add a light that the path has met. */
static void add(const lr_job *job, const lr_path *path, uint64_t light_index, const double rgb[3],
                const double weight[3], double share)
{
    double contribution[3];
    for (int a = 0; a < 3; a++)
        contribution[a] = share * weight[a] * rgb[a];
    lr_add_light(job, path->pixel, path->bounces[LR_RAY_CAMERA] - 1, contribution);
    lr_record_found(job, path, light_index, share, contribution);
}

/* Where the path, which now goes along d, was scattered last. */
static void scattered_at(const lr_path *path, const double d[3], double o[3])
{
    for (int a = 0; a < 3; a++)
        o[a] = path->origin[a] - path->travelled * d[a];
}

/* The weight, by multiple importance sampling, of a light that a ray scattered at o hits;
 * light sampling chooses the same direction with the density pdf. */
static double found_share(const lr_job *job, const lr_path *path, uint64_t light_index,
                          const double o[3], double pdf)
{
    if (!(path->pdf < INFINITY) || pdf == 0)
        return 1;
    return lr_mis(path->pdf, pdf * lr_light_probability(job->scene, path, light_index, o));
}

/* The light, if the path meets it before its end; it was scattered at o. */
static void find_light(const lr_job *job, const lr_path *path, uint64_t light_index,
                       const double o[3], const double d[3], double length)
{
    const lr_light *light = &job->scene->lights[light_index];
    double t, color[3], pdf, weight[3];
    if ((light->visibility & path->visibility) == 0 ||
        !lr_light_hit(light, o, d, path->travelled + length, &t, color, &pdf) ||
        t < path->travelled)
        return;
    memcpy(weight, path->throughput, sizeof weight);
    lr_medium_stack_absorb(job->scene, &path->media, t - path->travelled, weight);
    add(job, path, light_index, color, weight, found_share(job, path, light_index, o, pdf));
    for (int a = 0; a < 3 && path->seen; a++)
        job->workspace->pixels[path->pixel].emission[a] += weight[a] * color[a];
}

/* Lights with extent that the path meets before its end. */
static void find_lights(const lr_job *job, const lr_path *path, const double d[3], double length)
{
    const lr_light_tree *light_tree = &job->scene->light_tree;
    const double t_max = path->travelled + length;
    lr_light_walk walk;
    double o[3];
    scattered_at(path, d, o);
    lr_light_tree_start(light_tree, &walk);
    for (uint64_t light_index;
         (light_index = lr_light_tree_next(light_tree, &walk, o, d, t_max)) != LR_LIGHT_NONE;)
        find_light(job, path, light_index, o, d, length);
}

/* The path goes off into the world. */
static void miss(const lr_job *job, const lr_path *path, const double d[3])
{
    const lr_scene *scene = job->scene;
    lr_sum *pixel = &job->workspace->pixels[path->pixel];
    const bool transparent = path->seen && scene->film_transparent;
    double rgb[3];
    if (transparent)
        pixel->alpha -= (path->throughput[0] + path->throughput[1] + path->throughput[2]) / 3;
    if ((scene->world_visibility & path->visibility) == 0)
        return;
    lr_environment_radiance(&scene->environment, d, rgb);
    for (int a = 0; a < 3 && path->seen; a++)
        pixel->environment[a] += path->throughput[a] * rgb[a];
    if (transparent)
        return;
    double o[3];
    scattered_at(path, d, o);
    add(job, path, scene->n_lights, rgb, path->throughput,
        found_share(job, path, scene->n_lights, o, lr_environment_pdf(&scene->environment, d)));
}

/* Take up to `room` rays of whole pixels from *pixel on into a wave; those of
 * paths that are scattered no more, or the others. Returns how many. */
static uint32_t fill_batch(const lr_job *job, uint32_t *pixel, uint32_t n_pixels, bool last)
{
    lr_workspace *w = job->workspace;
    uint32_t n = 0;
    for (; *pixel < n_pixels && n + w->now.n[*pixel] <= w->room; ++*pixel)
        for (uint32_t k = 0; k < w->now.n[*pixel]; k++) {
            lr_path *path = &w->now.paths[(size_t)*pixel * job->branches + k];
            if (path->last != last)
                continue;
            lr_aim(&w->wave, n, path->origin, path->direction, path->t_max);
            w->wave.from[n] = path->from;
            w->wave.start[n] = path->start;
            w->wave.visibility[n] = path->visibility;
            w->traced[n++] = path;
        }
    return n;
}

/* The emission of a shading point. */
static void add_emission(const lr_job *job, const lr_shading_point *s)
{
    lr_sum *pixel = &job->workspace->pixels[s->path->pixel];
    if ((s->material->flags & LR_MATERIAL_EMITS) == 0)
        return;
    add(job, s->path, LR_OWN_EMISSION, s->bsdf.emission, s->path->throughput, 1);
    for (int a = 0; a < 3 && s->path->seen; a++)
        pixel->emission[a] += s->path->throughput[a] * s->bsdf.emission[a];
}

/* What the camera sees of a holdout is a hole in the picture; what its material lets straight
 * through is left. True where that is nothing. */
static bool hold_out(const lr_job *job, lr_shading_point *s)
{
    double held = 0, left = 0;
    for (int a = 0; a < 3; a++) {
        held += s->path->throughput[a] * (1 - s->bsdf.transparency[a]) / 3;
        left = fmax(left, s->bsdf.transparency[a]);
    }
    job->workspace->pixels[s->path->pixel].alpha -= held;
    for (int kind = LR_RAY_DIFFUSE; kind <= LR_RAY_TRANSMISSION; kind++)
        s->bsdf.share[kind] = 0;
    memset(s->bsdf.emission, 0, sizeof s->bsdf.emission);
    s->bsdf.n = 0;
    return !(left > 0);
}

/* Lights, world and surfaces that the wave has hit; the surfaces become shading points.
 * Returns their number; some are missing where the watch says stop. */
static uint32_t process_hits(const lr_job *job, uint32_t n, bool any)
{
    lr_workspace *w = job->workspace;
    uint32_t n_shading_points = 0;
    for (uint32_t i = 0; i < n && !lr_stopped(job->watch); i++) {
        lr_path *path = w->traced[i];
        const bool hit = w->wave.instance[i] != LR_NOWHERE;
        const double unit = sqrt(lr_dot(path->direction, path->direction));
        const double length = w->wave.t[i] * unit;
        const double d[3] = {path->direction[0] / unit, path->direction[1] / unit,
                             path->direction[2] / unit};
        if (job->scene->has_lights)
            find_lights(job, path, d, length);
        if (path->media.n > 0)
            lr_medium_stack_absorb(job->scene, &path->media, length, path->throughput);
        if (!hit) {
            lr_record_hit(job, i, NULL);
            miss(job, path, d);
        } else if (!any) {
            lr_shading_point *s = &w->shading_points[n_shading_points++];
            lr_surface_find(job->scene, &w->wave, i, &path->media, s);
            s->path = path;
            s->ray = i;
            s->left = (path->t_max - w->wave.t[i]) * unit;
            lr_record_hit(job, i, s);
            if (path->seen && job->scene->instances[s->instance].holdout && hold_out(job, s))
                n_shading_points--;
            else
                add_emission(job, s);
        }
    }
    return n_shading_points;
}

/* The passes of the camera's own rays. */
static lr_status write_primary_passes(const lr_job *job, uint32_t n_shading_points, uint64_t first,
                                      bool geometry)
{
    if (geometry)
        lr_write_geometry(job, n_shading_points, first);
    for (uint32_t k = 0; k < n_shading_points; k++)
        lr_add_mist(job, &job->workspace->shading_points[k]);
    return job->passes->ao != NULL ? lr_ambient_occlusion(job, n_shading_points) : LR_OK;
}

static lr_status trace_batch(const lr_job *job, uint32_t n, bool any, uint64_t first, bool camera,
                             bool geometry)
{
    lr_workspace *w = job->workspace;
    const lr_cast_options options = {
        .t_min = camera ? job->scene->camera.clip_start : 0,
        .any = any,
        .leaving = !camera,
        .steps = (geometry && job->passes->steps != NULL) || job->tile->record != NULL,
        .trace = job->tile->trace,
    };
    lr_status status = lr_cast_wave(job, n, &options);
    if (status != LR_OK)
        return status;
    if (geometry)
        lr_write_steps(job, n, first);
    const uint32_t n_shading_points = process_hits(job, n, any);
    for (uint32_t k = 0; k < n_shading_points; k++)
        lr_scatter_choose(job, &w->shading_points[k],
                          &w->free_slots[w->shading_points[k].path->pixel]);
    status = write_primary_passes(job, n_shading_points, first, geometry);
    if (status == LR_OK)
        status = lr_light_shading_points(job, n_shading_points);
    for (uint32_t k = 0; k < n_shading_points && status == LR_OK; k++)
        lr_scatter_on(job, &w->shading_points[k]);
    return status;
}

/* All paths of the present queue, those that are scattered first. */
static lr_status trace_queue(const lr_job *job, uint32_t n_pixels, uint64_t first, bool camera,
                             bool geometry)
{
    const lr_scene *scene = job->scene;
    lr_status status = LR_OK;
    for (int last = 0; last < 2; last++) {
        const bool any = last != 0 && !scene->has_clear && !scene->has_media && !scene->shines &&
                         !scene->has_lights && job->tile->record == NULL;
        for (uint32_t pixel = 0; pixel < n_pixels && status == LR_OK;) {
            const uint32_t n = fill_batch(job, &pixel, n_pixels, last != 0);
            if (n > 0)
                status = trace_batch(job, n, any, first, camera, geometry);
        }
    }
    return status;
}

lr_status lr_trace_paths(const lr_job *job, uint32_t n_pixels, uint64_t first, bool geometry)
{
    lr_workspace *w = job->workspace;
    for (bool camera = true;; camera = false) {
        uint32_t n = 0;
        for (uint32_t p = 0; p < n_pixels; p++) {
            n += w->now.n[p];
            w->next.n[p] = 0;
            w->free_slots[p] = job->branches - w->now.n[p];
        }
        if (lr_stopped(job->watch))
            return lr_fail_stopped(job->error);
        if (n == 0)
            return LR_OK;
        const lr_status status = trace_queue(job, n_pixels, first, camera, geometry && camera);
        if (status != LR_OK)
            return status;
        const lr_queue swap = w->now;
        w->now = w->next;
        w->next = swap;
    }
}
