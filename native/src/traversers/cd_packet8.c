/* Chessboard distance for packets of eight rays.
 *
 * Each lane of a vector is a ray that leaves its cell's empty cube; a lane whose ray has
 * ended takes the next one. A surface cell is left like an empty one where the ray certainly
 * misses in it: where the cubic's Bernstein coefficients are on one side of 0 by more than
 * rounding. Other cells, and triangle cells, take the hit test of all traversers, ray by
 * ray. Steps are those of lr_step and lr_exit to the last bit, hence hits are too.
 *
 * Source: Aila and Laine 2009 (persistent threads) for lanes that are refilled.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "traversers/cd_packet8.h"

#include <immintrin.h>

#include "distance/narrow_band.h"
#include "grid/gather.h"
#include "trace/hit_record.h"
#include "trace/triangle_cell.h"

LR_TARGET_AVX512

enum {
    LANES = 8,
    ALL = 0xff,
    QUEUED = 64, /* rays that are set up at a time */
    FREE = 2     /* lanes that must be free to be refilled */
};

/* The margin of the coefficients from T, as a fraction of the samples: a sum of a dozen rounded
 * products of samples has an error of 2^-48 at most; and the largest value by which a start on
 * the surface may lie on its wrong side. */
static const double CLEAR = 0x1p-30, ASIDE = 0x1p-40;

/* Rays that are set up, queued for a lane. */
typedef struct lr_queued {
    double o[3][QUEUED], d[3][QUEUED], inv[3][QUEUED], t[QUEUED], t_max[QUEUED];
    int32_t c[3][QUEUED], axis[QUEUED], side[QUEUED], ray[QUEUED];
    uint32_t next, n;
} lr_queued;

/* The rays of the lanes, as lr_ray and lr_cursor have them. */
typedef struct lr_packet8 {
    __m512d o[3], d[3], inv[3], t, t_max;
    __m256i c[3], axis, side, ray;
    __m256i cells; /* visited so far */
    __mmask8 up[3], still[3];
    __mmask8 alive, held; /* lanes with a ray; lanes that have had one */
} lr_packet8;

typedef struct lr_packet {
    const lr_volume *v;
    const lr_cd_distances *f;
    const lr_rays *rays;
    const lr_trace_options *options;
    const lr_hits *hits;
    lr_counters *counters;
    uint64_t first, next, end;
    lr_queued queue;
} lr_packet;

/* ---- rays come ------------------------------------------------------------- */

static bool set_up(const lr_packet *k, uint64_t i, lr_ray *r)
{
    const lr_rays *rays = k->rays;
    const double o[3] = {rays->ox[i], rays->oy[i], rays->oz[i]};
    const double d[3] = {rays->dx[i], rays->dy[i], rays->dz[i]};
    return lr_ray_setup(r, k->v, o, d, rays->t_max != NULL ? rays->t_max[i] : INFINITY);
}

/* Set up the next rays, as many as the queue holds. */
static void prepare(lr_packet *k)
{
    const lr_volume *v = k->v;
    lr_queued *w = &k->queue;
    uint32_t n = 0;
    for (; k->next < k->end && n < QUEUED; k->next++) {
        const uint64_t i = k->next;
        const double t_min = k->rays->t_min != NULL ? k->rays->t_min[i] : 0.0;
        const lr_start *start = k->rays->start != NULL ? &k->rays->start[i] : NULL;
        const int32_t side = start != NULL ? start->side : 0;
        lr_ray r;
        lr_cursor u;
        lr_put_miss(k->hits, i);
        if (k->hits->steps != NULL)
            k->hits->steps[i] = 0;
        if (!set_up(k, i, &r) || !(t_min <= r.t_max && t_min < INFINITY) ||
            !(side != 0 ? lr_leave(v, &r, &u, start, t_min)
                        : lr_enter(&r, LR_REGULAR, &u, v->surface_lo, v->surface_hi, t_min)))
            continue;
        for (int a = 0; a < 3; a++) {
            w->o[a][n] = r.o[a];
            w->d[a][n] = r.d[a];
            w->inv[a][n] = r.inv[a];
            w->c[a][n] = u.c[a];
        }
        w->t[n] = u.t;
        w->t_max[n] = r.t_max;
        w->axis[n] = u.axis;
        w->side[n] = side;
        w->ray[n++] = (int32_t)(i - k->first);
    }
    w->next = 0;
    w->n = n;
}

