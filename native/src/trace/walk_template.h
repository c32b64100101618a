/* The batch template: set-up, walk, hit test and output of every traverser.
 *
 * A traverser's file defines LR_NAME (its name in the registry) and either
 *   LR_BOX   box(data, volume, ray, state, c, lo, hi, tally): true where cell c is
 *            a surface cell, else an empty box lo..hi around it, or
 *   LR_WALK  walk(data, volume, ray, lattice, cursor, state, first, tally): leaves the
 *            cell it stands on, but on the first call, and goes on until the cursor
 *            stands on a surface cell; false where the ray has ended, or
 *   LR_REGULAR_WALK  the same without lattice: planes lie at the integers,
 * and, where it can take several rays at a time, LR_FITS(volume, data, options) and
 * LR_PACKET(volume, data, rays, first, end, options, hits, counters), and, where it has chessboard
 * distances, LR_EMPTY_CUBES(data), and
 * LR_STATE and LR_START(data, volume, ray, lattice, cursor, state) where its walk keeps
 * something (else neither), then includes this file, which makes
 * lr_<name>_trace. The state survives a cell whose hit test failed: the walk is
 * simply called again. All of it is compiled for regular lattices, and once more for
 * those of rectilinear volumes where the walk can.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */

#include "trace/ray_light.h"
#include "trace/ray_samples.h"
#include "trace/ray_sums.h"
#include "trace/hit_record.h"
#include "trace/traverser.h"
#include "trace/triangle_cell.h"

#define LR_JOIN_(a, b, c) a##b##c
#define LR_JOIN(a, b, c)  LR_JOIN_(a, b, c)

#ifndef LR_STATE
#define LR_STATE                                            int
#define LR_START(data, volume, ray, lattice, cursor, state) (*(state) = 0)
#endif

#ifdef LR_BOX
LR_INLINE bool lr_walk_boxes(const void *data, const lr_volume *v, const lr_ray *r,
                             lr_lattice lattice, lr_cursor *u, LR_STATE *state, bool first,
                             lr_tally *tally)
{
    int32_t lo[3], hi[3];
    if (!first && !lr_step(r, lattice, u))
        return false;
    for (;;) {
        lr_count_cell(tally);
        if (LR_BOX(data, v, r, state, u->c, lo, hi, tally))
            return true;
        const bool one = hi[0] - lo[0] + hi[1] - lo[1] + hi[2] - lo[2] == 0;
        lr_count_jump(tally, !one);
        if (one ? !lr_step(r, lattice, u) : !lr_exit(r, lattice, u, lo, hi))
            return false;
    }
}
#define LR_WALK lr_walk_boxes
#endif

#ifdef LR_REGULAR_WALK
#define LR_WALK(data, volume, ray, lattice, cursor, state, first, tally)                           \
    LR_REGULAR_WALK(data, volume, ray, cursor, state, first, tally)
#endif

