/* The nearest hits of a wave.
 *
 * In rounds: every ray traverses the hierarchy to the next instance that it may meet
 * before its nearest hit; the pairs of ray and instance are sorted by instance; each
 * instance traces its rays as one batch in its own space, with the same t. A ray is done
 * when no instance is left before its hit, a shadow ray also at any hit. A hit does not
 * depend on other rays, nor on the order of instances, since t_max only decides whether a
 * hit counts.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/intersect_closest.h"

#include "base/affine.h"
#include "base/error.h"
#include "trace/triangle_tree.h"

enum { DIGIT_BITS = 8, N_DIGITS = 1 << DIGIT_BITS };

/* May a ray of that visibility hit this instance at all? */
static bool may_hit(const lr_placed *placed, lr_among among, uint32_t visibility)
{
    const bool included = placed->clear ? among != LR_AMONG_OPAQUE : among != LR_AMONG_CLEAR;
    return included && (placed->visibility & visibility) != 0;
}

/* The next instance that ray i may hit before t: resumes its traversal. Reads the ray; writes
 * its stack. */
static uint32_t next_instance(const lr_scene *scene, const lr_intersect_options *options,
                              const lr_ray_queue *rays, uint32_t i, double t, lr_branch *stack,
                              uint32_t *n)
{
    while (*n > 0 && stack[*n - 1].t > t) /* how most traversals end */
        --*n;
    if (*n == 0)
        return LR_NOWHERE;
    double o[3], d[3];
    lr_get_ray(&rays->ray, i, o, d);
    const lr_slabs ray = lr_slabs_of(o, d);
    for (;;) {
        const uint32_t instance =
            lr_hierarchy_next(&scene->hierarchy, &ray, options->t_min, t, stack, n);
        if (instance == LR_NOWHERE ||
            may_hit(&scene->instances[instance], options->among, rays->visibility[i]))
            return instance;
    }
}

/* Sort by instance; the order of rays stays within each. Least significant digit
 * first, no more digits than the number of instances has. The sorted pairs are
 * in memory->pairs. */
static void sort_pairs(lr_intersect_memory *memory, uint32_t n, uint32_t n_instances)
{
    if (n < 2)
        return;
    for (uint32_t shift = 0; shift < 32 && (n_instances - 1) >> shift != 0; shift += DIGIT_BITS) {
        uint32_t place[N_DIGITS] = {0};
        for (uint32_t i = 0; i < n; i++)
            place[memory->pairs[i].instance >> shift & (N_DIGITS - 1)]++;
        uint32_t sum = 0;
        for (uint32_t digit = 0; digit < N_DIGITS; digit++) {
            const uint32_t count = place[digit];
            place[digit] = sum;
            sum += count;
        }
        for (uint32_t i = 0; i < n; i++)
            memory->pairs_sorted[place[memory->pairs[i].instance >> shift & (N_DIGITS - 1)]++] =
                memory->pairs[i];
        lr_pair *swap = memory->pairs;
        memory->pairs = memory->pairs_sorted;
        memory->pairs_sorted = swap;
    }
}

/* Transform the rays of these pairs, all of one instance, to its object space: reads rays and the
 * nearest hits so far; writes the batch. Returns whether one of the rays leaves its surface. */
static bool fill_batch(const lr_scene *scene, bool leaving, const lr_pair *pairs, uint32_t n,
                       const lr_ray_queue *rays, const lr_hit_queue *hits, lr_batch *batch)
{
    const double *m = scene->instances[pairs[0].instance].object_from_world;
    bool leaves = false;
    for (uint32_t k = 0; k < n; k++) {
        const uint32_t i = pairs[k].ray;
        double o[3], d[3], p[3], v[3];
        lr_get_ray(&rays->ray, i, o, d);
        lr_map_point(m, o, p);
        lr_map_vector(m, d, v);
        lr_put_ray(&batch->ray, k, p, v);
        batch->t_max[k] = hits->t[i];
    }
    if (!leaving)
        return false;
    for (uint32_t k = 0; k < n; k++) {
        const uint32_t i = pairs[k].ray;
        const bool left = rays->from[i] == pairs[k].instance;
        batch->start[k] = left ? rays->start[i] : (lr_start){.side = 0};
        leaves |= left;
    }
    return leaves;
}

/* Keep hit k of the batch, at t of the wave's ray, if it is nearer than the hit so far: reads the
 * batch's hit; writes the wave's. */