/* Store the results of rays that have ended. */
LR_INLINE void settle(const lr_packet *k, lr_packet8 *e)
{
    const __mmask8 ended = e->held & (__mmask8)~e->alive;
    int32_t cells[LANES], ray[LANES];
    if (k->counters == NULL || ended == 0)
        return;
    _mm256_storeu_si256((__m256i *)(void *)cells, e->cells);
    _mm256_storeu_si256((__m256i *)(void *)ray, e->ray);
    for (uint32_t left = ended; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        if (k->hits->steps != NULL)
            k->hits->steps[k->first + (uint64_t)ray[l]] = cells[l];
        if (k->counters->most_cells < (uint64_t)cells[l])
            k->counters->most_cells = (uint64_t)cells[l];
    }
}

/* Give free lanes the queued rays; alive is 0 where none is left. */
LR_INLINE void refill(lr_packet *k, lr_packet8 *e)
{
    lr_queued *w = &k->queue;
    settle(k, e);
    e->held = e->alive;
    while (e->alive != ALL) {
        if (w->next == w->n) {
            if (k->next == k->end)
                return;
            prepare(k);
            continue;
        }
        uint32_t into = ALL & ~(uint32_t)e->alive;
        while ((uint32_t)__builtin_popcount(into) > w->n - w->next)
            into &= into - 1;
        const __mmask8 m = (__mmask8)into;
        const uint32_t at = w->next;
        for (int a = 0; a < 3; a++) {
            e->o[a] = _mm512_mask_expandloadu_pd(e->o[a], m, w->o[a] + at);
            e->d[a] = _mm512_mask_expandloadu_pd(e->d[a], m, w->d[a] + at);
            e->inv[a] = _mm512_mask_expandloadu_pd(e->inv[a], m, w->inv[a] + at);
            e->c[a] = _mm256_mask_expandloadu_epi32(e->c[a], m, w->c[a] + at);
            e->up[a] = _mm512_cmp_pd_mask(e->inv[a], _mm512_setzero_pd(), _CMP_GT_OQ);
            e->still[a] = _mm512_cmp_pd_mask(e->inv[a], _mm512_setzero_pd(), _CMP_EQ_OQ);
        }
        e->t = _mm512_mask_expandloadu_pd(e->t, m, w->t + at);
        e->t_max = _mm512_mask_expandloadu_pd(e->t_max, m, w->t_max + at);
        e->axis = _mm256_mask_expandloadu_epi32(e->axis, m, w->axis + at);
        e->side = _mm256_mask_expandloadu_epi32(e->side, m, w->side + at);
        e->ray = _mm256_mask_expandloadu_epi32(e->ray, m, w->ray + at);
        e->cells = _mm256_mask_mov_epi32(e->cells, m, _mm256_setzero_si256());
        w->next += (uint32_t)__builtin_popcount(into);
        e->alive |= m;
        e->held |= m;
    }
}

/* ---- surface cells ---------------------------------------------------------- */

LR_INLINE __m256i all_of(int32_t x)
{
    return _mm256_set1_epi32(x);
}

/* The scale of rounding errors: occupancy 1, or the largest of unbounded samples. */
LR_INLINE __m512d scale_of(const lr_volume *v, const __m512d s[8])
{
    __m512d scale = _mm512_set1_pd(v->one);
    if (!lr_sample_types[v->desc.sample_type].whole) {
        scale = _mm512_abs_pd(_mm512_set1_pd(v->threshold));
        for (int n = 0; n < 8; n++)
            scale = _mm512_max_pd(scale, _mm512_abs_pd(s[n]));
    }
    return scale;
}

