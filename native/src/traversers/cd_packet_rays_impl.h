/* The rays of packets: how they come into lanes, and how they end. A ray that is set up takes a
 * slot, where it is kept in doubles; in a lane it has what cd_packet_impl.h reads of it.
 *
 * Included by cd_packet_impl.h alone, which says how.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/vectors.h"
#include "trace/enter_lanes_impl.h"
#include "trace/hit_lanes_impl.h"
#include "trace/traverser.h"
#include "traversers/cd_distances.h"

enum {
    GROUPS = 3, /* of lanes, in turns: what one waits for hides behind the other */
    FREE = 4,   /* lanes that must be free to be refilled */
    HELD = 4,   /* lanes that must stand on surface cells for these to be looked at */
    WAITING = LR_DOUBLE_LANES + GROUPS * LR_LANES, /* rays that wait for their hit test, at most */
    SLOTS = GROUPS * LR_LANES + WAITING + 2 * LR_DOUBLE_LANES /* and in lanes, and ready for them */
};

/* What rounding to floats does at most, of the largest coordinate, to a position: six roundings of
 * 2^-24, to where a crossing is along the ray and to the place there. Of the largest coordinate of
 * the ray's origin: the same of doubles, by which the walk of one ray finds its cells. */
static const float ROUNDED = 0x1p-21f;
static const double ROUNDED_DOUBLE = 0x1p-48;

/* A ray in doubles, in a lane or between two. */
typedef struct lr_slot {
    double o[3], d[3], inv[3], t_max; /* as of an lr_ray */
    double t;                         /* no crossing comes before it */
    double begin;                     /* where lanes count from, */
    double scale;                     /* and how many of their units one of t is */
    lr_cursor u;                      /* where it stands between two lanes */
    uint64_t i;
    int32_t side, visited;
    bool stood; /* the hit test in the cell that it stands on */
} lr_slot;

/* The rays of sixteen lanes. */
typedef struct lr_group {
    _Alignas(64) float o[3][LR_LANES], d[3][LR_LANES];
    _Alignas(64) float inv[3][LR_LANES]; /* 1 / d, infinity where that is 0 */
    _Alignas(64) float t[LR_LANES], t_max[LR_LANES];
    _Alignas(64) float unit[LR_LANES]; /* the error of a position, per voxel of the way */
    _Alignas(64) float error[LR_LANES], at[3][LR_LANES];    /* where it came into its cell */
    _Alignas(64) int32_t c[3][LR_LANES], last[3][LR_LANES]; /* its cell; the last one on an axis */
    _Alignas(64) int32_t down[3][LR_LANES];                 /* -1 where it goes down, else 0 */
    _Alignas(64) int32_t axis[LR_LANES];    /* by which it came; -1: it started in its cell */
    _Alignas(64) int32_t side[LR_LANES];    /* not 0: it leaves a surface */
    _Alignas(64) int32_t visited[LR_LANES]; /* cells */
    uint32_t alive;
    uint32_t held, stood; /* before the hit test in a surface cell, and after it */
    uint8_t slot[LR_LANES];
} lr_group;

typedef struct lr_packet {
    const lr_volume *v;
    const lr_cd_distances *f;
    const lr_rays *rays;
    const lr_trace_options *options;
    const lr_hits *hits;
    lr_counters *counters;
    uint64_t next, end;
    float largest;     /* coordinate */
    bool side_by_side; /* hit tests of the field */
    int n_free, n_ready, n_waiting;
    uint8_t free[SLOTS + 1], ready[SLOTS], waiting[WAITING];
    lr_group group[GROUPS];
    lr_hit_lanes lanes;
    lr_slot slot[SLOTS];
} lr_packet;

static lr_ray ray_of(const lr_volume *v, const lr_slot *s)
{
    lr_ray r = {.t_max = s->t_max, .planes = NULL};
    for (int a = 0; a < 3; a++) {
        r.o[a] = s->o[a];
        r.d[a] = s->d[a];
        r.inv[a] = s->inv[a];
        r.s[a] = (s->inv[a] > 0.0) - (s->inv[a] < 0.0);
        r.never[a] = r.s[a] != 0 ? 0.0 : INFINITY;
        r.lo[a] = v->surface_lo[a];
        r.hi[a] = v->surface_hi[a];
    }
    return r;
}

/* Begin ray i, which is in its slot but for this and stands on its cursor. */
LR_INLINE void begin(lr_slot *s, double t_max, uint64_t i, int32_t side)
{
    s->t_max = t_max;
    s->scale = fmax(fabs(s->d[0]), fmax(fabs(s->d[1]), fabs(s->d[2])));
    s->i = i;
    s->side = side;
    s->visited = 0;
    s->stood = false;
}