static void keep_if_nearer(const lr_intersect_options *options, lr_pair pair, uint32_t k, double t,
                           const lr_batch *batch, lr_hit_queue *hits)
{
    const lr_hits *from = &batch->hit, *to = &hits->hit;
    const uint32_t i = pair.ray;
    if (!(t < INFINITY) || t > hits->t[i] || (t == hits->t[i] && pair.instance > hits->instance[i]))
        return;
    hits->instance[i] = pair.instance;
    if (options->any)
        return;
    hits->t[i] = t;
    to->ci[i] = from->ci[k];
    to->cj[i] = from->cj[k];
    to->ck[i] = from->ck[k];
    to->nx[i] = from->nx[k];
    to->ny[i] = from->ny[k];
    to->nz[i] = from->nz[k];
    to->gx[i] = from->gx[k];
    to->gy[i] = from->gy[k];
    to->gz[i] = from->gz[k];
    to->id[i] = from->id[k];
    to->triangle[i] = from->triangle[k];
}

/* Add the cells that a batch has visited to those of the wave's rays. */
static void add_steps(const lr_pair *pairs, uint32_t n, const lr_batch *batch, lr_hit_queue *hits)
{
    for (uint32_t k = 0; k < n; k++)
        hits->hit.steps[pairs[k].ray] += batch->hit.steps[k];
}

/* Trace a filled batch in its instance: reads its rays; writes its hits, of which `only_t` has
 * no more than t. */
static lr_status trace_batch(const lr_context *context, const lr_intersect_options *options,
                             uint32_t instance, bool leaves, bool only_t, uint32_t n,
                             const lr_batch *batch)
{
    lr_rays rays = lr_rays_of(batch);
    rays.t_min = options->t_min != 0 ? batch->t_min : NULL;
    rays.start = leaves ? batch->start : NULL;
    const lr_hits distances = {.t = batch->hit.t};
    lr_hits all = batch->hit;
    if (!options->steps)
        all.steps = NULL;
    const lr_watch stop = lr_stop_of(context);
    const lr_structure *structure = context->scene->instances[instance].structure;
    if (options->steps) /* cells are counted in which a ray stood: it has to walk */
        return lr_trace(structure, &rays, n, &context->tile->trace, &all, context->counters, &stop,
                        context->error);
    return lr_trace_scene(structure, &rays, n, &context->tile->trace, only_t,
                          only_t ? &distances : &all, context->counters, &stop, context->error);
}

/* A ray that has passed through so many surfaces that are cut away misses. */
static const uint32_t MOST_PASSED = 1 << 16;

/* Whether a ray of direction d leaves the object at hit k. */
static bool leaves_object(const lr_hits *hit, uint32_t k, const double d[3])
{
    return d[0] * hit->gx[k] + d[1] * hit->gy[k] + d[2] * hit->gz[k] > 0;
}

/* Continue ray `to` of the batch from hit k, beyond its surface. */
static void pass_through(uint32_t k, uint32_t to, const double p[3], const double d[3],
                         lr_batch *batch)
{
    const lr_hits *hit = &batch->hit;
    const int32_t side = leaves_object(hit, k, d) ? -1 : 1;
    batch->start[to] = (lr_start){{hit->ci[k], hit->cj[k], hit->ck[k]}, side};
    batch->t_passed[to] = batch->t_passed[k] + hit->t[k];
    batch->t_max[to] = batch->t_max[k] - hit->t[k];
    batch->t_min[to] = 0;
    lr_put_ray(&batch->ray, to, p, d);
}

/* Trace a filled batch in an instance that is cut: reads rays; writes hits, batch and pairs. */
static lr_status trace_cut(const lr_context *context, const lr_intersect_options *options,
                           bool leaves, lr_pair *pairs, uint32_t n, lr_hit_queue *hits,
                           lr_batch *batch)
{
    const lr_placed *placed = &context->scene->instances[pairs[0].instance];
    lr_status status = LR_OK;
    memset(batch->t_passed, 0, n * sizeof *batch->t_passed);
    for (uint32_t left = n, round = 0; left > 0 && round < MOST_PASSED; round++) {
        status = trace_batch(context, options, pairs[0].instance, leaves, false, left, batch);
        if (status != LR_OK)
            break;
        if (options->steps)
            add_steps(pairs, left, batch, hits);
        uint32_t passed = 0;
        for (uint32_t k = 0; k < left; k++) {
            const double t = batch->hit.t[k];
            double p[3], d[3], world[3];
            if (!(t < INFINITY))
                continue;
            lr_get_ray(&batch->ray, k, p, d);
            for (int a = 0; a < 3; a++)
                p[a] += t * d[a];
            lr_map_point(placed->world_from_object, p, world);
            if (lr_clips_keep(placed->clips, placed->n_clips, world,
                              leaves_object(&batch->hit, k, d))) {
                keep_if_nearer(options, pairs[k], k, batch->t_passed[k] + t, batch, hits);
                continue;
            }
            pass_through(k, passed, p, d, batch);
            pairs[passed++] = pairs[k];
        }
        left = passed;
        leaves = true;
    }
    for (uint32_t k = 0; k < n; k++)
        batch->t_min[k] = options->t_min;
    return status;
}