/* The point at t in its cell, as lr_chord_points. */
LR_INLINE __m512d point_in(const lr_packet8 *e, int a, __m512d t, __mmask8 at_face, __mmask8 upper)
{
    const __m512d one = _mm512_set1_pd(1.0), zero = _mm512_setzero_pd();
    __m512d p =
        _mm512_mask_add_pd(e->o[a], (__mmask8)~e->still[a], e->o[a], _mm512_mul_pd(t, e->d[a]));
    p = _mm512_sub_pd(p, _mm512_cvtepi32_pd(e->c[a]));
    p = _mm512_min_pd(_mm512_max_pd(p, zero), one);
    p = _mm512_mask_mov_pd(p, at_face, zero);
    return _mm512_mask_mov_pd(p, at_face & upper, one);
}

/* a + b x */
LR_INLINE __m512d line(__m512d a, __m512d b, __m512d x)
{
    return _mm512_fmadd_pd(b, x, a);
}

/* Lanes of m whose ray certainly misses in its cell. */
LR_INLINE __mmask8 passes(const lr_volume *v, const lr_packet8 *e, __mmask8 m, __m512d t_out,
                          __m256i axis_out)
{
    __m512d s[8], p[3], q[3];
    __m256i entry = _mm256_setzero_si256();
    lr_lanes_corners(v, e->c, m, s, &entry);
    for (int a = 0; a < 3; a++) {
        const __mmask8 in = _mm256_cmpeq_epi32_mask(e->axis, all_of(a));
        const __mmask8 out = _mm256_cmpeq_epi32_mask(axis_out, all_of(a));
        p[a] = point_in(e, a, e->t, in, (__mmask8)~e->up[a]);
        q[a] = _mm512_sub_pd(point_in(e, a, t_out, out, e->up[a]), p[a]);
    }
    /* f = s0 + g.p + xy + xz + yz + xyz */
    const __m512d kx = _mm512_sub_pd(s[1], s[0]), ky = _mm512_sub_pd(s[2], s[0]),
                  kz = _mm512_sub_pd(s[4], s[0]);
    const __m512d xy = _mm512_sub_pd(_mm512_sub_pd(s[3], s[2]), kx),
                  xz = _mm512_sub_pd(_mm512_sub_pd(s[5], s[4]), kx),
                  yz = _mm512_sub_pd(_mm512_sub_pd(s[6], s[4]), ky);
    const __m512d xyz =
        _mm512_sub_pd(_mm512_sub_pd(_mm512_sub_pd(s[7], s[6]), _mm512_sub_pd(s[5], s[4])), xy);
    const __m512d u = line(xy, xyz, p[2]), w = line(xz, xyz, p[1]), r = line(yz, xyz, p[0]);
    const __m512d gx = line(line(kx, xy, p[1]), w, p[2]), gy = line(line(ky, xy, p[0]), r, p[2]),
                  gz = line(line(kz, xz, p[0]), r, p[1]);
    const __m512d level = _mm512_set1_pd(v->threshold);
    const __m512d start =
        line(line(line(_mm512_sub_pd(s[0], level), kz, p[2]), line(ky, yz, p[2]), p[1]), gx, p[0]);
    const __m512d c1 = line(line(_mm512_mul_pd(gx, q[0]), gy, q[1]), gz, q[2]);
    const __m512d both = _mm512_mul_pd(q[0], q[1]);
    const __m512d c2 = line(line(_mm512_mul_pd(u, both), w, _mm512_mul_pd(q[0], q[2])), r,
                            _mm512_mul_pd(q[1], q[2]));
    const __m512d c3 = _mm512_mul_pd(xyz, _mm512_mul_pd(both, q[2]));
    const __m512d third = _mm512_set1_pd(1.0 / 3.0), zero = _mm512_setzero_pd();
    const __m512d b1 = line(start, c1, third);
    const __m512d b2 = line(b1, _mm512_add_pd(c1, c2), third);
    const __m512d b3 = _mm512_add_pd(_mm512_add_pd(start, c1), _mm512_add_pd(c2, c3));
    const __mmask8 leaves = _mm256_test_epi32_mask(e->side, e->side);
    const __mmask8 handed_on = _mm256_test_epi32_mask(e->side, all_of(1)) ^ leaves;
    __mmask8 below = _mm512_cmp_pd_mask(start, zero, _CMP_LT_OQ) & (__mmask8)~leaves;
    below |= _mm256_movepi32_mask(e->side);
    const __m512d low = _mm512_min_pd(_mm512_min_pd(b1, b2), b3);
    const __m512d high = _mm512_max_pd(_mm512_max_pd(b1, b2), b3);
    const __m512d rest = _mm512_mask_sub_pd(low, below, zero, high);
    const __m512d begin = _mm512_mask_sub_pd(start, below, zero, start);
    const __m512d scale = scale_of(v, s), clear = _mm512_mul_pd(_mm512_set1_pd(CLEAR), scale);
    const __m512d least = _mm512_mask_mul_pd(clear, leaves, _mm512_set1_pd(-ASIDE), scale);
    __mmask8 through = _mm512_mask_cmp_pd_mask(m, rest, clear, _CMP_GT_OQ);
    through = _mm512_mask_cmp_pd_mask(through, begin, least, _CMP_GT_OQ) & (__mmask8)~handed_on;
    if (v->triangle_cells != NULL && through != 0)
        through &= (__mmask8)~lr_lanes_doubted(v, e->c, through, entry);
    return through;
}

