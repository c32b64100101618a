/* The nearest hits of a wave.
 *
 * In rounds: every ray goes through the tree of instances to the next one that it may meet
 * before its nearest hit. Where a tree of triangles tells what it meets there, it goes on with
 * that at once. Else the pairs of ray and instance are sorted by instance; each
 * instance traces its rays as one batch in its own space, with the same t. A ray is done
 * when no instance is left before its hit, a shadow ray also at any hit. A hit does not
 * depend on other rays, nor on the order of instances, since t_max only decides whether a
 * hit counts.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/intersect_closest.h"

#include "base/affine.h"
#include "base/error.h"
#include "trace/structure.h"
#include "trace/triangle_tree.h"

enum { DIGIT_BITS = 8, N_DIGITS = 1 << DIGIT_BITS };

/* May a ray of that visibility hit this instance at all? */
static bool may_hit(const lr_placed *placed, lr_among among, uint32_t visibility)
{
    const bool included = placed->clear ? among != LR_AMONG_OPAQUE : among != LR_AMONG_CLEAR;
    return included && (placed->visibility & visibility) != 0;
}

/* A ray that is prepared for the tree of an instance. */
typedef struct aimed {
    uint32_t instance; /* or LR_NOWHERE */
    bool meets;        /* something, perhaps */
    double d[3];       /* in object space */
    lr_tree_ray ray;
} aimed;

enum { AIMED_MAX = 8 };

/* A ray of the wave on its way through the instances. */
typedef struct traveller {
    uint32_t i; /* its place in the wave */
    double o[3], d[3];
    lr_slabs slabs;
    lr_branch *stack;
    uint32_t n;       /* branches on the stack */
    aimed *aimed;     /* [n_aimed] */
    uint32_t n_aimed; /* a power of two */
} traveller;

/* The ray, prepared for an instance's tree. */
static aimed *aim(const lr_context *context, const lr_intersect_options *options,
                  const lr_ray_queue *rays, const traveller *way, uint32_t instance)
{
    aimed *at = &way->aimed[instance & (way->n_aimed - 1)];
    if (at->instance == instance)
        return at;
    const lr_placed *placed = &context->scene->instances[instance];
    const bool left = options->leaving && rays->from[way->i] == instance;
    double o[3];
    lr_map_point(placed->object_from_world, way->o, o);
    lr_map_vector(placed->object_from_world, way->d, at->d);
    at->instance = instance;
    at->meets =
        lr_tree_aim(placed->structure, o, at->d, options->t_min, left ? &rays->start[way->i] : NULL,
                    left ? rays->way[way->i] : NULL, options->any, &at->ray);
    if (context->counters != NULL) {
        context->counters->pairs++;
        context->counters->in_lanes++;
    }
    return at;
}

/* Does a ray that starts in a solid, and meets something else there before it ends, first leave the
 * solid beyond that? Then it has missed nothing, and no walk through cells needs to tell. */
static bool ends_within(const lr_structure *structure, uint32_t branch, const lr_tree_ray *ray)
{
    lr_tree_ray whole = *ray;
    double n[3];
    whole.any = false;
    if (lr_tree_meet(structure, branch, INFINITY, LR_NO_TRIANGLE, &whole) != LR_TREE_MEETS)
        return false;
    lr_triangle_cell_normal(structure->tree->cells, whole.triangle, n);
    return lr_dot(n, whole.r.d) > 0;
}

/* Meet a part of an instance by its tree: writes a hit that is nearer than what the ray has met so
 * far; false where only a batch can tell. */
static bool meet_by_tree(const lr_context *context, const lr_intersect_options *options, aimed *at,
                         uint32_t i, uint32_t branch, lr_hit_queue *hits)
{
    const uint32_t instance = at->instance;
    const lr_structure *structure = context->scene->instances[instance].structure;
    const bool again = !options->any && hits->instance[i] == instance;
    const lr_tree_outcome outcome = lr_tree_meet(
        structure, branch, hits->t[i], again ? hits->hit.triangle[i] : LR_NO_TRIANGLE, &at->ray);
    if (outcome == LR_TREE_ASKS &&
        !(hits->t[i] < INFINITY && ends_within(structure, branch, &at->ray)))
        return false;
    if (context->counters != NULL) {
        context->counters->nodes += at->ray.n_nodes;
        context->counters->tests += at->ray.n_blocks;
    }
    if (outcome != LR_TREE_MEETS || (at->ray.t == hits->t[i] && instance > hits->instance[i]))
        return true;
    if (!options->any &&
        !lr_tree_put(structure, &at->ray, at->d, context->tile->trace.normal, &hits->hit, i))
        return false;
    hits->instance[i] = instance;
    return true;
}

/* Go on with a ray to the next instance for which it needs a batch, or LR_NOWHERE: writes its hits
 * by trees on the way, and its stack. */
