/* Path tracing in waves: all paths of a range of pixels, one bounce at a time.
 *
 * Every round empties one queue and fills the next. A wave takes whole pixels, so that a
 * pixel's sums are added in the same order whatever the range. Paths at their last bounce
 * are traced in separate waves: if only the world can contribute, these test for any hit.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/path_trace.h"

#include "base/error.h"
#include "render/integrator/direct_light.h"
#include "render/integrator/intersect_closest.h"
#include "render/integrator/medium_stack.h"
#include "render/integrator/passes.h"
#include "render/integrator/path_record.h"
#include "render/integrator/scatter.h"
#include "render/integrator/shading_point.h"
#include "render/integrator/volume_light.h"
#include "render/integrator/volume_scatter.h"
#include "render/lights/environment.h"
#include "render/lights/light.h"

/* Add a light that the path has met to its pixel. */
static void add(const lr_path *path, uint64_t light_index, const double rgb[3],
                const double throughput[3], double mis_weight, lr_film *film)
{
    double contribution[3];
    for (int a = 0; a < 3; a++)
        contribution[a] = mis_weight * throughput[a] * rgb[a];
    lr_film_add(film, path->pixel, path->bounces[LR_RAY_CAMERA] - 1, contribution);
    lr_record_found(path, light_index, mis_weight, contribution, film->tile->record);
}

/* The point where the path, now along d, was scattered last. */
static void scattered_at(const lr_path *path, const double d[3], double o[3])
{
    for (int a = 0; a < 3; a++)
        o[a] = path->origin[a] - path->travelled * d[a];
}

/* The MIS weight of a light that a ray scattered at o hits; light sampling chooses the same
 * direction with the density pdf. */
static double mis_weight_of_hit(const lr_scene *scene, const lr_path *path, uint64_t light_index,
                                const double o[3], double pdf)
{
    if (!(path->pdf < INFINITY) || pdf == 0)
        return 1;
    return lr_mis(path->pdf, pdf * lr_light_probability(scene, path, light_index, o));
}

/* Add the light if the path, scattered at o, meets it from a distance to its origin on, and before
 * its end: reads the path; writes its pixel's sums. */
static lr_status find_light(const lr_context *context, const lr_path *path, uint64_t light_index,
                            const double o[3], const double d[3], double begin, double length,
                            lr_batch *batch, lr_film *film)
{
    const lr_scene *scene = context->scene;
    const lr_light *light = &scene->lights[light_index];
    double t, color[3], pdf, throughput[3], transmittance;
    if ((light->visibility & path->visibility) == 0 ||
        !lr_light_hit(light, o, d, path->travelled + length, &t, color, &pdf) ||
        t < path->travelled + begin)
        return LR_OK;
    const lr_status status =
        lr_find_transmittance(context, o, d, path->travelled + begin, t, path->visibility,
                              LR_NOWHERE, batch, &transmittance);
    if (status != LR_OK)
        return status;
    memcpy(throughput, path->throughput, sizeof throughput);
    lr_medium_stack_absorb(scene, &path->media, path->visibility, t - path->travelled - begin,
                           throughput);
    for (int a = 0; a < 3; a++)
        throughput[a] *= transmittance;
    add(path, light_index, color, throughput, mis_weight_of_hit(scene, path, light_index, o, pdf),
        film);
    for (int a = 0; a < 3 && path->seen; a++)
        film->pixels[path->pixel].emission[a] += throughput[a] * color[a];
    return LR_OK;
}

/* Add lights with extent that the path meets from a distance on, and before its end: reads the
 * path; writes its pixel's sums. Uses the batch. */
static lr_status find_lights(const lr_context *context, const lr_path *path, const double d[3],
                             double begin, double length, lr_batch *batch, lr_film *film)
{
    const lr_light_tree *light_tree = &context->scene->light_tree;
    lr_status status = LR_OK;
    const double t_max = path->travelled + length;
    lr_light_walk walk;
    double o[3];
    scattered_at(path, d, o);
    lr_light_tree_start(light_tree, &walk);
    for (uint64_t light_index;
         status == LR_OK &&
         (light_index = lr_light_tree_next(light_tree, &walk, o, d, t_max)) != LR_LIGHT_NONE;)
        status = find_light(context, path, light_index, o, d, begin, length, batch, film);
    return status;
}