/* Trace a filled batch: reads rays; writes hits, and the batch and the pairs. */
static lr_status trace_instance(const lr_context *context, const lr_intersect_options *options,
                                bool leaves, lr_pair *pairs, uint32_t n, lr_hit_queue *hits,
                                lr_batch *batch)
{
    const uint32_t instance = pairs[0].instance;
    if (context->scene->instances[instance].n_clips > 0)
        return trace_cut(context, options, leaves, pairs, n, hits, batch);
    const lr_status status =
        trace_batch(context, options, instance, leaves, options->any, n, batch);
    if (status != LR_OK)
        return status;
    if (options->steps)
        add_steps(pairs, n, batch, hits);
    for (uint32_t k = 0; k < n; k++)
        keep_if_nearer(options, pairs[k], k, batch->hit.t[k], batch, hits);
    return LR_OK;
}

/* Trace the sorted pairs, a batch for each instance: reads rays; writes hits, and batch and
 * pairs. */
static lr_status trace_pairs(const lr_context *context, const lr_intersect_options *options,
                             lr_pair *pairs, uint32_t n, const lr_ray_queue *rays,
                             lr_hit_queue *hits, lr_batch *batch)
{
    for (uint32_t first = 0, end; first < n; first = end) {
        const uint32_t instance = pairs[first].instance;
        for (end = first + 1; end < n && pairs[end].instance == instance;)
            end++;
        const bool leaves = fill_batch(context->scene, options->leaving, pairs + first, end - first,
                                       rays, hits, batch);
        const lr_status status =
            trace_instance(context, options, leaves, pairs + first, end - first, hits, batch);
        if (status != LR_OK)
            return status;
    }
    return LR_OK;
}

/* Begin without hits: reads the rays' ends; writes hits and stacks. */
static void begin(const lr_hierarchy *hierarchy, const lr_intersect_options *options,
                  const lr_ray_queue *rays, lr_hit_queue *hits, lr_intersect_memory *memory)
{
    const uint32_t root = hierarchy->n_nodes > 0 ? 1 : 0;
    for (uint32_t i = 0; i < rays->n; i++) {
        hits->t[i] = rays->t_max[i];
        hits->instance[i] = LR_NOWHERE;
        memory->stacked[i] = root;
        memory->stack[(size_t)i * hierarchy->height] = (lr_branch){options->t_min, 0};
        memory->active[i] = i;
    }
    for (uint32_t i = 0; i < rays->n && options->steps; i++)
        hits->hit.steps[i] = 0;
    for (uint32_t i = 0; i < rays->n && options->t_min != 0; i++)
        memory->batch.t_min[i] = options->t_min;
}

lr_status lr_intersect_closest(const lr_context *context, const lr_intersect_options *options,
                               const lr_ray_queue *rays, lr_hit_queue *hits,
                               lr_intersect_memory *memory)
{
    const lr_scene *scene = context->scene;
    lr_counters *counters = context->counters;
    const uint64_t rays_before = counters != NULL ? counters->rays : 0;
    const uint64_t hits_before = counters != NULL ? counters->hits : 0;
    begin(&scene->hierarchy, options, rays, hits, memory);
    for (uint32_t n_active = rays->n; n_active > 0;) {
        uint32_t n_pairs = 0, still = 0;
        for (uint32_t k = 0; k < n_active; k++) {
            const uint32_t ray = memory->active[k];
            lr_branch *stack = memory->stack + (size_t)ray * scene->hierarchy.height;
            const uint32_t instance = next_instance(scene, options, rays, ray, hits->t[ray], stack,
                                                    &memory->stacked[ray]);
            if (instance == LR_NOWHERE)
                continue;
            memory->pairs[n_pairs++] = (lr_pair){ray, instance};
            memory->active[still++] = ray;
        }
        if (lr_stopped(context->watch))
            return lr_fail_stopped(context->error);
        sort_pairs(memory, n_pairs, scene->n_instances);
        const lr_status status =
            trace_pairs(context, options, memory->pairs, n_pairs, rays, hits, &memory->batch);
        if (status != LR_OK)
            return status;
        n_active = 0;
        for (uint32_t k = 0; k < still; k++)
            if (!options->any || hits->instance[memory->active[k]] == LR_NOWHERE)
                memory->active[n_active++] = memory->active[k];
    }
    if (counters != NULL) { /* a ray counts once, not once per instance */
        counters->rays = rays_before + rays->n;
        counters->hits = hits_before;
        for (uint32_t i = 0; i < rays->n; i++)
            counters->hits += hits->instance[i] != LR_NOWHERE;
    }
    return LR_OK;
}