/* One ray; counted and lattice are constants, so that neither costs anything when out. */
LR_INLINE void lr_trace_one(const lr_volume *v, const void *data, const lr_rays *rays, uint64_t i,
                            const lr_trace_options *options, const lr_hits *hits,
                            lr_lattice lattice, bool counted, lr_counters *counters)
{
    lr_ray r;
    lr_cursor u;
    LR_STATE state;
    lr_tally tally = {0};
    uint64_t n_samples = 0, n_tests = 0;
    const double o[3] = {rays->ox[i], rays->oy[i], rays->oz[i]};
    const double d[3] = {rays->dx[i], rays->dy[i], rays->dz[i]};
    const double t_min = rays->t_min != NULL ? rays->t_min[i] : 0.0;
    const lr_start *start = rays->start != NULL ? &rays->start[i] : NULL;
    int side = start != NULL ? start->side : 0;
    const lr_leaving leaving = lr_leaving_of(start, t_min);
    bool hit = false, first = true;
    lr_put_miss(hits, i);
    if (!lr_ray_setup(&r, v, o, d, rays->t_max != NULL ? rays->t_max[i] : INFINITY) ||
        !(t_min <= r.t_max && t_min < INFINITY))
        goto end;
    if (options->mode == LR_MODE_BINARY && lr_starts_inside(v, &r, lattice, t_min, &u)) {
        lr_put_binary(v, hits, i, &r, &u);
        hit = true;
        goto end;
    }
    if (!(side != 0 ? lr_leave(v, &r, &u, start, t_min, lr_way_of(rays, i))
                    : lr_enter(&r, lattice, &u, v->surface_lo, v->surface_hi, t_min)))
        goto end;
    LR_START(data, v, &r, lattice, &u, &state);
    while (LR_WALK(data, v, &r, lattice, &u, &state, first, counted ? &tally : NULL)) {
        if (options->mode == LR_MODE_BINARY) {
            lr_put_binary(v, hits, i, &r, &u);
            hit = true;
            break;
        }
        lr_found found;
        n_tests++;
        if (lr_hit(v, &r, lattice, &u, &leaving, &side, options, &found, &n_samples)) {
            lr_put_surface(v, hits, i, &found, d, options->normal);
            hit = true;
            break;
        }
        first = false;
    }
end:
    if (counted) {
        lr_put_steps(hits, i, tally.cells);
        counters->rays++;
        counters->cells += tally.cells;
        counters->jumps += tally.jumps;
        counters->nodes += tally.nodes;
        counters->tests += n_tests;
        counters->samples += n_samples;
        counters->hits += hit;
        if (counters->most_cells < tally.cells)
            counters->most_cells = tally.cells;
    }
}

/* One ray through all visible cells, by a mode from LR_MODE_VOLUME on. A function of its own, so
 * that surfaces pay nothing for it. */
LR_INLINE void lr_add_along_one(const lr_volume *v, const void *data, const lr_rays *rays,
                                uint64_t i, const lr_trace_options *options, const lr_hits *hits,
                                lr_lattice lattice, lr_counters *counters)
{
    lr_ray r;
    lr_cursor u;
    LR_STATE state;
    lr_tally tally = {0};
    lr_ray_sums sums = {.options = options, .t = INFINITY, .transmittance = 1.0};
    const double o[3] = {rays->ox[i], rays->oy[i], rays->oz[i]};
    const double d[3] = {rays->dx[i], rays->dy[i], rays->dz[i]};
    const double t_min = rays->t_min != NULL ? rays->t_min[i] : 0.0;
    lr_put_miss(hits, i);
    if (lr_ray_setup(&r, v, o, d, rays->t_max != NULL ? rays->t_max[i] : INFINITY) &&
        t_min <= r.t_max && t_min < INFINITY &&
        lr_enter(&r, lattice, &u, v->surface_lo, v->surface_hi, t_min)) {
        lr_sums_begin(&sums, v, &r, rays, i, t_min, options);
        LR_START(data, v, &r, lattice, &u, &state);
        bool first = true;
        while (LR_WALK(data, v, &r, lattice, &u, &state, first, &tally)) {
            const int32_t c[3] = {u.c[0], u.c[1], u.c[2]}; /* u itself stays in registers */
            if (!lr_sums_cell(&sums, v, &r, lattice, c))
                break;
            first = false;
        }
    }
    const bool seen = lr_sums_put(&sums, v, hits, i);
    lr_put_steps(hits, i, tally.cells);
    counters->rays++;
    counters->cells += tally.cells;
    counters->jumps += tally.jumps;
    counters->nodes += tally.nodes;
    counters->tests += sums.cells;
    counters->samples += sums.pieces;
    counters->hits += seen;
    if (counters->most_cells < tally.cells)
        counters->most_cells = tally.cells;
}