LR_INLINE double t_min_of(const lr_packet *k, uint64_t i)
{
    return k->rays->t_min != NULL ? k->rays->t_min[i] : 0.0;
}

/* Set up ray i alone: one that leaves a surface, or may start in an object cell. */
static bool set_up_alone(lr_packet *k, uint64_t i, lr_slot *s)
{
    const lr_rays *rays = k->rays;
    const lr_volume *v = k->v;
    const double o[3] = {rays->ox[i], rays->oy[i], rays->oz[i]};
    const double d[3] = {rays->dx[i], rays->dy[i], rays->dz[i]};
    const lr_start *start = rays->start != NULL ? &rays->start[i] : NULL;
    const double t_min = t_min_of(k, i);
    const int32_t side = start != NULL ? start->side : 0;
    lr_ray r;
    if (!lr_ray_setup(&r, v, o, d, rays->t_max != NULL ? rays->t_max[i] : INFINITY) ||
        !(t_min <= r.t_max && t_min < INFINITY))
        return false;
    if (k->options->mode == LR_MODE_BINARY && lr_starts_inside(v, &r, LR_REGULAR, t_min, &s->u)) {
        lr_put_binary(v, k->hits, i, &r, &s->u);
        if (k->counters != NULL)
            k->counters->hits++;
        return false;
    }
    if (!(side != 0 ? lr_leave(v, &r, &s->u, start, t_min, lr_way_of(rays, i))
                    : lr_enter(&r, LR_REGULAR, &s->u, v->surface_lo, v->surface_hi, t_min)))
        return false;
    memcpy(s->o, r.o, sizeof s->o);
    memcpy(s->d, r.d, sizeof s->d);
    memcpy(s->inv, r.inv, sizeof s->inv);
    begin(s, r.t_max, i, side);
    return true;
}

/* Keep the ray of a lane, which enters the volume. */
LR_INLINE void keep(lr_slot *s, const lr_enter_lanes *r, const lr_cursor_lanes *u, int l,
                    uint64_t i)
{
    for (int a = 0; a < 3; a++) {
        s->o[a] = r->o[a][l];
        s->d[a] = r->d[a][l];
        s->inv[a] = r->inv[a][l];
        s->u.c[a] = (int32_t)u->c[a][l];
    }
    s->u.axis = (int32_t)u->axis[l];
    s->u.t = u->t[l];
    begin(s, r->t_max[l], i, 0);
}

/* n numbers from i on; `missing` where there is no array, and beyond them. */
LR_INLINE lr_doubles load_some(const double *from, uint64_t i, int n, double missing)
{
    lr_doubles x = lr_all_doubles(missing);
    if (from != NULL)
        memcpy(&x, from + i, (size_t)n * sizeof(double));
    return x;
}

/* Which of n rays from the first on must be set up alone. */
LR_INLINE uint32_t find_alone(const lr_packet *k, const lr_enter_lanes *r, lr_doubles t_min,
                              uint64_t first, int n)
{
    uint32_t alone = 0;
    for (int l = 0; l < n && k->rays->start != NULL; l++)
        alone |= (uint32_t)(k->rays->start[first + (uint64_t)l].side != 0) << l;
    if (k->options->mode != LR_MODE_BINARY)
        return alone;
    lr_longs inside = r->is;
    for (int a = 0; a < 3; a++) { /* the lattice, and what rounding may add to it */
        const lr_doubles q = r->o[a] + t_min * r->d[a];
        inside &= (q > 0.0) & (q < (double)(LR_SIDE * k->v->table_size[a]));
    }
    return alone | (lr_bits_of_longs(inside) & ((1u << n) - 1));
}

/* Set up the next rays side by side, at most eight; those that go on are ready. */
static void set_up(lr_packet *k)
{
    const lr_rays *rays = k->rays;
    const uint64_t first = k->next, left = k->end - first;
    const int n = (int)(left < LR_DOUBLE_LANES ? left : LR_DOUBLE_LANES);
    const double *from[6] = {rays->ox, rays->oy, rays->oz, rays->dx, rays->dy, rays->dz};
    lr_doubles of[6];
    for (int x = 0; x < 6; x++)
        of[x] = load_some(from[x], first, n, 0.0);
    const lr_doubles t_min = load_some(rays->t_min, first, n, 0.0);
    lr_enter_lanes r;
    lr_cursor_lanes u;
    lr_set_up_lanes(&r, k->v, of, of + 3, load_some(rays->t_max, first, n, INFINITY));
    const lr_longs enters = lr_enter_box_lanes(&r, k->v->surface_lo, k->v->surface_hi, t_min, &u);
    const uint32_t alone = find_alone(k, &r, t_min, first, n);
    k->next += (uint64_t)n;
    for (uint32_t m = (lr_bits_of_longs(enters) & ((1u << n) - 1)) | alone; m != 0; m &= m - 1) {
        const int l = __builtin_ctz(m);
        const uint8_t slot = k->free[k->n_free - 1];
        if (!(alone >> l & 1))
            keep(&k->slot[slot], &r, &u, l, first + (uint64_t)l);
        else if (!set_up_alone(k, first + (uint64_t)l, &k->slot[slot]))
            continue;
        k->n_free--;
        k->ready[k->n_ready++] = slot;
    }
}