/* Add what volumes emit along the path's ray, and let them absorb what comes from behind them:
 * writes its throughput and its pixel's sums. */
static void pass_volumes(const lr_volume_light *light, uint32_t i, lr_path *path, lr_film *film)
{
    const double *color = light->color[i];
    if (light->n_met[i] == 0 && color[0] == 0 && color[1] == 0 && color[2] == 0)
        return;
    add(path, LR_VOLUME_EMISSION, color, path->throughput, 1, film);
    for (int a = 0; a < 3; a++) {
        if (path->seen)
            film->pixels[path->pixel].emission[a] += path->throughput[a] * color[a];
        path->throughput[a] *= light->transmittance[i];
    }
}

/* Add the world for a path that misses: reads it; writes its pixel's sums. */
static void miss(const lr_scene *scene, const lr_path *path, const double d[3], lr_film *film)
{
    lr_pixel_sums *pixel = &film->pixels[path->pixel];
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
    const double pdf = lr_environment_pdf(&scene->environment, d);
    add(path, scene->n_lights, rgb, path->throughput,
        mis_weight_of_hit(scene, path, scene->n_lights, o, pdf), film);
}

/* Take rays of whole pixels from *pixel on, as many as there is room for; those of paths that are
 * scattered no more, or the others. Reads the paths; writes the rays. */
static void fill_batch(const lr_path_queue *paths, uint32_t n_pixels, bool last, uint32_t *pixel,
                       lr_ray_queue *rays)
{
    rays->n = 0;
    for (; *pixel < n_pixels && rays->n + paths->n[*pixel] <= rays->capacity; ++*pixel)
        for (uint32_t k = 0; k < paths->n[*pixel]; k++) {
            const size_t slot = lr_slot_of(paths, *pixel) + k;
            const lr_path *path = &paths->paths[slot];
            if (path->last != last)
                continue;
            const uint32_t i = rays->n++;
            lr_aim(rays, i, path->origin, path->direction, path->t_max);
            rays->from[i] = path->from;
            rays->start[i] = path->start;
            memcpy(rays->way[i], path->way, sizeof path->way);
            rays->visibility[i] = path->visibility;
            rays->owner[i] = (uint32_t)slot;
        }
}

/* Add the emission of a shading point: reads it; writes its pixel's sums. */
static void add_emission(const lr_shading_point *s, lr_film *film)
{
    lr_pixel_sums *pixel = &film->pixels[s->path->pixel];
    if ((s->material->flags & LR_MATERIAL_EMITS) == 0)
        return;
    add(s->path, LR_OWN_EMISSION, s->bsdf.emission, s->path->throughput, 1, film);
    for (int a = 0; a < 3 && s->path->seen; a++)
        pixel->emission[a] += s->path->throughput[a] * s->bsdf.emission[a];
}

/* A holdout seen by the camera: only what its material transmits straight is left. True where
 * that is nothing. Writes the shading point's BSDF and alpha. */
static bool hold_out(lr_shading_point *s, lr_film *film)
{
    double held = 0, left = 0;
    for (int a = 0; a < 3; a++) {
        held += s->path->throughput[a] * (1 - s->bsdf.transparency[a]) / 3;
        left = fmax(left, s->bsdf.transparency[a]);
    }
    film->pixels[s->path->pixel].alpha -= held;
    for (int kind = LR_RAY_DIFFUSE; kind <= LR_RAY_TRANSMISSION; kind++)
        s->bsdf.albedo[kind] = 0;
    memset(s->bsdf.emission, 0, sizeof s->bsdf.emission);
    s->bsdf.n = 0;
    return !(left > 0);
}

/* Process the wave's hits of lights, world and surfaces: reads rays, hits and the light of volumes;
 * writes the absorption into the paths' throughputs, the pixels' sums, and shading points. Uses the
 * batch. Some are missing where stopped. */