/* The hit test of ray i, which stands on u. */
static bool test(lr_packet *k, const lr_ray *r, const lr_cursor *u, int *side, uint64_t i)
{
    lr_found found;
    uint64_t n_samples = 0;
    const lr_start *start = k->rays->start != NULL ? &k->rays->start[i] : NULL;
    const lr_leaving leaving =
        lr_leaving_of(start, k->rays->t_min != NULL ? k->rays->t_min[i] : 0.0);
    const bool hit = lr_hit(k->v, r, LR_REGULAR, u, &leaving, side, k->options, &found, &n_samples);
    if (k->counters != NULL) {
        k->counters->samples += n_samples;
        k->counters->hits += hit;
    }
    const double d[3] = {k->rays->dx[i], k->rays->dy[i], k->rays->dz[i]};
    if (hit)
        lr_put_surface(k->v, k->hits, i, &found, d, k->options->normal);
    return hit;
}

/* The lanes' rays in memory. */
typedef struct lr_spread {
    _Alignas(64) double o[3][LANES], d[3][LANES], inv[3][LANES], t[LANES], t_max[LANES];
    _Alignas(64) int32_t c[3][LANES], axis[LANES], side[LANES], ray[LANES];
} lr_spread;

static void spread(const lr_packet8 *e, lr_spread *s)
{
    for (int a = 0; a < 3; a++) {
        _mm512_store_pd(s->o[a], e->o[a]);
        _mm512_store_pd(s->d[a], e->d[a]);
        _mm512_store_pd(s->inv[a], e->inv[a]);
        _mm256_store_si256((__m256i *)(void *)s->c[a], e->c[a]);
    }
    _mm512_store_pd(s->t, e->t);
    _mm512_store_pd(s->t_max, e->t_max);
    _mm256_store_si256((__m256i *)(void *)s->axis, e->axis);
    _mm256_store_si256((__m256i *)(void *)s->side, e->side);
    _mm256_store_si256((__m256i *)(void *)s->ray, e->ray);
}

/* The hit tests of the lanes of m; ends the rays that hit. */
static void test_lanes(lr_packet *k, lr_packet8 *e, __mmask8 m)
{
    lr_spread s;
    lr_ray r;
    spread(e, &s);
    r.planes = NULL;
    for (int a = 0; a < 3; a++) {
        r.lo[a] = k->v->surface_lo[a];
        r.hi[a] = k->v->surface_hi[a];
    }
    for (uint32_t left = m; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        const lr_cursor u = {{s.c[0][l], s.c[1][l], s.c[2][l]}, s.axis[l], s.t[l]};
        for (int a = 0; a < 3; a++) {
            r.o[a] = s.o[a][l];
            r.d[a] = s.d[a][l];
            r.inv[a] = s.inv[a][l];
            r.s[a] = (r.inv[a] > 0.0) - (r.inv[a] < 0.0);
            r.never[a] = r.s[a] != 0 ? 0.0 : INFINITY;
        }
        r.t_max = s.t_max[l];
        int side = s.side[l];
        if (test(k, &r, &u, &side, k->first + (uint64_t)s.ray[l]))
            e->alive &= (__mmask8) ~(1u << l);
        e->side = _mm256_mask_set1_epi32(e->side, (__mmask8)(1u << l), side);
    }
}

