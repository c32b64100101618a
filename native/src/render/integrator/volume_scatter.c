/* Where volumes scatter the paths of a wave.
 *
 * Light that is scattered on a ray's way is an integral over the way, of transmittance times
 * scattering times what arrives there; it is estimated at one point, beside what lies behind the
 * volumes. The point is drawn with the density of extinction times transmittance, by the inverse of
 * the transmittance: no steps, and no bound of the extinction. What is left as weight is the albedo
 * there times what the volume extinguishes in all. Of several volumes one is chosen in proportion
 * to what it extinguishes by itself; the others dim the light up to the point. What fills the
 * solids that a ray is in counts as one more.
 *
 * Source: Novak, Georgiev, Hanika, Jarosz, Monte Carlo methods for volumetric light transport
 * simulation, 2018 (regular tracking). Departure: within cells optical depth is a polynomial.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/volume_scatter.h"

#include "render/film/sampling.h"
#include "render/integrator/medium.h"
#include "render/integrator/path_record.h"
#include "render/integrator/volume_light.h"

enum { WHERE = 48, ON_POINT = 49 }; /* choices: see lr_key */

void lr_scatter_draw(const lr_path *paths, const lr_ray_queue *rays, lr_volume_scatter *scatter)
{
    for (uint32_t i = 0; i < rays->n; i++) {
        const lr_path *path = &paths[rays->owner[i]];
        scatter->opacity[i] = 0;
        scatter->participant[i] = LR_NOWHERE;
        scatter->t[i] = INFINITY;
        if (path->last)
            scatter->u[i][1] = -1;
        else
            lr_sample_pair(lr_key(path->key, WHERE), path->sample, scatter->u[i]);
    }
}

/* The places in participant m of the rays that have chosen it. */
static lr_status find_places(const lr_context *context, uint32_t m, double t_min, lr_wave *wave)
{
    const lr_participant *participant = &context->scene->participants[m];
    lr_volume_scatter *scatter = &wave->volume_scatter;
    lr_batch *batch = &wave->memory.batch;
    const uint32_t *ray_of = wave->volume_light.ray_of;
    const lr_participant_choice choice = {m, scatter->participant};
    const uint32_t n = lr_fill_participant(context->scene, participant, &choice, t_min, &wave->rays,
                                           wave->hits.t, wave->volume_light.ray_of, batch);
    for (uint32_t k = 0; k < n; k++)
        batch->stop[k] = 1 - scatter->u[ray_of[k]][0] * scatter->own[ray_of[k]];
    const lr_status status = lr_sum_up(context, participant->instance, true, n, batch);
    for (uint32_t k = 0; k < n && status == LR_OK; k++) {
        double *albedo = scatter->albedo[ray_of[k]];
        scatter->t[ray_of[k]] = batch->hit.t[k];
        albedo[0] = batch->hit.red[k];
        albedo[1] = batch->hit.green[k];
        albedo[2] = batch->hit.blue[k];
    }
    return status;
}

/* The albedo of a point as what its throughput takes and a colour that is left to its response:
 * surfaces reflect their highlights in white. Where there are none, all of it is throughput. */
static void part_albedo(const lr_placed *placed, const double albedo[3], double taken[3],
                        double color[3])
{
    const double most = fmax(albedo[0], fmax(albedo[1], albedo[2]));
    const bool parts = placed->gradient.amount > 0 && most > 0;
    for (int a = 0; a < 3; a++) {
        taken[a] = parts ? most : albedo[a];
        color[a] = parts ? albedo[a] / most : 1;
    }
}

