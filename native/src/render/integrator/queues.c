/* Laying out the working memory.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/queues.h"

enum { LINE = 64 }; /* arrays begin on cache lines */

typedef struct lr_arena {
    char *base;
    uint64_t used;
} lr_arena;

static void *take(lr_arena *arena, uint64_t n, size_t size)
{
    void *p = arena->base != NULL ? arena->base + arena->used : NULL;
    arena->used += (n * size + LINE - 1) / LINE * LINE;
    return p;
}

static double *take_doubles(lr_arena *arena, uint64_t n)
{
    return take(arena, n, sizeof(double));
}

static lr_rays_buffer take_rays(lr_arena *arena, uint64_t n)
{
    lr_rays_buffer ray;
    ray.ox = take_doubles(arena, n);
    ray.oy = take_doubles(arena, n);
    ray.oz = take_doubles(arena, n);
    ray.dx = take_doubles(arena, n);
    ray.dy = take_doubles(arena, n);
    ray.dz = take_doubles(arena, n);
    return ray;
}

static lr_hits take_hits(lr_arena *arena, uint64_t n)
{
    lr_hits hit;
    hit.t = take_doubles(arena, n);
    hit.ci = take(arena, n, sizeof *hit.ci);
    hit.cj = take(arena, n, sizeof *hit.cj);
    hit.ck = take(arena, n, sizeof *hit.ck);
    hit.nx = take_doubles(arena, n);
    hit.ny = take_doubles(arena, n);
    hit.nz = take_doubles(arena, n);
    hit.gx = take_doubles(arena, n);
    hit.gy = take_doubles(arena, n);
    hit.gz = take_doubles(arena, n);
    hit.id = take(arena, n, sizeof *hit.id);
    hit.triangle = take(arena, n, sizeof *hit.triangle);
    hit.steps = take(arena, n, sizeof *hit.steps);
    return hit;
}

static lr_queue take_queue(lr_arena *arena, uint64_t n, uint32_t branches)
{
    lr_queue queue;
    queue.paths = take(arena, n * branches, sizeof *queue.paths);
    queue.n = take(arena, n, sizeof *queue.n);
    return queue;
}

uint64_t lr_workspace_lay(void *base, uint64_t n_pixels, uint32_t branches, uint32_t height,
                          lr_workspace *workspace)
{
    const uint64_t n_least = n_pixels < LR_STRETCH ? n_pixels : LR_STRETCH;
    const uint64_t n = n_least > branches ? n_least : branches; /* a wave holds one pixel's rays */
    const uint64_t skip = (LINE - (uintptr_t)base % LINE) % LINE;
    lr_arena arena = {base != NULL ? (char *)base + skip : NULL, 0};
    lr_workspace w;
    w.room = (uint32_t)n;
    w.wave.ray = take_rays(&arena, n);
    w.wave.from = take(&arena, n, sizeof *w.wave.from);
    w.wave.start = take(&arena, n, sizeof *w.wave.start);
    w.wave.visibility = take(&arena, n, sizeof *w.wave.visibility);
    w.wave.instance = take(&arena, n, sizeof *w.wave.instance);
    w.wave.hit = take_hits(&arena, n);
    w.wave.t = w.wave.hit.t;
    w.wave.stack = take(&arena, n * height, sizeof *w.wave.stack);
    w.wave.stacked = take(&arena, n, sizeof *w.wave.stacked);
    w.batch.ray = take_rays(&arena, n);
    w.batch.t_min = take_doubles(&arena, n);
    w.batch.t_max = take_doubles(&arena, n);
    w.batch.start = take(&arena, n, sizeof *w.batch.start);
    w.batch.hit = take_hits(&arena, n);
    w.pairs = take(&arena, n, sizeof *w.pairs);
    w.pairs_sorted = take(&arena, n, sizeof *w.pairs_sorted);
    w.active = take(&arena, n, sizeof *w.active);
    w.now = take_queue(&arena, n, branches);
    w.next = take_queue(&arena, n, branches);
    w.free_slots = take(&arena, n, sizeof *w.free_slots);
    w.traced = take(&arena, n, sizeof *w.traced);
    w.shading_points = take(&arena, n, sizeof *w.shading_points);
    w.shadow_rays = take(&arena, n, sizeof *w.shadow_rays);
    w.shadow_media = take(&arena, n, sizeof *w.shadow_media);
    w.carried = take(&arena, n, sizeof *w.carried);
    w.pixels = take(&arena, n, sizeof *w.pixels);
    w.hash = take(&arena, n, sizeof *w.hash);
    w.sampled = take(&arena, n, sizeof *w.sampled);
    w.settled = take(&arena, n, sizeof *w.settled);
    w.filter = take_doubles(&arena, LR_FILTER_TABLE + 1);
    *workspace = w;
    return arena.used + (base != NULL ? skip : LINE);
}