/* ---- the walk --------------------------------------------------------------- */

/* The boxes that the lanes leave: their far planes, per axis. */
typedef struct lr_ahead {
    __m256i end[3];
    __mmask8 surface, one; /* surface cells; boxes of one cell */
} lr_ahead;

LR_INLINE void look_ahead(const lr_packet *k, const lr_packet8 *e, lr_ahead *h)
{
    const lr_volume *v = k->v;
    const __m256i of = _mm256_mmask_i32gather_epi32(_mm256_setzero_si256(), e->alive,
                                                    lr_lanes_table_of(v, e->c), k->f->bricks, 4);
    const __mmask8 far = _mm256_movepi32_mask(of), near = e->alive & (__mmask8)~far;
    const __m512i place = lr_lanes_cell_of(of, e->c);
    const __m256i distance =
        _mm256_and_si256(_mm512_mask_i64gather_epi32(of, near, place, k->f->near, 1), all_of(0xff));
    h->surface = _mm256_mask_testn_epi32_mask(near, distance, distance);
    h->one = _mm256_mask_cmple_epi32_mask(near, distance, all_of(1));
    const __m256i n =
        _mm256_max_epi32(_mm256_sub_epi32(distance, all_of(1)), _mm256_setzero_si256());
    const __m256i radius = _mm256_mask_slli_epi32(n, far, n, LR_SIDE_BITS);
    for (int a = 0; a < 3; a++) {
        const __m256i low = _mm256_mask_and_epi32(e->c[a], far, e->c[a], all_of(-LR_SIDE));
        const __m256i high = _mm256_mask_add_epi32(low, far, low, all_of(LR_SIDE - 1));
        const __m256i to =
            _mm256_max_epi32(_mm256_sub_epi32(low, radius), all_of(v->surface_lo[a]));
        h->end[a] = _mm256_mask_min_epi32(to, e->up[a], _mm256_add_epi32(high, radius),
                                          all_of(v->surface_hi[a]));
    }
}

/* The crossing by which each lane leaves its box, as lr_exit_t. */
LR_INLINE __m512d exit_of(const lr_packet8 *e, const lr_ahead *h, __m256i *axis)
{
    __m512d t[3];
    for (int a = 0; a < 3; a++) {
        const __m256i plane = _mm256_mask_add_epi32(h->end[a], e->up[a], h->end[a], all_of(1));
        t[a] = _mm512_mul_pd(_mm512_sub_pd(_mm512_cvtepi32_pd(plane), e->o[a]), e->inv[a]);
        t[a] = _mm512_mask_mov_pd(t[a], e->still[a], _mm512_set1_pd(INFINITY));
    }
    const __mmask8 y = _mm512_cmp_pd_mask(t[1], t[0], _CMP_LT_OQ);
    const __m512d first = _mm512_mask_mov_pd(t[0], y, t[1]);
    const __mmask8 z = _mm512_cmp_pd_mask(t[2], first, _CMP_LT_OQ);
    *axis = _mm256_mask_mov_epi32(_mm256_maskz_mov_epi32(y, all_of(1)), z, all_of(2));
    return _mm512_mask_mov_pd(first, z, t[2]);
}

