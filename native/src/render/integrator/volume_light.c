/* What participating instances do to rays before these hit a surface: they emit and absorb.
 *
 * Each instance's volume sums up light along the part of the ray that lies in its box; the rays of
 * a wave are one batch of it. Where a ray meets one such instance that is all, without steps. Where
 * it meets several, they may overlap, and their light and extinction add up at every point: the
 * ray's way through them is cut into intervals, in each of which the light of one is dimmed by half
 * of what the others absorb there, and the number of intervals is doubled until that changes
 * nothing that is seen. Intervals in which one is alone, or nothing emits, are exact at once. So it
 * is where they lie in solids that are filled; what fills these is homogeneous, and alone it is
 * a closed form.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/volume_light.h"

#include "base/affine.h"
#include "grid/trilinear.h"
#include "render/integrator/medium.h"
#include "trace/structure.h"

enum { FIRST_INTERVALS = 16, MOST_INTERVALS = 4096 };

/* The part of a ray from *begin to *end that lies in the box; false: none. */
static bool clip_to_box(const lr_box *box, const double o[3], const double d[3], double *begin,
                        double *end)
{
    for (int a = 0; a < 3; a++) {
        if (d[a] == 0) {
            if (!(o[a] >= box->lo[a] && o[a] <= box->hi[a]))
                return false;
            continue;
        }
        const double inverse = 1 / d[a];
        const double low = (box->lo[a] - o[a]) * inverse;
        const double high = (box->hi[a] - o[a]) * inverse;
        *begin = fmax(*begin, fmin(low, high));
        *end = fmin(*end, fmax(low, high));
    }
    return *begin < *end;
}

/* Put the part of a ray of world space into the batch of an instance. */
static void put(const lr_placed *placed, const double o[3], const double d[3], double begin,
                double end, uint32_t k, lr_batch *batch)
{
    double p[3], v[3];
    lr_map_point(placed->object_from_world, o, p);
    lr_map_vector(placed->object_from_world, d, v);
    lr_put_ray(&batch->ray, k, p, v);
    const double unit = placed->volume_unit;
    batch->length[k] = unit > 0 ? sqrt(lr_dot(d, d)) / unit : sqrt(lr_dot(v, v));
    batch->t_min[k] = begin;
    batch->t_max[k] = end;
}

lr_status lr_sum_up(const lr_context *context, uint32_t instance, bool stops, uint32_t n,
                    lr_batch *batch)
{
    lr_rays rays = lr_rays_of(batch);
    rays.t_min = batch->t_min;
    rays.length = batch->length;
    rays.stop = stops ? batch->stop : NULL;
    const lr_hits sums = {
        .t = batch->hit.t,
        .red = batch->hit.red,
        .green = batch->hit.green,
        .blue = batch->hit.blue,
        .transmittance = batch->hit.transmittance,
    };
    const lr_watch stop = lr_stop_of(context);
    lr_trace_options options = context->tile->trace;
    options.mode = LR_MODE_VOLUME;
    options.sampling = stops ? LR_SAMPLING_EXACT : options.sampling;
    lr_counters counters = {0}; /* the cells of surfaces alone are told of */
    const lr_status status = lr_trace(context->scene->instances[instance].structure, &rays, n,
                                      &options, &sums, &counters, &stop, context->error);
    if (context->counters != NULL) {
        context->counters->pairs += counters.pairs;
        context->counters->in_lanes += counters.in_lanes;
    }
    return status;
}

/* Entry k of the batch. */
static double get_light(const lr_batch *batch, uint32_t k, double color[3])
{
    color[0] = batch->hit.red[k];
    color[1] = batch->hit.green[k];
    color[2] = batch->hit.blue[k];
    return batch->hit.transmittance[k];
}

/* ---- several along one ray ------------------------------------------------------- */

/* The part of a ray that goes through several participating instances. */
typedef struct crossing {
    double o[3], d[3], begin, end;
    uint32_t visibility;
    lr_medium medium; /* around them, */
    double unit;      /* and the length of d */
} crossing;

enum { AT_ONCE = 64 };

/* Light behind what lets through: color += through * own, then through *= own_through. */
static void put_behind(const double own[3], const double own_through[3], double color[3],
                       double through[3])
{
    for (int a = 0; a < 3; a++) {
        color[a] += through[a] * own[a];
        through[a] *= own_through[a];
    }
}

