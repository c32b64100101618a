/* Continues paths from the surfaces that they have hit.
 *
 * A surface spawns rays of several kinds: by its diffuse lobes, by its glossy ones,
 * refracted, straight through. A point in a volume spawns one, by its phase function or as a
 * surface does. Where the
 * queue has slots for all kinds that matter, each is spawned; else those of the largest throughput
 * are, and one of the others, chosen at random by its albedo. Paths of low throughput end by
 * Russian roulette. Both are weighted by the inverse probability.
 *
 * Limits count as in Cycles: a ray beyond its limit still meets lights, the world and
 * emitting surfaces, but is not scattered any more.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/scatter.h"

#include "render/film/sampling.h"
#include "render/integrator/path_record.h"
#include "render/integrator/shading_point.h"

/* Below this throughput kinds are not split, and paths end by Russian roulette. */
static const double LOW_THROUGHPUT = 1.0 / 64;

/* The least probability of a volume, and of what is behind it, where only one is continued. */
static const double EVEN_LESS = 0.1;

/* Random numbers of 32 bits cannot choose with a smaller probability. */
static const double PROBABILITY_MIN = 0x1p-32;

enum {
    CHOOSE_KIND = 8,
    LIVE = 16,
    TURN = 24,
    TURN_MORE = 32,
    CHILD = 40
}; /* choices: see lr_key */

static double largest(const double throughput[3])
{
    return fmax(throughput[0], fmax(throughput[1], throughput[2]));
}

/* Whether a ray of this kind is not scattered again. */
static bool is_last(const lr_tile *tile, const lr_path *path, int kind)
{
    const int32_t limit[LR_RAY_KINDS] = {tile->max_bounces,         tile->diffuse_bounces,
                                         tile->glossy_bounces,      tile->transmission_bounces,
                                         tile->transparent_bounces, tile->volume_bounces};
    if (path->last || path->bounces[kind] >= limit[kind])
        return true;
    return kind != LR_RAY_TRANSPARENT && path->bounces[LR_RAY_CAMERA] >= limit[LR_RAY_CAMERA];
}

double lr_world_distance(const lr_tile *tile, const lr_path *path, int kind)
{
    const bool short_sighted =
        tile->ambient_distance > 0 && kind == LR_RAY_DIFFUSE && is_last(tile, path, kind);
    return short_sighted ? tile->ambient_distance : INFINITY;
}

/* Whether it has no surface: to go through it counts for nothing. */
static bool is_bare(const lr_shading_point *s)
{
    return (s->material->flags & LR_MATERIAL_BARE) != 0;
}

/* Whether a path of this kind may contribute anything. */
static bool may_contribute(const lr_context *context, const lr_shading_point *s, int kind)
{
    const bool contributes = context->last_contributes || !is_last(context->tile, s->path, kind);
    if (!(s->bsdf.albedo[kind] > 0))
        return false;
    if (is_bare(s))
        return s->path->bounds < LR_BOUNDS_MAX &&
               (s->path->seen || context->last_contributes || !s->path->last);
    if (kind == LR_RAY_TRANSPARENT && s->path->bounces[kind] > context->tile->transparent_bounces)
        return false;
    if (kind == LR_RAY_TRANSPARENT) /* counts for alpha */
        return s->path->seen || contributes;
    return !s->path->last && contributes;
}

/* An albedo that sums and quotients can take. */
static double bounded(double albedo)
{
    return fmin(albedo, 0x1p1000);
}