/* Where a ray stands on the mirrored axis a at t, as lanes have it. */
LR_INLINE float place_of(const lr_slot *s, int a, double t, int32_t c)
{
    if (s->inv[a] == 0.0) /* stays in its cell whatever rounding says */
        return fminf(fmaxf((float)s->o[a], (float)c), ((float)c + 1.0f) * (1.0f - 0x1p-23f));
    const float p = (float)(s->o[a] + t * s->d[a]);
    return s->inv[a] < 0.0 ? -p : p;
}

/* Put a ray, which stands on its cursor, into a lane. */
LR_INLINE void put(lr_packet *k, lr_group *g, int l, uint8_t slot)
{
    lr_slot *s = &k->slot[slot];
    const lr_cursor *u = &s->u;
    const double largest = fmax(fabs(s->o[0]), fmax(fabs(s->o[1]), fabs(s->o[2])));
    const double inverse = 1.0 / s->scale;
    s->t = s->begin = u->t;
    g->slot[l] = slot;
    for (int a = 0; a < 3; a++) {
        const int32_t down = -(s->inv[a] < 0.0);
        const bool still = s->inv[a] == 0.0;
        g->down[a][l] = down;
        g->c[a][l] = u->c[a] ^ down;
        g->last[a][l] = down ? ~k->v->surface_lo[a] : k->v->surface_hi[a];
        g->o[a][l] = place_of(s, a, u->t, u->c[a]);
        g->at[a][l] = a == u->axis ? (float)g->c[a][l] : g->o[a][l];
        g->d[a][l] = still ? 0.0f : (float)(fabs(s->d[a]) * inverse);
        g->inv[a][l] = still ? INFINITY : (float)(fabs(s->inv[a]) * s->scale);
    }
    g->t[l] = 0.0f;
    g->t_max[l] = (float)((s->t_max - s->begin) * s->scale);
    const float unit = (float)(ROUNDED * k->largest + ROUNDED_DOUBLE * largest);
    bool inside = true; /* its cell, but for rounding: a caller's cell may be any */
    for (int a = 0; a < 3; a++) {
        const float in = g->o[a][l] - (float)g->c[a][l];
        inside = inside && in > -unit && in < 1.0f + unit;
    }
    g->unit[l] = inside ? unit : INFINITY; /* nothing is certain then */
    g->error[l] = 2.0f * g->unit[l];
    g->axis[l] = u->axis;
    g->side[l] = s->side;
    g->visited[l] = s->visited;
    g->alive |= 1u << l;
    g->held &= ~(1u << l);
    g->stood = (g->stood & ~(1u << l)) | (uint32_t)s->stood << l;
}

/* Give the free lanes the next rays: those that failed a hit test, and new ones. */
LR_INLINE void refill(lr_packet *k, lr_group *g)
{
    for (uint32_t left = LR_ALL_LANES & ~g->alive; left != 0; left &= left - 1) {
        while (k->n_ready == 0 && k->next < k->end)
            set_up(k);
        if (k->n_ready == 0)
            return;
        put(k, g, __builtin_ctz(left), k->ready[--k->n_ready]);
    }
}

/* A ray has ended. */
LR_INLINE void end(lr_packet *k, uint8_t slot, int32_t visited)
{
    k->free[k->n_free++] = slot;
    if (k->counters == NULL)
        return;
    if (k->hits->steps != NULL)
        k->hits->steps[k->slot[slot].i] = visited;
    if (k->counters->most_cells < (uint64_t)visited)
        k->counters->most_cells = (uint64_t)visited;
}

LR_INLINE void end_lanes(lr_packet *k, lr_group *g, uint32_t ended)
{
    g->alive &= ~ended;
    if (k->counters == NULL && ended != 0) { /* without a branch for each lane */
        for (int l = 0; l < LR_LANES; l++) {
            k->free[k->n_free] = g->slot[l];
            k->n_free += (int)(ended >> l & 1);
        }
        return;
    }
    for (uint32_t left = ended; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        end(k, g->slot[l], g->visited[l]);
    }
}
