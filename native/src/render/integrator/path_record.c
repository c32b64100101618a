/* Writes the events of a recorded pixel.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/path_record.h"

#include "render/integrator/shading_point.h"
#include "trace/cell.h"

_Static_assert(sizeof((lr_event *)0)->media == sizeof((lr_medium_stack *)0)->instance,
               "an event holds a whole medium stack");

/* The record's next event, of this kind and on this path; NULL where none is to be written. */
static lr_event *next_event(lr_event_kind kind, const lr_path *path, lr_record *record)
{
    if (record == NULL || record->n++ >= record->capacity)
        return NULL;
    lr_event *event = &record->events[record->n - 1];
    *event = (lr_event){
        .kind = kind,
        .sample = (uint32_t)(record->samples - 1),
        .ray = path->key,
        .bounces = path->bounces[LR_RAY_CAMERA],
        .transparent = path->bounces[LR_RAY_TRANSPARENT],
        .instance = LR_NOWHERE,
        .triangle = LR_NO_TRIANGLE,
    };
    return event;
}

static void put(double to[3], const double from[3])
{
    memcpy(to, from, 3 * sizeof *to);
}

void lr_record_ray(const lr_path *path, const lr_path *parent, int kind, lr_record *record)
{
    if (record != NULL && parent == NULL)
        record->samples++;
    lr_event *event = next_event(LR_EVENT_RAY, path, record);
    if (event == NULL)
        return;
    event->parent = parent != NULL ? parent->key : path->key;
    event->ray_kind = kind;
    event->last = path->last;
    event->instance = path->from;
    memcpy(event->cell, path->start.cell, sizeof event->cell);
    event->side = path->start.side;
    event->n_media = path->media.n;
    memcpy(event->media, path->media.instance, path->media.n * sizeof *event->media);
    memcpy(event->media_material, path->media.material, path->media.n * sizeof *event->media);
    put(event->origin, path->origin);
    put(event->direction, path->direction);
    event->t = path->t_max;
    put(event->throughput, path->throughput);
}

void lr_record_hit(const lr_path *path, const lr_hit_queue *hits, uint32_t i,
                   const lr_shading_point *s, lr_record *record)
{
    lr_event *event = next_event(LR_EVENT_HIT, path, record);
    if (event == NULL)
        return;
    event->steps = hits->hit.steps[i];
    event->t = s != NULL ? hits->t[i] : INFINITY;
    put(event->throughput, path->throughput);
    if (s == NULL)
        return;
    event->instance = s->instance;
    event->material = s->material_index;
    event->id = hits->hit.id[i];
    event->triangle = hits->hit.triangle[i];
    memcpy(event->cell, s->start.cell, sizeof event->cell);
    event->side = s->start.side;
    put(event->position, s->position);
    lr_bsdf_normal(&s->bsdf, event->normal);
}

void lr_record_scatter(const lr_volume_point *point, const lr_path *path, lr_record *record)
{
    lr_event *event = next_event(LR_EVENT_SCATTER, &point->path, record);
    if (event == NULL)
        return;
    event->parent = path->key;
    event->instance = point->instance;
    event->t = point->t;
    put(event->throughput, point->path.throughput);
    put(event->position, point->path.origin);
}

void lr_record_found(const lr_path *path, uint64_t light_index, double mis_weight,
                     const double contribution[3], lr_record *record)
{
    lr_event *event = next_event(LR_EVENT_FOUND, path, record);
    if (event == NULL)
        return;
    event->light = light_index;
    event->weight = mis_weight;
    put(event->contribution, contribution);
}

/* The MIS weight in a contribution: its fraction of the contribution that the sample would have
 * if no other technique found the light. */
static double mis_weight_of(const lr_shading_point *s, const lr_sampled_light *sampled,
                            double probability, const double contribution[3])
{
    lr_response group[LR_RAY_KINDS];
    double part = 0, whole = 0;
    lr_point_respond(s, sampled->ray.direction, group);
    for (int a = 0; a < 3; a++) {
        double f_cos = 0;
        for (int kind = lr_first_kind(s); kind <= lr_last_kind(s); kind++)
            if ((sampled->visibility & lr_sees(kind)) != 0)
                f_cos += group[kind].f_cos[a];
        part += fabs(contribution[a]);
        whole += fabs(f_cos * sampled->ray.color[a] * s->path->throughput[a]);
    }
    return whole > 0 ? part * probability * sampled->ray.pdf / whole : 0;
}

void lr_record_light(const lr_shading_point *s, uint64_t light_index, double probability,
                     const lr_sampled_light *sampled, lr_shadow_ray *shadow_ray, lr_record *record)
{
    lr_event *event = next_event(LR_EVENT_LIGHT, s->path, record);
    shadow_ray->event = event != NULL ? record->n - 1 : UINT64_MAX;
    if (event == NULL)
        return;
    event->light = light_index;
    event->probability = probability;
    put(event->origin, s->origin);
    if (sampled == NULL)
        return;
    put(event->direction, sampled->ray.direction);
    event->t = sampled->ray.distance;
    event->pdf = sampled->ray.pdf;
    event->weight = mis_weight_of(s, sampled, probability, shadow_ray->contribution);
}

/* The event of a shadow ray, or NULL. */
static lr_event *event_of(const lr_shadow_ray *shadow_ray, const lr_record *record)
{
    if (record == NULL || shadow_ray->event >= record->capacity)
        return NULL;
    return &record->events[shadow_ray->event];
}

void lr_record_blocked(const lr_shadow_ray *shadow_ray, uint32_t instance, lr_record *record)
{
    lr_event *event = event_of(shadow_ray, record);
    if (event != NULL)
        event->instance = instance;
}

void lr_record_contribution(const lr_shadow_ray *shadow_ray, lr_record *record)
{
    lr_event *event = event_of(shadow_ray, record);
    if (event != NULL)
        put(event->contribution, shadow_ray->contribution);
}