void lr_scatter_choose(const lr_context *context, lr_shading_point *s, uint32_t *free_slots)
{
    int order[LR_RAY_KINDS];
    uint32_t n = 0, sure = 0;
    double rest = 0;
    for (int kind = 0; kind < LR_RAY_KINDS; kind++) {
        s->probability[kind] = 0;
        s->sure[kind] = false;
        if (kind == LR_RAY_CAMERA || !may_contribute(context, s, kind))
            continue;
        uint32_t at = n++;
        for (; at > 0 && s->bsdf.albedo[order[at - 1]] < s->bsdf.albedo[kind]; at--)
            order[at] = order[at - 1];
        order[at] = kind;
    }
    const double throughput = largest(s->path->throughput);
    while (sure < n && sure < *free_slots + (*free_slots + 1 >= n) &&
           s->bsdf.albedo[order[sure]] * throughput >= LOW_THROUGHPUT)
        s->sure[order[sure++]] = true;
    if (sure + 1 == n) /* nothing to choose from */
        s->sure[order[sure++]] = true;
    for (uint32_t k = 0; k < sure; k++)
        s->probability[order[k]] = 1;
    for (uint32_t k = sure; k < n; k++)
        rest += bounded(s->bsdf.albedo[order[k]]);
    for (uint32_t k = sure; k < n; k++) {
        const double probability = bounded(s->bsdf.albedo[order[k]]) / rest;
        s->probability[order[k]] = probability >= PROBABILITY_MIN ? probability : 0;
    }
    for (int kind = 0; kind < LR_RAY_KINDS && s->share < 1; kind++)
        s->probability[kind] *= s->share;
    const uint32_t followed = sure + (sure < n);
    *free_slots -= followed > 1 ? followed - 1 : 0;
    s->chooses_one = sure < n;
}

/* The kind chosen at random among those that are not sure, or none (0). */
static int choose_kind(const lr_shading_point *s)
{
    double u = s->share * lr_sample_one(lr_key(s->path->key, CHOOSE_KIND), s->path->sample);
    int drawn = 0;
    for (int kind = 0; kind < LR_RAY_KINDS; kind++) {
        if (s->sure[kind] || !(s->probability[kind] > 0))
            continue;
        drawn = kind; /* the last one where rounding left a rest */
        if (u < s->probability[kind])
            break;
        u -= s->probability[kind];
    }
    return drawn;
}

/* A direction on the wrong side of the geometric surface, by a shading normal. At a flat face as in
 * Cycles: a reflection is lost, a refraction unchanged. Where facets of the field approximate a
 * smooth surface, the direction is mirrored to the right side. False: it is lost. */
static bool turn_to_side(const lr_shading_point *s, bool beyond, double d[3])
{
    const double height = lr_dot(d, s->point.facing);
    if ((height < 0) == beyond && height != 0)
        return true;
    for (int a = 0; a < 3; a++)
        d[a] -= 2 * height * s->point.facing[a];
    return !s->point.bends;
}

static bool survives_roulette(lr_path *child)
{
    const double most = largest(child->throughput);
    if (most >= LOW_THROUGHPUT)
        return true;
    const double probability = most / LOW_THROUGHPUT;
    for (int a = 0; a < 3; a++)
        child->throughput[a] /= probability;
    return lr_sample_one(lr_key(child->key, LIVE), child->sample) < probability;
}

/* Continue straight through. */
static void go_through(const lr_shading_point *s, lr_path *child)
{
    const double *o = s->path->origin;
    const double segment[3] = {s->position[0] - o[0], s->position[1] - o[1], s->position[2] - o[2]};
    for (int a = 0; a < 3; a++) {
        child->direction[a] = -s->point.view[a];
        child->throughput[a] *= s->bsdf.transparency[a];
    }
    child->travelled += sqrt(lr_dot(segment, segment));
    child->t_max = s->left;
}

/* Sample a direction of this kind; false where the light is lost. */
static bool scatter_direction(const lr_tile *tile, const lr_shading_point *s, int kind,
                              lr_path *child)
{
    lr_scatter sample = {.delta = false};
    double u[3];
    lr_sample_pair(lr_key(s->path->key, TURN + (uint32_t)kind), s->path->sample, u);
    u[2] = lr_sample_one(lr_key(s->path->key, TURN_MORE + (uint32_t)kind), s->path->sample);
    if (!(s->in_volume ? lr_hybrid_sample(&s->hybrid, &s->bsdf, s->point.view, u, &sample)
                       : lr_bsdf_sample(&s->bsdf, kind, u, &sample)))
        return false;
    for (int a = 0; a < 3; a++) {
        child->direction[a] = sample.direction[a];
        child->throughput[a] *= sample.weight[a];
    }
    child->pdf = sample.delta ? INFINITY : sample.pdf * s->probability[kind];
    lr_lit_side(s, child->normal);
    child->travelled = 0;
    child->t_max = lr_world_distance(tile, s->path, kind);
    child->visibility = lr_sees(kind);
    child->seen = false;
    child->bounces[LR_RAY_CAMERA]++;
    return true;
}

