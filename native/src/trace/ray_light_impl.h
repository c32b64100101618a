/* Rays side by side, written once for all instruction sets: whoever includes this defines
 * LR_VECTORS, LR_LIGHT_RAYS, the function's name, and, for x86, has set the instruction set.
 *
 * Each lane goes its own way along its own ray: it leaves boxes of cells in which nothing is
 * visible by lr_exit's arithmetic until it stands on a visible cell, whose light is added part by
 * part (light_lanes_impl.h), and takes the next ray where its own has ended. Groups of eight lanes
 * take turns, so that one's arithmetic fills the waits of others.
 *
 * Source: Levoy 1990 (leaping, and rays that end where they are opaque); Aila and Laine 2009 for
 * lanes that are refilled.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/light_lanes_impl.h"

#include "grid/surface_cells.h"
#include "trace/cell_graze.h"
#include "trace/hit_record.h"

enum {
    GROUPS = LR_LIGHT_GROUPS,
    LOOKS = 3,  /* for visible cells, before those that were found are taken, */
    ENOUGH = 28 /* or so many of them */
};

/* What all lanes share. */
typedef struct light_job {
    const lr_volume *v;
    const lr_empty_cubes *cubes;
    const lr_rays *rays;
    const lr_trace_options *options;
    const lr_hits *hits;
    lr_counters *counters;
    const lr_watch *watch;
    uint64_t next, end; /* rays that are not begun */
} light_job;

/* ---- rays ------------------------------------------------------------------------ */

/* Let lane l begin ray i; false: that meets nothing. */
static bool begin_ray(lr_light_lanes *k, int l, const light_job *job, uint64_t i)
{
    const lr_rays *rays = job->rays;
    const lr_volume *v = job->v;
    lr_ray r;
    lr_cursor u;
    double graze[3];
    const double o[3] = {rays->ox[i], rays->oy[i], rays->oz[i]};
    const double d[3] = {rays->dx[i], rays->dy[i], rays->dz[i]};
    const double t_min = rays->t_min != NULL ? rays->t_min[i] : 0.0;
    if (!lr_ray_setup(&r, v, o, d, rays->t_max != NULL ? rays->t_max[i] : INFINITY) ||
        !(t_min <= r.t_max && t_min < INFINITY) ||
        !lr_enter(&r, LR_REGULAR, &u, v->surface_lo, v->surface_hi, t_min))
        return false;
    lr_grazes_of(v, &r, graze);
    for (int a = 0; a < 3; a++) {
        k->o[a][l] = r.o[a];
        k->d[a][l] = r.s[a] != 0 ? r.d[a] : 0.0;
        k->inv[a][l] = r.inv[a];
        k->never[a][l] = r.never[a];
        k->graze[a][l] = graze[a];
        k->c[a][l] = u.c[a];
        k->color[a][l] = 0.0;
    }
    k->t[l] = u.t;
    k->t_min[l] = t_min;
    k->t_max[l] = r.t_max;
    k->speed[l] = rays->length != NULL ? rays->length[i] : sqrt(lr_dot(d, d));
    k->transmittance[l] = 1.0;
    k->stop[l] = rays->stop != NULL ? fmax(rays->stop[i], LR_OPAQUE) : 0.0;
    k->end[l] = fmax(rays->stop != NULL ? k->stop[l] : 1.0 - job->options->stop_opacity, LR_OPAQUE);
    k->begins[l] = INFINITY;
    k->looked[l] = 0.0;
    k->ray[l] = i;
    return true;
}

static void put_ray(const lr_light_lanes *k, int l, const light_job *job)
{
    const double color[3] = {k->color[0][l], k->color[1][l], k->color[2][l]};
    lr_put_light(job->hits, k->ray[l], k->begins[l], color, k->transmittance[l],
                 (uint64_t)k->looked[l], job->counters);
}

/* Give lane l the next ray that meets something, or none. */
static void next_ray(lr_light_lanes *k, int l, light_job *job)
{
    const uint32_t bit = 1u << l;
    while (job->next < job->end) {
        const uint64_t i = job->next++;
        lr_put_dark(job->hits, i, i + 1);
        if (begin_ray(k, l, job, i)) {
            k->busy |= bit;
            k->fresh |= bit;
            return;
        }
    }
    k->idle |= bit;
}

