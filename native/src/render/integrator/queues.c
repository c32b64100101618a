/* Lays the queues out.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/queues.h"

static lr_rays_buffer take_rays(lr_arena *arena, uint64_t n)
{
    lr_rays_buffer ray;
    ray.ox = lr_arena_take_doubles(arena, n);
    ray.oy = lr_arena_take_doubles(arena, n);
    ray.oz = lr_arena_take_doubles(arena, n);
    ray.dx = lr_arena_take_doubles(arena, n);
    ray.dy = lr_arena_take_doubles(arena, n);
    ray.dz = lr_arena_take_doubles(arena, n);
    return ray;
}

static lr_hits take_hits(lr_arena *arena, uint64_t n)
{
    lr_hits hit = {0};
    hit.t = lr_arena_take_doubles(arena, n);
    hit.ci = lr_arena_take(arena, n, sizeof *hit.ci);
    hit.cj = lr_arena_take(arena, n, sizeof *hit.cj);
    hit.ck = lr_arena_take(arena, n, sizeof *hit.ck);
    hit.nx = lr_arena_take_doubles(arena, n);
    hit.ny = lr_arena_take_doubles(arena, n);
    hit.nz = lr_arena_take_doubles(arena, n);
    hit.gx = lr_arena_take_doubles(arena, n);
    hit.gy = lr_arena_take_doubles(arena, n);
    hit.gz = lr_arena_take_doubles(arena, n);
    hit.id = lr_arena_take(arena, n, sizeof *hit.id);
    hit.triangle = lr_arena_take(arena, n, sizeof *hit.triangle);
    hit.steps = lr_arena_take(arena, n, sizeof *hit.steps);
    return hit;
}

static void take_volume_scatter(lr_arena *arena, uint64_t n, lr_wave *wave)
{
    lr_volume_scatter *scatter = &wave->volume_scatter;
    wave->memory.batch.stop = lr_arena_take_doubles(arena, n);
    scatter->u = lr_arena_take(arena, n, sizeof *scatter->u);
    scatter->opacity = lr_arena_take_doubles(arena, n);
    scatter->own = lr_arena_take_doubles(arena, n);
    scatter->participant = lr_arena_take(arena, n, sizeof *scatter->participant);
    scatter->medium = lr_arena_take(arena, n, sizeof *scatter->medium);
    scatter->t = lr_arena_take_doubles(arena, n);
    scatter->albedo = lr_arena_take(arena, n, sizeof *scatter->albedo);
}

static void take_wave(lr_arena *arena, uint64_t n, const lr_scene *scene, lr_wave *wave)
{
    lr_ray_queue *rays = &wave->rays;
    rays->n = 0;
    rays->capacity = (uint32_t)n;
    rays->ray = take_rays(arena, n);
    rays->t_max = lr_arena_take_doubles(arena, n);
    rays->from = lr_arena_take(arena, n, sizeof *rays->from);
    rays->start = lr_arena_take(arena, n, sizeof *rays->start);
    rays->way = lr_arena_take(arena, n, sizeof *rays->way);
    rays->visibility = lr_arena_take(arena, n, sizeof *rays->visibility);
    rays->owner = lr_arena_take(arena, n, sizeof *rays->owner);
    wave->hits.instance = lr_arena_take(arena, n, sizeof *wave->hits.instance);
    wave->hits.hit = take_hits(arena, n);
    wave->hits.t = wave->hits.hit.t;
    lr_intersect_memory *m = &wave->memory;
    m->stack = lr_arena_take(arena, n * scene->n_branches, sizeof *m->stack);
    m->stacked = lr_arena_take(arena, n, sizeof *m->stacked);
    m->active = lr_arena_take(arena, n, sizeof *m->active);
    m->pairs = lr_arena_take(arena, n, sizeof *m->pairs);
    m->pairs_sorted = lr_arena_take(arena, n, sizeof *m->pairs_sorted);
    m->batch.ray = take_rays(arena, n);
    m->batch.t_min = lr_arena_take_doubles(arena, n);
    m->batch.t_max = lr_arena_take_doubles(arena, n);
    m->batch.length = lr_arena_take_doubles(arena, n);
    m->batch.t_passed = lr_arena_take_doubles(arena, n);
    m->batch.start = lr_arena_take(arena, n, sizeof *m->batch.start);
    m->batch.way = lr_arena_take(arena, n, sizeof *m->batch.way);
    m->batch.hit = take_hits(arena, n);
    m->batch.hit.red = lr_arena_take_doubles(arena, n);
    m->batch.hit.green = lr_arena_take_doubles(arena, n);
    m->batch.hit.blue = lr_arena_take_doubles(arena, n);
    m->batch.hit.transmittance = lr_arena_take_doubles(arena, n);
    m->batch.capacity = (uint32_t)n;
    lr_volume_light *light = &wave->volume_light;
    light->color = lr_arena_take(arena, n, sizeof *light->color);
    light->transmittance = lr_arena_take_doubles(arena, n);
    light->n_met = lr_arena_take(arena, n, sizeof *light->n_met);
    light->ray_of = lr_arena_take(arena, n, sizeof *light->ray_of);
}

static lr_path_queue take_paths(lr_arena *arena, uint64_t n_pixels, uint32_t slots)
{
    lr_path_queue queue = {.slots = slots};
    queue.paths = lr_arena_take(arena, n_pixels * slots, sizeof *queue.paths);
    queue.n = lr_arena_take(arena, n_pixels, sizeof *queue.n);
    queue.free_slots = lr_arena_take(arena, n_pixels, sizeof *queue.free_slots);
    return queue;
}

void lr_queues_lay(lr_arena *arena, uint64_t n_pixels, uint32_t paths_per_pixel,
                   const lr_scene *scene, lr_queues *queues)
{
    lr_shading_queue *points = &queues->shading_points;
    lr_volume_queue *volume_points = &queues->volume_points;
    lr_shadow_queue *shadow = &queues->shadow_rays;
    paths_per_pixel += scene->scatters;
    /* A wave holds one pixel's rays at least. */
    const uint64_t n = n_pixels > paths_per_pixel ? n_pixels : paths_per_pixel;
    take_wave(arena, n, scene, &queues->wave);
    if (scene->scatters)
        take_volume_scatter(arena, n, &queues->wave);
    queues->now = take_paths(arena, n_pixels, paths_per_pixel);
    queues->next = take_paths(arena, n_pixels, paths_per_pixel);
    points->n = 0;
    points->points = lr_arena_take(arena, n, sizeof *points->points);
    points->n_closures = 0;
    points->closures = lr_arena_take(arena, n * LR_CLOSURES_MAX, sizeof *points->closures);
    volume_points->n = 0;
    volume_points->points =
        lr_arena_take(arena, scene->scatters ? n : 0, sizeof *volume_points->points);
    shadow->n = 0;
    shadow->capacity = (uint32_t)n;
    shadow->rays = lr_arena_take(arena, n, sizeof *shadow->rays);
    shadow->media = lr_arena_take(arena, n, sizeof *shadow->media);
}
