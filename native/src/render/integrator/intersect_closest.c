/* Casting a wave.
 *
 * In rounds: every ray walks the hierarchy to the next instance that it may meet
 * before its nearest hit; the pairs of ray and instance are sorted by instance;
 * each instance traces its rays as one batch in its own space, with the same t.
 * A ray is done when nothing is left in front of its hit, a ray of light also
 * when anything is hit. What a ray finds depends on no other ray, and as t_max
 * only decides whether a hit counts, not on the order of the instances either.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/intersect_closest.h"

#include "base/affine.h"
#include "base/error.h"

enum { DIGIT_BITS = 11, N_DIGITS = 1 << DIGIT_BITS };

typedef struct lr_caster {
    const lr_scene *scene;
    lr_workspace *w;
    const lr_cast_options *options;
    lr_counters *counters;
    const lr_watch *watch;
    lr_error *error;
} lr_caster;

/* May ray i hit this instance at all? */
static bool meets(const lr_caster *c, uint32_t i, uint32_t instance)
{
    const lr_placed *placed = &c->scene->instances[instance];
    const bool wanted =
        placed->clear ? c->options->among != LR_AMONG_OPAQUE : c->options->among != LR_AMONG_CLEAR;
    return wanted && (placed->visibility & c->w->wave.visibility[i]) != 0;
}

/* Take ray i's walk up again. */
static uint32_t walk(const lr_caster *c, uint32_t i)
{
    const lr_wave *wave = &c->w->wave;
    const lr_hierarchy *hierarchy = &c->scene->hierarchy;
    lr_branch *stack = wave->stack + (size_t)i * hierarchy->height;
    uint32_t *n = &wave->stacked[i];
    while (*n > 0 && stack[*n - 1].t > wave->t[i]) /* so most walks end */
        --*n;
    if (*n == 0)
        return LR_NOWHERE;
    double o[3], d[3];
    lr_get_ray(&wave->ray, i, o, d);
    const lr_slabs ray = lr_slabs_of(o, d);
    for (;;) {
        const uint32_t instance =
            lr_hierarchy_next(hierarchy, &ray, c->options->t_min, wave->t[i], stack, n);
        if (instance == LR_NOWHERE || meets(c, i, instance))
            return instance;
    }
}

/* Sort by instance; the order of rays stays within each. Least significant digit
 * first, no more digits than the number of instances has. The sorted pairs are
 * in w->pairs. */
static void sort_pairs(lr_workspace *w, uint32_t n, uint32_t n_instances)
{
    for (uint32_t shift = 0; shift < 32 && (n_instances - 1) >> shift != 0; shift += DIGIT_BITS) {
        uint32_t place[N_DIGITS] = {0};
        for (uint32_t i = 0; i < n; i++)
            place[w->pairs[i].instance >> shift & (N_DIGITS - 1)]++;
        uint32_t sum = 0;
        for (uint32_t digit = 0; digit < N_DIGITS; digit++) {
            const uint32_t count = place[digit];
            place[digit] = sum;
            sum += count;
        }
        for (uint32_t i = 0; i < n; i++)
            w->pairs_sorted[place[w->pairs[i].instance >> shift & (N_DIGITS - 1)]++] = w->pairs[i];
        lr_pair *swap = w->pairs;
        w->pairs = w->pairs_sorted;
        w->pairs_sorted = swap;
    }
}

/* Take the rays of these pairs, all of one instance, into its object space.
 * Returns whether one of them leaves its surface. */
static bool fill_batch(const lr_caster *c, const lr_pair *pairs, uint32_t n)
{
    const lr_wave *wave = &c->w->wave;
    lr_batch *batch = &c->w->batch;
    const double *m = c->scene->instances[pairs[0].instance].object_from_world;
    bool leaves = false;
    for (uint32_t k = 0; k < n; k++) {
        const uint32_t i = pairs[k].ray;
        double o[3], d[3], p[3], v[3];
        lr_get_ray(&wave->ray, i, o, d);
        lr_map_point(m, o, p);
        lr_map_vector(m, d, v);
        lr_put_ray(&batch->ray, k, p, v);
        batch->t_max[k] = wave->t[i];
    }
    if (!c->options->leaving)
        return false;
    for (uint32_t k = 0; k < n; k++) {
        const uint32_t i = pairs[k].ray;
        const bool left = wave->from[i] == pairs[k].instance;
        batch->start[k] = left ? wave->start[i] : (lr_start){.side = 0};
        leaves |= left;
    }
    return leaves;
}