/* Reads a shading point; writes a path of this kind into the next queue, if it continues. */
static void spawn_path(const lr_context *context, const lr_shading_point *s, int kind,
                       lr_path_queue *next)
{
    const lr_scene *scene = context->scene;
    const uint32_t pixel = s->path->pixel;
    assert(next->n[pixel] < next->slots); /* what lr_scatter_choose has counted */
    lr_path *child = &next->paths[lr_slot_of(next, pixel) + next->n[pixel]];
    *child = *s->path;
    for (int a = 0; a < 3; a++)
        child->throughput[a] /= s->probability[kind];
    child->last = is_bare(s) ? s->path->last : is_last(context->tile, s->path, kind);
    child->key = lr_key(s->path->key, CHILD + (uint32_t)kind);
    child->bounces[kind] += !is_bare(s);
    child->bounds += is_bare(s);
    child->primary &= is_bare(s);
    if (kind == LR_RAY_TRANSPARENT)
        go_through(s, child);
    else if (!scatter_direction(context->tile, s, kind, child))
        return;
    if (!survives_roulette(child))
        return;
    const bool beyond = kind == LR_RAY_TRANSPARENT ||
                        (kind == LR_RAY_TRANSMISSION && lr_leads_beyond(s, child->direction));
    const bool leaves_facet = kind != LR_RAY_TRANSPARENT && !s->in_volume;
    if (leaves_facet && (beyond || !s->is_offset) && !turn_to_side(s, beyond, child->direction))
        return;
    memcpy(child->origin, beyond ? s->position : s->origin, sizeof child->origin);
    child->from = s->instance;
    child->start = kind == LR_RAY_TRANSPARENT
                       ? lr_surface_straight_start(s, s->path->from, &s->path->start)
                       : lr_surface_start(s, beyond);
    lr_surface_way(s, &child->start, child->way);
    if (beyond && scene->has_media && lr_surface_cross(scene, s, &child->media) &&
        context->counters != NULL)
        context->counters->forgotten++;
    next->n[pixel]++;
    lr_record_ray(child, s->path, kind, context->tile->record);
}

void lr_scatter_choose_volume(const lr_context *context, lr_volume_point *point,
                              lr_shading_point *behind, uint32_t *free_slots)
{
    const lr_path *path = &point->path;
    point->continues = context->last_contributes || !is_last(context->tile, path, LR_RAY_VOLUME);
    point->probability = point->continues;
    if (!point->continues || behind == NULL)
        return;
    if (*free_slots > 0) {
        --*free_slots;
        return;
    }
    const double volume = bounded(largest(path->throughput));
    const double surface = bounded(largest(behind->path->throughput));
    point->probability = lr_clamp(volume / (volume + surface), EVEN_LESS, 1 - EVEN_LESS);
    behind->share = 1 - point->probability;
    behind->gives_way =
        lr_sample_one(lr_key(path->key, CHOOSE_KIND), path->sample) < point->probability;
    point->continues = behind->gives_way;
}

void lr_scatter_on(const lr_context *context, const lr_shading_point *s, lr_path_queue *next)
{
    const int drawn = s->chooses_one ? choose_kind(s) : 0;
    if (s->gives_way)
        return;
    for (int kind = LR_RAY_DIFFUSE; kind < LR_RAY_KINDS; kind++)
        if (s->sure[kind] || kind == drawn)
            spawn_path(context, s, kind, next);
}