/* Not inlined, so that surfaces' code stays as it is without it. */
static __attribute__((noinline)) void lr_add_along(const lr_volume *v, const void *data,
                                                   const lr_rays *rays, uint64_t first,
                                                   uint64_t end, const lr_trace_options *options,
                                                   const lr_hits *hits, lr_counters *counters)
{
#ifndef LR_REGULAR_WALK
    if (v->planes[0] != NULL) {
        for (uint64_t i = first; i < end; i++)
            lr_add_along_one(v, data, rays, i, options, hits, LR_RECTILINEAR, counters);
        return;
    }
#endif
    for (uint64_t i = first; i < end; i++)
        lr_add_along_one(v, data, rays, i, options, hits, LR_REGULAR, counters);
}

LR_INLINE void lr_trace_some(const lr_volume *v, const void *data, const lr_rays *rays,
                             uint64_t first, uint64_t end, const lr_trace_options *options,
                             const lr_hits *hits, lr_lattice lattice, lr_counters *counters)
{
    if (counters != NULL)
        for (uint64_t i = first; i < end; i++)
            lr_trace_one(v, data, rays, i, options, hits, lattice, true, counters);
    else
        for (uint64_t i = first; i < end; i++)
            lr_trace_one(v, data, rays, i, options, hits, lattice, false, NULL);
}

lr_status LR_JOIN(lr_, LR_NAME,
                  _trace)(const lr_volume *volume, const void *data, const lr_rays *rays,
                          uint64_t n, const lr_trace_options *options, const lr_hits *hits,
                          lr_counters *counters, const lr_watch *watch, lr_error *error)
{
    const bool along = options->mode >= LR_MODE_VOLUME;
    const bool sampled = along && lr_samples_rays(volume, options);
    const bool lighted = along && lr_lights_rays(volume, options);
#ifdef LR_EMPTY_CUBES
    const lr_empty_cubes of_structure = LR_EMPTY_CUBES(data), *cubes = &of_structure;
#else
    const lr_empty_cubes *cubes = NULL;
#endif
    const uint64_t poll = /* rays between looks at the stop word, which rays in lanes do, too */
        sampled || lighted ? 8192
        : along            ? 64
                           : 1024;
    lr_counters sum = {0};
    for (uint64_t first = 0; first < n; first += poll) {
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        lr_progress(watch, (double)first / (double)n);
        uint64_t last = n - first < poll ? n : first + poll;
        lr_counters *counted = counters != NULL || hits->steps != NULL ? &sum : NULL;
        sum.pairs += last - first;
        if (sampled || lighted) {
            sum.in_lanes += last - first;
            (sampled ? lr_sample_rays : lr_light_rays)(volume, cubes, rays, first, last, options,
                                                       hits, &sum, watch);
            if (lr_stopped(watch)) /* in the midst of these, maybe */
                return lr_fail_stopped(error);
            continue;
        }
        if (along) {
            lr_add_along(volume, data, rays, first, last, options, hits, &sum);
            continue;
        }
#ifdef LR_PACKET
        if (LR_FITS(volume, data, options)) {
            sum.in_lanes += last - first;
            LR_PACKET(volume, data, rays, first, last, options, hits, counted);
            continue;
        }
#endif
#ifndef LR_REGULAR_WALK
        if (volume->planes[0] != NULL) {
            lr_trace_some(volume, data, rays, first, last, options, hits, LR_RECTILINEAR, counted);
            continue;
        }
#endif
        lr_trace_some(volume, data, rays, first, last, options, hits, LR_REGULAR, counted);
    }
    if (counters != NULL) {
        counters->rays += sum.rays;
        counters->cells += sum.cells;
        counters->jumps += sum.jumps;
        counters->nodes += sum.nodes;
        counters->tests += sum.tests;
        counters->samples += sum.samples;
        counters->hits += sum.hits;
        counters->pairs += sum.pairs;
        counters->in_lanes += sum.in_lanes;
        if (counters->most_cells < sum.most_cells)
            counters->most_cells = sum.most_cells;
    }
    return LR_OK;
}