/* Leave the boxes, as lr_exit and lr_step do. */
LR_INLINE void leave_boxes(const lr_volume *v, lr_packet8 *e, const lr_ahead *h, __m512d t,
                           __m256i axis)
{
    __mmask8 on = _mm512_mask_cmp_pd_mask(e->alive, t, e->t_max, _CMP_LE_OQ);
    for (int a = 0; a < 3; a++) {
        const __mmask8 crossed = _mm256_cmpeq_epi32_mask(axis, all_of(a));
        const __m512d p = _mm512_add_pd(e->o[a], _mm512_mul_pd(t, e->d[a]));
        __m512d cell = _mm512_roundscale_pd(p, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
        const __mmask8 on_plane = _mm512_mask_cmp_pd_mask((__mmask8)~e->up[a], cell, p, _CMP_EQ_OQ);
        cell = _mm512_mask_sub_pd(cell, on_plane, cell, _mm512_set1_pd(1.0));
        const __m256i low = _mm256_mask_mov_epi32(h->end[a], e->up[a], e->c[a]);
        const __m256i high = _mm256_mask_mov_epi32(e->c[a], e->up[a], h->end[a]);
        cell = _mm512_max_pd(cell, _mm512_cvtepi32_pd(low)); /* NaN gives low */
        cell = _mm512_min_pd(cell, _mm512_cvtepi32_pd(high));
        e->c[a] = _mm256_mask_mov_epi32(_mm512_cvttpd_epi32(cell), e->still[a], e->c[a]);
        const __m256i down = _mm256_sub_epi32(h->end[a], all_of(1));
        const __m256i beyond = _mm256_mask_add_epi32(down, e->up[a], h->end[a], all_of(1));
        e->c[a] = _mm256_mask_mov_epi32(e->c[a], crossed, beyond);
        on &= (__mmask8) ~(crossed & e->still[a] & h->one);
        on = _mm256_mask_cmpge_epi32_mask(on, e->c[a], all_of(v->surface_lo[a]));
        on = _mm256_mask_cmple_epi32_mask(on, e->c[a], all_of(v->surface_hi[a]));
    }
    e->axis = axis;
    e->t = t;
    e->alive = on;
}

LR_INLINE void count(lr_counters *c, lr_packet8 *e, const lr_ahead *h)
{
    const __mmask8 jumps = e->alive & (__mmask8) ~(h->one | h->surface);
    c->cells += (uint64_t)__builtin_popcount(e->alive);
    c->jumps += (uint64_t)__builtin_popcount(jumps);
    c->tests += (uint64_t)__builtin_popcount(h->surface);
    e->cells = _mm256_mask_add_epi32(e->cells, e->alive, e->cells, all_of(1));
}

void lr_cd_trace_packet8(const lr_volume *v, const lr_cd_distances *f, const lr_rays *rays,
                         uint64_t first, uint64_t end, const lr_trace_options *options,
                         const lr_hits *hits, lr_counters *counters)
{
    lr_packet k;
    lr_packet8 e;
    k.v = v;
    k.f = f;
    k.rays = rays;
    k.options = options;
    k.hits = hits;
    k.counters = counters;
    k.first = k.next = first;
    k.end = end;
    k.queue.next = k.queue.n = 0;
    memset(&e, 0, sizeof e);
    for (;;) {
        if (__builtin_popcount(e.alive) <= LANES - FREE)
            refill(&k, &e);
        if (e.alive == 0)
            break;
        lr_ahead h;
        __m256i axis;
        look_ahead(&k, &e, &h);
        const __m512d t = _mm512_max_pd(exit_of(&e, &h, &axis), e.t); /* NaN gives e.t */
        if (counters != NULL)
            count(counters, &e, &h);
        if (h.surface != 0) {
            const __mmask8 through = passes(v, &e, h.surface, t, axis);
            if (counters != NULL)
                counters->samples += 2 * (uint64_t)__builtin_popcount(through);
            e.side = _mm256_mask_mov_epi32(e.side, through, _mm256_setzero_si256());
            if (through != h.surface)
                test_lanes(&k, &e, h.surface & (__mmask8)~through);
        }
        leave_boxes(v, &e, &h, t, axis);
    }
    settle(&k, &e);
    if (counters != NULL)
        counters->rays += end - first;
}

LR_TARGET_END