static lr_status process_hits(const lr_context *context, double t_min, bool any, lr_wave *wave,
                              lr_path *paths, lr_shading_queue *shading_points, lr_film *film)
{
    const lr_scene *scene = context->scene;
    const lr_ray_queue *rays = &wave->rays;
    const lr_hit_queue *hits = &wave->hits;
    lr_status status = LR_OK;
    shading_points->n = shading_points->n_closures = 0;
    for (uint32_t i = 0; i < rays->n && status == LR_OK && !lr_stopped(context->watch); i++) {
        lr_path *path = &paths[rays->owner[i]];
        const bool hit = hits->instance[i] != LR_NOWHERE;
        const double unit = sqrt(lr_dot(path->direction, path->direction));
        const double begin = t_min * unit, length = hits->t[i] * unit;
        const double d[3] = {path->direction[0] / unit, path->direction[1] / unit,
                             path->direction[2] / unit};
        if (scene->has_lights)
            status = find_lights(context, path, d, begin, length, &wave->memory.batch, film);
        if (scene->n_participants > 0 || scene->has_fog)
            pass_volumes(&wave->volume_light, i, path, film);
        if (path->media.n > 0)
            lr_medium_stack_absorb(scene, &path->media, path->visibility, length - begin,
                                   path->throughput);
        if (!hit) {
            lr_record_hit(path, hits, i, NULL, context->tile->record);
            miss(scene, path, d, film);
        } else if (!any) {
            lr_shading_point *s = lr_next_point(shading_points);
            lr_surface_find(scene, rays, hits, i, &path->media, !path->last, s);
            s->path = path;
            s->left = (path->t_max - hits->t[i]) * unit;
            lr_record_hit(path, hits, i, s, context->tile->record);
            if (path->seen && scene->instances[s->instance].holdout && hold_out(s, film))
                continue;
            add_emission(s, film);
            lr_keep_point(shading_points);
        }
    }
    return status;
}

/* The passes of primary rays: reads the shading points; writes passes and sums. Uses the
 * wave. */
static lr_status write_primary_passes(const lr_context *context, bool geometry,
                                      const lr_shading_queue *shading_points, lr_wave *wave,
                                      lr_film *film)
{
    if (geometry)
        lr_write_geometry(context->scene, shading_points, film);
    for (uint32_t k = 0; k < shading_points->n; k++)
        lr_add_mist(context->scene, &shading_points->points[k], film);
    return film->passes->ao != NULL ? lr_ambient_occlusion(context, shading_points, wave, film)
                                    : LR_OK;
}

/* What volumes do to the wave's rays: reads these and their hits; writes the light of volumes and
 * the points that scatter. */
static lr_status find_volumes(const lr_context *context, double t_min, lr_queues *queues)
{
    lr_wave *wave = &queues->wave;
    const lr_scene *scene = context->scene;
    lr_volume_scatter *scatter = scene->scatters ? &wave->volume_scatter : NULL;
    queues->volume_points.n = 0;
    if (scene->n_participants == 0 && !scene->has_fog)
        return LR_OK;
    if (scatter != NULL)
        lr_scatter_draw(queues->now.paths, &wave->rays, scatter);
    const lr_status status =
        lr_find_volume_light(context, t_min, queues->now.paths, &wave->rays, wave->hits.t,
                             &wave->memory.batch, &wave->volume_light, scatter);
    if (status != LR_OK || scatter == NULL)
        return status;
    return lr_find_volume_points(context, t_min, queues->now.paths, wave, &queues->volume_points);
}

/* Decide which rays are continued: reads the points of volumes and surfaces, both in the order of
 * the wave; writes their probabilities, and the slots that are taken. */
static void choose_rays(const lr_context *context, lr_queues *queues)
{
    lr_volume_queue *volume_points = &queues->volume_points;
    lr_shading_queue *shading_points = &queues->shading_points;
    for (uint32_t i = 0, k = 0; i < volume_points->n; i++) {
        lr_volume_point *point = &volume_points->points[i];
        const lr_path *path = &queues->now.paths[point->owner];
        while (k < shading_points->n && shading_points->points[k].path < path)
            k++;
        const bool hit = k < shading_points->n && shading_points->points[k].path == path;
        lr_scatter_choose_volume(context, point, hit ? &shading_points->points[k] : NULL,
                                 &queues->next.free_slots[path->pixel]);
    }
    for (uint32_t k = 0; k < shading_points->n; k++) {
        lr_shading_point *s = &shading_points->points[k];
        lr_scatter_choose(context, s, &queues->next.free_slots[s->path->pixel]);
    }
}