/* Add the light of `count` of n intervals, from the first on, front to back. */
static lr_status add_intervals(const lr_context *context, const crossing *c, uint32_t first,
                               uint32_t count, uint32_t n, lr_batch *batch, double color[3],
                               double through_all[3])
{
    const lr_scene *scene = context->scene;
    double sum[AT_ONCE][3] = {{0}}, through[AT_ONCE];
    for (uint32_t k = 0; k < count; k++)
        through[k] = 1;
    for (uint32_t m = 0; m < scene->n_participants; m++) {
        const uint32_t instance = scene->participants[m].instance;
        const lr_placed *placed = &scene->instances[instance];
        if ((placed->visibility & c->visibility) == 0)
            continue;
        for (uint32_t k = 0; k < count; k++)
            put(placed, c->o, c->d, lr_mix(c->begin, c->end, (double)(first + k) / n),
                lr_mix(c->begin, c->end, (double)(first + k + 1) / n), k, batch);
        const lr_status status = lr_sum_up(context, instance, false, count, batch);
        if (status != LR_OK)
            return status;
        for (uint32_t k = 0; k < count; k++) {
            double own[3];
            const double t = get_light(batch, k, own);
            for (int a = 0; a < 3; a++)
                sum[k][a] = sum[k][a] * sqrt(t) + own[a] * sqrt(through[k]);
            through[k] *= t;
        }
    }
    double own[3], medium[3];
    lr_medium_pass(&c->medium, (c->end - c->begin) / n * c->unit, own, medium);
    for (uint32_t k = 0; k < count; k++) {
        double through_both[3];
        for (int a = 0; a < 3; a++) {
            sum[k][a] = sum[k][a] * sqrt(medium[a]) + own[a] * sqrt(through[k]);
            through_both[a] = through[k] * medium[a];
        }
        put_behind(sum[k], through_both, color, through_all);
    }
    return LR_OK;
}

/* All light of a crossing, by intervals; and what it lets through. */
static lr_status add_crossing(const lr_context *context, const crossing *c, lr_batch *batch,
                              double color[3], double through[3])
{
    const uint32_t at_once = batch->capacity < AT_ONCE ? batch->capacity : AT_ONCE;
    for (uint32_t n = FIRST_INTERVALS; n <= MOST_INTERVALS; n *= 2) {
        const double before[3] = {color[0], color[1], color[2]};
        double change = 0, largest = 0;
        for (int a = 0; a < 3; a++) {
            color[a] = 0;
            through[a] = 1;
        }
        for (uint32_t first = 0; first < n; first += at_once) {
            const uint32_t count = n - first < at_once ? n - first : at_once;
            const lr_status status =
                add_intervals(context, c, first, count, n, batch, color, through);
            if (status != LR_OK)
                return status;
        }
        for (int a = 0; a < 3; a++) {
            change = fmax(change, fabs(color[a] - before[a]));
            largest = fmax(largest, color[a]);
        }
        if (n > FIRST_INTERVALS && change <= context->tile->trace.tolerance * largest)
            break; /* a third of it is left, as errors fall with the square of intervals */
    }
    return LR_OK;
}

/* ---- the rays of a wave ------------------------------------------------------------ */

uint32_t lr_fill_participant(const lr_scene *scene, const lr_participant *participant,
                             const lr_participant_choice *choice, double t_min,
                             const lr_ray_queue *rays, const double *ends, uint32_t *ray_of,
                             lr_batch *batch)
{
    const lr_placed *placed = &scene->instances[participant->instance];
    uint32_t n = 0;
    for (uint32_t i = 0; i < rays->n; i++) {
        double o[3], d[3], begin = t_min, end = ends[i];
        if ((placed->visibility & rays->visibility[i]) == 0 ||
            (choice != NULL && choice->of_ray[i] != choice->participant))
            continue;
        lr_get_ray(&rays->ray, i, o, d);
        if (!clip_to_box(&participant->box, o, d, &begin, &end))
            continue;
        put(placed, o, d, begin, end, n, batch);
        ray_of[n++] = i;
    }
    return n;
}

/* The way of a ray through all participating instances. */
static crossing crossing_of(const lr_scene *scene, double t_min, const lr_ray_queue *rays,
                            uint32_t i, double end)
{
    crossing c = {.begin = INFINITY, .end = -INFINITY, .visibility = rays->visibility[i]};
    lr_get_ray(&rays->ray, i, c.o, c.d);
    for (uint32_t m = 0; m < scene->n_participants; m++) {
        double from = t_min, to = end;
        if (!clip_to_box(&scene->participants[m].box, c.o, c.d, &from, &to))
            continue;
        c.begin = fmin(c.begin, from);
        c.end = fmax(c.end, to);
    }
    return c;
}

/* Participant m, which scatters, or the medium extinguishes that share of ray i: writes which one
 * the ray chooses. */