/* Lanes whose ray has ended take others. */
static void refill(lr_light_lanes *k, light_job *job)
{
    for (uint32_t left = LR_ALL_LIGHT_LANES & ~(k->busy | k->idle); left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        if (k->began >> l & 1)
            put_ray(k, l, job);
        k->began |= 1u << l;
        next_ray(k, l, job);
    }
}

/* ---- the way ----------------------------------------------------------------------- */

/* Lanes of m leave their boxes, as lr_exit does. */
LR_INLINE void leave_boxes(lr_light_lanes *k, const lr_volume *v, uint32_t bits)
{
    const lr_doubles zero = {0};
    const lr_longs m = lr_longs_of(bits);
    lr_doubles t[3], low[3], high[3], to[3];
    lr_longs up[3], inside = m;
    for (int a = 0; a < 3; a++) {
        const lr_doubles inv = lr_load_doubles(k->inv[a]);
        low[a] = lr_load_doubles(k->low[a]);
        high[a] = lr_load_doubles(k->high[a]);
        up[a] = inv > zero;
        t[a] = (lr_pick_doubles(up[a], high[a] + 1.0, low[a]) - lr_load_doubles(k->o[a])) * inv +
               lr_load_doubles(k->never[a]);
    }
    const lr_longs y = t[1] < t[0];
    const lr_doubles first = lr_pick_doubles(y, t[1], t[0]);
    const lr_longs z = t[2] < first;
    const lr_longs crossed[3] = {~y & ~z, y & ~z, z};
    const lr_doubles before = lr_load_doubles(k->t);
    lr_doubles out = lr_greater_lanes(lr_pick_doubles(z, t[2], first), before);
    inside &= (out <= lr_load_doubles(k->t_max)) & (out < INFINITY);
    for (int a = 0; a < 3; a++) {
        const lr_doubles c = lr_load_doubles(k->c[a]), d = lr_load_doubles(k->d[a]);
        const lr_doubles q = lr_load_doubles(k->o[a]) + out * d;
        lr_doubles in = lr_rounded_down_doubles(q);
        in = lr_pick_doubles((d < zero) & (in == q), in - 1.0, in);
        in = lr_clamp_doubles(in, lr_pick_doubles(up[a], c, low[a]),
                              lr_pick_doubles(up[a], high[a], c));
        const lr_doubles beyond = lr_pick_doubles(up[a], high[a] + 1.0, low[a] - 1.0);
        in = lr_pick_doubles(d == zero, c, in);
        in = lr_pick_doubles(crossed[a], beyond, in);
        inside &= (in >= (double)v->surface_lo[a]) & (in <= (double)v->surface_hi[a]);
        to[a] = in;
    }
    for (int a = 0; a < 3; a++) /* those that end stay where there are bricks */
        lr_store_doubles(k->c[a], lr_pick_doubles(inside, to[a], lr_load_doubles(k->c[a])));
    lr_store_doubles(k->t, lr_pick_doubles(m, out, before));
    k->busy &= ~bits | lr_bits_of_longs(inside);
}