static uint32_t go_on(const lr_context *context, const lr_intersect_options *options, bool by_trees,
                      const lr_ray_queue *rays, traveller *way, lr_hit_queue *hits)
{
    const lr_scene *scene = context->scene;
    const uint32_t i = way->i;
    const bool opened = by_trees && scene->opened.boxes.n_nodes > 0;
    const lr_wide_node *nodes = opened ? scene->opened.boxes.nodes : scene->boxes.nodes;
    const uint32_t from = options->leaving ? rays->from[i] : LR_NOWHERE;
    bool left = false;
    uint64_t n_nodes = 0;
    for (float last = lr_wide_t(&way->slabs, hits->t[i], 1);;) {
        const uint32_t leaf =
            scene->tree_ops->next(nodes, &way->slabs, last, way->stack, &way->n, &n_nodes);
        if (leaf == LR_NOWHERE)
            return LR_NOWHERE;
        const uint32_t instance = opened ? scene->opened.parts[leaf].instance : leaf;
        const lr_placed *placed = &scene->instances[instance];
        if (!may_hit(placed, options->among, rays->visibility[i]) || (left && instance == from))
            continue;
        if (!by_trees || !placed->has_tree)
            return instance;
        left = left || instance == from;
        aimed *at = aim(context, options, rays, way, instance);
        const uint32_t branch = opened && instance != from ? scene->opened.parts[leaf].branch
                                                           : lr_tree_root(placed->structure->tree);
        if (!at->meets)
            continue;
        if (!meet_by_tree(context, options, at, i, branch, hits))
            return instance;
        if (options->any && hits->instance[i] != LR_NOWHERE)
            return LR_NOWHERE;
        last = lr_wide_t(&way->slabs, hits->t[i], 1);
    }
}

/* Let the active rays go on: reads them; writes hits, stacks, and the pairs for batches, of which
 * it returns the number. The rays of these are those that are still active. */
static uint32_t find_pairs(const lr_context *context, const lr_intersect_options *options,
                           uint32_t n_active, const lr_ray_queue *rays, lr_hit_queue *hits,
                           lr_intersect_memory *memory)
{
    const uint32_t room = context->scene->n_branches;
    const bool by_trees = !options->steps && lr_tree_takes(&context->tile->trace);
    uint32_t n_pairs = 0;
    aimed trees[AIMED_MAX];
    const uint32_t n_aimed = context->scene->opened.boxes.n_nodes > 0 ? AIMED_MAX : 1;
    for (uint32_t k = 0; k < n_active; k++) {
        traveller way = {.i = memory->active[k],
                         .n = memory->stacked[memory->active[k]],
                         .aimed = trees,
                         .n_aimed = n_aimed};
        if (way.n == 0)
            continue;
        for (uint32_t n = 0; n < n_aimed; n++)
            trees[n].instance = LR_NOWHERE;
        way.stack = memory->stack + (size_t)way.i * room;
        lr_get_ray(&rays->ray, way.i, way.o, way.d);
        if (!lr_slabs_of(way.o, way.d, options->t_min, &way.slabs))
            continue;
        const uint32_t instance = go_on(context, options, by_trees, rays, &way, hits);
        memory->stacked[way.i] = way.n;
        if (instance == LR_NOWHERE)
            continue;
        memory->active[n_pairs] = way.i;
        memory->pairs[n_pairs++] = (lr_pair){way.i, instance};
    }
    return n_pairs;
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
        memcpy(batch->way[k], rays->way[i], sizeof batch->way[k]);
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
    rays.way = leaves ? (const double (*)[3])batch->way : NULL;
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
    batch->way[to][0] = NAN;
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
static void begin(const lr_scene *scene, const lr_intersect_options *options,
                  const lr_ray_queue *rays, lr_hit_queue *hits, lr_intersect_memory *memory)
{
    const uint32_t root = scene->boxes.n_nodes > 0 ? 1 : 0;
    for (uint32_t i = 0; i < rays->n; i++) {
        hits->t[i] = rays->t_max[i];
        hits->instance[i] = LR_NOWHERE;
        memory->stacked[i] = root;
        memory->stack[(size_t)i * scene->n_branches] = (lr_branch){-INFINITY, 0};
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
    begin(scene, options, rays, hits, memory);
    for (uint32_t n_active = rays->n; n_active > 0;) {
        const uint32_t n_pairs = find_pairs(context, options, n_active, rays, hits, memory);
        if (lr_stopped(context->watch))
            return lr_fail_stopped(context->error);
        sort_pairs(memory, n_pairs, scene->n_instances);
        const lr_status status =
            trace_pairs(context, options, memory->pairs, n_pairs, rays, hits, &memory->batch);
        if (status != LR_OK)
            return status;
        n_active = 0;
        for (uint32_t k = 0; k < n_pairs; k++)
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