static void weigh(lr_volume_scatter *scatter, uint32_t i, uint32_t m, double own)
{
    double *u = &scatter->u[i][1];
    if (!(own > 0) || *u < 0)
        return;
    scatter->opacity[i] += own;
    const double probability = own / scatter->opacity[i]; /* 1 of the first */
    const bool chosen = *u < probability;
    *u = chosen ? *u / probability : (*u - probability) / (1 - probability);
    if (!chosen)
        return;
    scatter->own[i] = own;
    scatter->participant[i] = m;
}

/* The light of ray i, which meets several of participating instances and media; reads what it met
 * of the instances. */
static lr_status add_several(const lr_context *context, double t_min, const lr_ray_queue *rays,
                             uint32_t i, double end, const lr_medium *medium, lr_batch *batch,
                             lr_volume_light *light)
{
    double *color = light->color[i], own[3], own_through[3], through[3];
    crossing c = crossing_of(context->scene, t_min, rays, i, end);
    c.medium = *medium;
    c.unit = sqrt(lr_dot(c.d, c.d));
    const lr_status status = add_crossing(context, &c, batch, own, own_through);
    lr_medium_pass(medium, (c.begin - t_min) * c.unit, color, through);
    put_behind(own, own_through, color, through);
    lr_medium_pass(medium, (end - c.end) * c.unit, own, own_through);
    put_behind(own, own_through, color, through);
    return status;
}

/* What the medium of a path adds to its ray i: reads the path; writes light, and whether the medium
 * scatters the ray. */
static lr_status meet_medium(const lr_context *context, double t_min, const lr_path *path,
                             const lr_ray_queue *rays, uint32_t i, double end, lr_batch *batch,
                             lr_volume_light *light, lr_volume_scatter *scatter)
{
    lr_medium medium;
    double through[3];
    const bool filled = lr_medium_find(context->scene, &path->media, path->visibility, &medium);
    const double length = (end - t_min) * sqrt(lr_dot(path->direction, path->direction));
    if (filled && scatter != NULL)
        weigh(scatter, i, LR_IN_MEDIUM, lr_medium_opacity(&medium, path->throughput, length));
    if (filled && light->n_met[i] == 0)
        lr_medium_pass(&medium, length, light->color[i], through);
    if (light->n_met[i] + filled < 2 || light->n_met[i] == 0)
        return LR_OK;
    return add_several(context, t_min, rays, i, end, &medium, batch, light);
}

lr_status lr_find_volume_light(const lr_context *context, double t_min, const lr_path *paths,
                               const lr_ray_queue *rays, const double *ends, lr_batch *batch,
                               lr_volume_light *light, lr_volume_scatter *scatter)
{
    const lr_scene *scene = context->scene;
    for (uint32_t i = 0; i < rays->n; i++) {
        memset(light->color[i], 0, sizeof light->color[i]);
        light->transmittance[i] = 1;
        light->n_met[i] = 0;
    }
    for (uint32_t m = 0; m < scene->n_participants; m++) {
        const lr_participant *participant = &scene->participants[m];
        const uint32_t n =
            lr_fill_participant(scene, participant, NULL, t_min, rays, ends, light->ray_of, batch);
        const lr_status status = lr_sum_up(context, participant->instance, false, n, batch);
        if (status != LR_OK)
            return status;
        for (uint32_t k = 0; k < n; k++) {
            const uint32_t i = light->ray_of[k];
            if (!(batch->hit.t[k] < INFINITY))
                continue;
            const double transmittance = get_light(batch, k, light->color[i]);
            light->transmittance[i] *= transmittance;
            light->n_met[i]++;
            if (scatter != NULL && participant->scatters)
                weigh(scatter, i, m, 1 - transmittance);
        }
    }
    for (uint32_t i = 0; i < rays->n && paths != NULL; i++) {
        const lr_status status = meet_medium(context, t_min, &paths[rays->owner[i]], rays, i,
                                             ends[i], batch, light, scatter);
        if (status != LR_OK)
            return status;
    }
    return LR_OK;
}

lr_status lr_find_transmittance(const lr_context *context, const double o[3], const double d[3],
                                double begin, double end, uint32_t visibility, uint32_t without,
                                lr_batch *batch, double *transmittance)
{
    const lr_scene *scene = context->scene;
    *transmittance = 1;
    for (uint32_t m = 0; m < scene->n_participants; m++) {
        const uint32_t instance = scene->participants[m].instance;
        const lr_placed *placed = &scene->instances[instance];
        double from = begin, to = end;
        if ((placed->visibility & visibility) == 0 || instance == without ||
            !clip_to_box(&scene->participants[m].box, o, d, &from, &to))
            continue;
        put(placed, o, d, from, to, 0, batch);
        const lr_status status = lr_sum_up(context, instance, false, 1, batch);
        if (status != LR_OK)
            return status;
        *transmittance *= batch->hit.transmittance[0];
    }
    return LR_OK;
}