/* Light and continue the points in volumes: reads them; writes the film, and paths into the next
 * queue. Uses the wave and the shading points. */
static lr_status scatter_in_volumes(const lr_context *context, lr_queues *queues, lr_film *film)
{
    lr_shading_queue *shading_points = &queues->shading_points;
    shading_points->n = shading_points->n_closures = 0;
    if (queues->volume_points.n == 0)
        return LR_OK;
    for (uint32_t k = 0; k < queues->volume_points.n; k++) {
        lr_volume_point_find(context->scene, &queues->volume_points.points[k],
                             context->tile->trace.normal, lr_next_point(shading_points));
        lr_keep_point(shading_points);
    }
    const lr_status status =
        lr_light_shading_points(context, shading_points, &queues->shadow_rays, &queues->wave, film);
    for (uint32_t k = 0; k < shading_points->n && status == LR_OK; k++)
        lr_scatter_on(context, &shading_points->points[k], &queues->next);
    return status;
}

/* One wave through all stages: reads its rays; writes the film, and paths into the next queue. */
static lr_status trace_batch(const lr_context *context, bool any, bool camera, bool geometry,
                             lr_queues *queues, lr_film *film)
{
    const lr_intersect_options options = {
        .t_min = camera ? context->scene->camera.clip_start : 0,
        .any = any,
        .leaving = !camera,
        .steps =
            (camera && geometry && film->passes->steps != NULL) || context->tile->record != NULL,
    };
    lr_wave *wave = &queues->wave;
    lr_shading_queue *shading_points = &queues->shading_points;
    lr_status status =
        lr_intersect_closest(context, &options, &wave->rays, &wave->hits, &wave->memory);
    if (status != LR_OK)
        return status;
    if (camera && geometry)
        lr_write_steps(queues->now.paths, &wave->rays, &wave->hits, film);
    status = find_volumes(context, options.t_min, queues);
    if (status == LR_OK)
        status = process_hits(context, options.t_min, any, wave, queues->now.paths, shading_points,
                              film);
    if (status == LR_OK)
        choose_rays(context, queues);
    if (status == LR_OK)
        status = write_primary_passes(context, geometry, shading_points, wave, film);
    if (status == LR_OK)
        status = lr_light_shading_points(context, shading_points, &queues->shadow_rays, wave, film);
    for (uint32_t k = 0; k < shading_points->n && status == LR_OK; k++)
        lr_scatter_on(context, &shading_points->points[k], &queues->next);
    return status == LR_OK ? scatter_in_volumes(context, queues, film) : status;
}

/* All paths of the present queue, those that are scattered first. */
static lr_status trace_queue(const lr_context *context, bool camera, bool geometry,
                             lr_queues *queues, lr_film *film)
{
    const lr_scene *scene = context->scene;
    lr_status status = LR_OK;
    for (int last = 0; last < 2; last++) {
        const bool any = last != 0 && !scene->has_clear && !scene->has_media && !scene->emits &&
                         !scene->has_lights && scene->n_participants == 0 &&
                         context->tile->record == NULL;
        for (uint32_t pixel = 0; pixel < film->n_pixels && status == LR_OK;) {
            fill_batch(&queues->now, film->n_pixels, last != 0, &pixel, &queues->wave.rays);
            if (queues->wave.rays.n > 0)
                status = trace_batch(context, any, camera, geometry, queues, film);
        }
    }
    return status;
}

lr_status lr_trace_paths(const lr_context *context, bool geometry, lr_queues *queues, lr_film *film)
{
    for (bool camera = true;; camera = false) {
        lr_path_queue *now = &queues->now, *next = &queues->next;
        uint32_t n = 0;
        for (uint32_t p = 0; p < film->n_pixels; p++) {
            n += now->n[p];
            next->n[p] = 0;
            next->free_slots[p] = next->slots - now->n[p];
        }
        if (lr_stopped(context->watch))
            return lr_fail_stopped(context->error);
        if (n == 0)
            return LR_OK;
        const lr_status status = trace_queue(context, camera, geometry, queues, film);
        if (status != LR_OK)
            return status;
        const lr_path_queue swap = *now;
        *now = *next;
        *next = swap;
    }
}