/* The places in what fills solids of the rays that have chosen it. */
static void find_places_in_media(const lr_scene *scene, double t_min, const lr_path *paths,
                                 lr_wave *wave)
{
    lr_volume_scatter *scatter = &wave->volume_scatter;
    for (uint32_t i = 0; i < wave->rays.n; i++) {
        if (scatter->participant[i] != LR_IN_MEDIUM)
            continue;
        const lr_path *path = &paths[wave->rays.owner[i]];
        const double unit = sqrt(lr_dot(path->direction, path->direction));
        const double length = (wave->hits.t[i] - t_min) * unit;
        double o[3], d[3];
        lr_medium medium;
        lr_lamps_beside lamps;
        for (int a = 0; a < 3; a++) {
            o[a] = path->origin[a] + t_min * path->direction[a];
            d[a] = path->direction[a] / unit;
        }
        lr_medium_find(scene, &path->media, path->visibility, &medium);
        lr_lamps_beside_find(
            scene, path, o, d, length,
            fmin(medium.extinction[0], fmin(medium.extinction[1], medium.extinction[2])), &lamps);
        const double t =
            lr_medium_draw(scene, &path->media, path->visibility, &medium, path->throughput, length,
                           &lamps, scatter->u[i], &scatter->medium[i], scatter->albedo[i]);
        scatter->t[i] = t_min + t / unit;
    }
}

/* Make the point of ray i, which is scattered; false where nothing is left of its light. */
static lr_status make_point(const lr_context *context, double t_min, const lr_path *path,
                            lr_wave *wave, uint32_t i, lr_volume_point *point)
{
    const lr_scene *scene = context->scene;
    const lr_volume_scatter *scatter = &wave->volume_scatter;
    const bool in_medium = scatter->participant[i] == LR_IN_MEDIUM;
    double others = 1;
    lr_status status = LR_OK;
    point->path = *path;
    point->owner = wave->rays.owner[i];
    point->t = scatter->t[i];
    if (in_medium) {
        point->instance = path->media.instance[scatter->medium[i]];
        point->phase = scene->materials[path->media.material[scatter->medium[i]]].phase;
    } else {
        point->instance = scene->participants[scatter->participant[i]].instance;
        point->phase = scene->instances[point->instance].phase;
    }
    if (wave->volume_light.n_met[i] + in_medium > 1)
        status = lr_find_transmittance(context, path->origin, path->direction, t_min, point->t,
                                       path->visibility, in_medium ? LR_NOWHERE : point->instance,
                                       &wave->memory.batch, &others);
    lr_path *to = &point->path;
    double albedo[3];
    part_albedo(&scene->instances[point->instance], scatter->albedo[i], albedo, point->color);
    const double unit = sqrt(lr_dot(path->direction, path->direction));
    lr_medium_stack_absorb(scene, &path->media, path->visibility, (point->t - t_min) * unit,
                           to->throughput);
    for (int a = 0; a < 3; a++) {
        to->throughput[a] *= scatter->opacity[i] * others * albedo[a];
        to->origin[a] += point->t * path->direction[a];
        to->direction[a] /= unit;
    }
    to->key = lr_key(path->key, ON_POINT);
    return status;
}

lr_status lr_find_volume_points(const lr_context *context, double t_min, const lr_path *paths,
                                lr_wave *wave, lr_volume_queue *points)
{
    const lr_scene *scene = context->scene;
    lr_status status = LR_OK;
    points->n = 0;
    for (uint32_t m = 0; m < scene->n_participants && status == LR_OK; m++)
        if (scene->participants[m].scatters)
            status = find_places(context, m, t_min, wave);
    if (scene->has_fog && status == LR_OK)
        find_places_in_media(scene, t_min, paths, wave);
    for (uint32_t i = 0; i < wave->rays.n && status == LR_OK; i++) {
        const lr_path *path = &paths[wave->rays.owner[i]];
        lr_volume_point *point = &points->points[points->n];
        if (!(wave->volume_scatter.t[i] < INFINITY))
            continue;
        status = make_point(context, t_min, path, wave, i, point);
        const double *left = point->path.throughput;
        if (!(fabs(left[0]) > 0 || fabs(left[1]) > 0 || fabs(left[2]) > 0))
            continue;
        points->n++;
        lr_record_scatter(point, path, context->tile->record);
    }
    return status;
}