/* Keep the hits that come before what the rays had. */
static void scatter(const lr_caster *c, const lr_pair *pairs, uint32_t n)
{
    lr_wave *wave = &c->w->wave;
    const lr_hits *from = &c->w->batch.hit, *to = &wave->hit;
    for (uint32_t k = 0; k < n; k++) {
        const uint32_t i = pairs[k].ray, instance = pairs[k].instance;
        const double t = from->t[k];
        if (c->options->steps)
            to->steps[i] += from->steps[k];
        if (!(t < INFINITY) || t > wave->t[i] || (t == wave->t[i] && instance > wave->instance[i]))
            continue;
        wave->instance[i] = instance;
        if (c->options->any)
            continue;
        wave->t[i] = t;
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
}

static lr_status trace_group(const lr_caster *c, const lr_pair *pairs, uint32_t n)
{
    const lr_batch *b = &c->w->batch;
    const bool leaves = fill_batch(c, pairs, n);
    const lr_rays rays = {
        .ox = b->ray.ox,
        .oy = b->ray.oy,
        .oz = b->ray.oz,
        .dx = b->ray.dx,
        .dy = b->ray.dy,
        .dz = b->ray.dz,
        .t_min = c->options->t_min != 0 ? b->t_min : NULL,
        .t_max = b->t_max,
        .start = leaves ? b->start : NULL,
    };
    const lr_hits only_t = {.t = b->hit.t};
    lr_hits all = b->hit;
    if (!c->options->steps)
        all.steps = NULL;
    const lr_watch stop = {.stop = c->watch != NULL ? c->watch->stop : NULL};
    const lr_status status =
        lr_trace(c->scene->instances[pairs[0].instance].structure, &rays, n, &c->options->trace,
                 c->options->any ? &only_t : &all, c->counters, &stop, c->error);
    if (status == LR_OK)
        scatter(c, pairs, n);
    return status;
}

static lr_status trace_pairs(const lr_caster *c, uint32_t n)
{
    const lr_pair *pairs = c->w->pairs;
    for (uint32_t first = 0, end; first < n; first = end) {
        for (end = first + 1; end < n && pairs[end].instance == pairs[first].instance;)
            end++;
        const lr_status status = trace_group(c, pairs + first, end - first);
        if (status != LR_OK)
            return status;
    }
    return LR_OK;
}

static void begin(const lr_caster *c, uint32_t n)
{
    lr_wave *wave = &c->w->wave;
    for (uint32_t i = 0; i < n; i++) {
        wave->instance[i] = LR_NOWHERE;
        wave->hit.steps[i] = 0;
        wave->stacked[i] = c->scene->hierarchy.n_nodes > 0 ? 1 : 0;
        wave->stack[(size_t)i * c->scene->hierarchy.height] = (lr_branch){c->options->t_min, 0};
        c->w->batch.t_min[i] = c->options->t_min;
        c->w->active[i] = i;
    }
}

lr_status lr_cast(const lr_scene *scene, lr_workspace *workspace, uint32_t n,
                  const lr_cast_options *options, lr_counters *counters, const lr_watch *watch,
                  lr_error *error)
{
    const lr_caster c = {scene, workspace, options, counters, watch, error};
    lr_workspace *w = workspace;
    const uint64_t rays_before = counters != NULL ? counters->rays : 0;
    const uint64_t hits_before = counters != NULL ? counters->hits : 0;
    begin(&c, n);
    for (uint32_t n_active = n; n_active > 0;) {
        uint32_t n_pairs = 0, still = 0;
        for (uint32_t k = 0; k < n_active; k++) {
            const uint32_t ray = w->active[k], instance = walk(&c, ray);
            if (instance == LR_NOWHERE)
                continue;
            w->pairs[n_pairs++] = (lr_pair){ray, instance};
            w->active[still++] = ray;
        }
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        sort_pairs(w, n_pairs, scene->n_instances);
        const lr_status status = trace_pairs(&c, n_pairs);
        if (status != LR_OK)
            return status;
        n_active = 0;
        for (uint32_t k = 0; k < still; k++)
            if (!options->any || w->wave.instance[w->active[k]] == LR_NOWHERE)
                w->active[n_active++] = w->active[k];
    }
    if (counters != NULL) { /* a ray counts once, not once per instance */
        counters->rays = rays_before + n;
        counters->hits = hits_before;
        for (uint32_t i = 0; i < n; i++)
            counters->hits += w->wave.instance[i] != LR_NOWHERE;
    }
    return LR_OK;
}