/* Look at the cells on which lanes stand; those that see something stay. */
LR_INLINE void look(lr_light_lanes *k, const light_job *job, uint32_t bits)
{
    const lr_volume *v = job->v;
    lr_eight_ints c[3];
    for (int a = 0; a < 3; a++)
        c[a] = lr_eight_ints_of(lr_load_doubles(k->c[a]));
    lr_find_places(v, c, k->place, k->cell);
    int32_t brick[LR_DOUBLE_LANES], distance[LR_DOUBLE_LANES];
    if (job->cubes != NULL)
        lr_fetch_distances(job->cubes, k->place, k->cell, brick, distance);
    const lr_view seen = job->cubes != NULL ? lr_look_at_distances(brick, distance)
                                            : lr_look_at_masks(v, c, k->place);
    const int last = LR_SIDE - 1;
    const lr_eight_ints apart =
        ((c[0] & last) == last) | ((c[1] & last) == last) | ((c[2] & last) == last);
    for (int a = 0; a < 3; a++) {
        const lr_doubles lo = lr_all_doubles(v->surface_lo[a]);
        const lr_doubles hi = lr_all_doubles(v->surface_hi[a]);
        const lr_doubles low = lr_doubles_of((c[a] & ~seen.block) - seen.reach);
        const lr_doubles high = lr_doubles_of((c[a] | seen.block) + seen.reach);
        lr_store_doubles(k->low[a], lr_greater_lanes(low, lo));
        lr_store_doubles(k->high[a], lr_lesser_lanes(high, hi));
    }
    const lr_doubles looked = lr_load_doubles(k->looked);
    lr_store_doubles(k->looked, lr_pick_doubles(lr_longs_of(bits), looked + 1.0, looked));
    const uint32_t found = lr_bits_of_eight(seen.visible) & bits;
    k->found |= found;
    k->unread |= found;
    k->apart = (k->apart & ~bits) | (lr_bits_of_eight(apart) & bits);
}

/* Go on from cell to cell until most lanes stand on visible ones; how many do. */
LR_INLINE int find_cells(lr_light_lanes k[GROUPS], const light_job *job)
{
    int found = 0;
    for (int n = 0; n < LOOKS && found < ENOUGH; n++) {
        found = 0;
        for (int g = 0; g < GROUPS; g++) {
            const uint32_t moving = k[g].busy & ~(k[g].found | k[g].fresh);
            if (moving != 0)
                leave_boxes(&k[g], job->v, moving);
            k[g].fresh = 0;
        }
        for (int g = 0; g < GROUPS; g++) {
            const uint32_t looking = k[g].busy & ~k[g].found;
            if (looking != 0)
                look(&k[g], job, looking);
            found += __builtin_popcount(k[g].found);
        }
    }
    return found;
}

/* ---- all of it ------------------------------------------------------------------------ */

LR_INLINE void light_rays(light_job *job, int32_t type, size_t size)
{
    lr_light_lanes k[GROUPS];
    lr_light_roots roots = {.n = 0};
    memset(k, 0, sizeof k);
    for (int g = 0; g < GROUPS; g++)
        for (int l = 0; l < LR_DOUBLE_LANES; l++)
            k[g].loaded[l] = -1.0;
    for (;;) {
        uint32_t busy = 0;
        for (int g = 0; g < GROUPS; g++) {
            refill(&k[g], job);
            busy |= k[g].busy;
        }
        if (busy == 0 || lr_stopped(job->watch))
            break;
        if (find_cells(k, job) == 0)
            continue;
        for (int g = 0; g < GROUPS; g++)
            lr_fetch_rows(&k[g], job->v, size);
        for (int g = 0; g < GROUPS; g++)
            lr_read_cells(&k[g], job->v, type);
        for (int g = 0; g < GROUPS; g++)
            lr_find_ends(&k[g], job->v->transfer, &roots);
        lr_find_roots(&roots);
        for (int g = 0; g < GROUPS; g++)
            lr_add_parts(&k[g], job->v->transfer, job->options->tolerance, job->rays->stop != NULL);
    }
    for (int g = 0; g < GROUPS; g++) {
        job->counters->tests += k[g].read;
        job->counters->samples += k[g].parts;
    }
}

void LR_LIGHT_RAYS(const lr_volume *v, const lr_empty_cubes *cubes, const lr_rays *rays,
                   uint64_t first, uint64_t end, const lr_trace_options *options,
                   const lr_hits *hits, lr_counters *counters, const lr_watch *watch)
{
    light_job job = {v, cubes, rays, options, hits, counters, watch, first, end};
    counters->rays += end - first;
    switch (v->desc.sample_type) {
#define LR_SAMPLE_TYPE(id, name, stored, one, step)                                                \
    case id:                                                                                       \
        light_rays(&job, id, sizeof(stored));                                                      \
        return;
#include "grid/sample_types.def"
#undef LR_SAMPLE_TYPE
    }
}
