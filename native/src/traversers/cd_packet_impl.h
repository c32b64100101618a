/* Chessboard distance for packets of rays, written once for all instruction sets: whoever includes
 * this defines LR_VECTORS, LR_CD_PACKET, the name of what it makes, and, for x86, has set the
 * instruction set.
 *
 * Each lane of a vector is a ray that leaves its cell's empty cube; a lane whose ray has ended
 * takes the next one. Lanes are floats and carry a bound of their errors. They do what is certain:
 * they leave boxes where no other crossing is near, and surface cells that the ray certainly does
 * not meet the surface in. Whatever is not certain is done in doubles by the functions of all
 * traversers, so that the hits are theirs to the last bit.
 *
 * Coordinates are mirrored along axes on which a ray goes down, x to -x and cell c to ~c, so that
 * all lanes go up.
 *
 * Source: Aila and Laine 2009 (persistent threads) for lanes that are refilled.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "distance/narrow_band.h"
#include "trace/triangle_cell.h"
#include "traversers/cd_packet.h"
#include "traversers/cd_packet_rays_impl.h"

/* Half a step of the corners, with what is rounded after it; and by how much f changes at most per
 * cell, on three axes. */
static const float CLEAR = 0.56f, STEEPEST = 3.0f * 254.0f;

/* ---- the boxes --------------------------------------------------------------- */

/* What lies ahead of the lanes. */
typedef struct lr_ahead {
    lr_ints end[3];        /* the last cells of the boxes that they leave */
    uint32_t surface, one; /* surface cells; boxes of one cell */
    lr_ints brick, number; /* of surface cells: near brick, number among those of its pair */
    lr_floats t, p[3];     /* where they leave them */
    lr_floats error;
    lr_ints crossed[3], to[3]; /* the axis, and the cell beyond */
} lr_ahead;

LR_INLINE void find_boxes(const lr_packet *k, const lr_group *g, lr_ahead *h)
{
    const lr_volume *v = k->v;
    lr_ints c[3];
    for (int a = 0; a < 3; a++)
        c[a] = lr_load_ints(g->c[a]) ^ lr_load_ints(g->down[a]);
    const lr_ints place =
        (c[0] >> LR_SIDE_BITS) +
        v->table_size[0] * ((c[1] >> LR_SIDE_BITS) + v->table_size[1] * (c[2] >> LR_SIDE_BITS));
    const lr_ints of = lr_gather(k->f->bricks, place * 4, g->alive);
    const lr_ints far = of < 0;
    const uint32_t near = g->alive & ~lr_bits_of(far);
    const lr_ints in = (c[0] & (LR_SIDE - 1)) + ((c[1] & (LR_SIDE - 1)) << LR_SIDE_BITS) +
                       ((c[2] & (LR_SIDE - 1)) << 2 * LR_SIDE_BITS);
    h->brick = of & ~far;
    const lr_ints stored = lr_gather(k->f->near, h->brick * LR_CELLS + in, near) & 0xff;
    const lr_ints surface = ~far & (stored >= LR_CD_SURFACE);
    const lr_ints distance = lr_pick_ints(far, of & 0xff, stored);
    lr_ints radius = lr_greatest_ints(distance - 1, lr_all_ints(0)) & ~surface;
    radius = lr_pick_ints(far, radius << LR_SIDE_BITS, radius);
    h->surface = lr_bits_of(surface) & g->alive;
    h->one = lr_bits_of((radius == 0) & ~far) & g->alive;
    h->number = stored & (LR_CD_SURFACE - 1);
    for (int a = 0; a < 3; a++) {
        const lr_ints high = lr_load_ints(g->c[a]) | (far & (LR_SIDE - 1));
        h->end[a] = lr_least_ints(high + radius, lr_load_ints(g->last[a]));
    }
}

/* Where the lanes leave their boxes; which of them cannot tell for rounding. */
LR_INLINE uint32_t find_exits(const lr_group *g, lr_ahead *h)
{
    lr_floats t[3], inv[3], plane[3];
    for (int a = 0; a < 3; a++) {
        inv[a] = lr_load_floats(g->inv[a]);
        plane[a] = lr_floats_of(h->end[a] + 1);
        t[a] = (plane[a] - lr_load_floats(g->o[a])) * inv[a];
    }
    const lr_ints y = t[1] < t[0];
    const lr_floats first = lr_pick(y, t[1], t[0]);
    const lr_ints z = t[2] < first;
    h->t = lr_pick(z, t[2], first);
    h->crossed[0] = ~y & ~z;
    h->crossed[1] = y & ~z;
    h->crossed[2] = z;
    const lr_floats slowest = lr_pick(z, inv[2], lr_pick(y, inv[1], inv[0]));
    const lr_floats unit = lr_load_floats(g->unit);
    h->error = unit * slowest + unit;
    lr_ints doubt = ~(h->error < 0.25f) | (h->t < lr_load_floats(g->t)) |
                    (lr_absolute(h->t - lr_load_floats(g->t_max)) <= h->error);
    for (int a = 0; a < 3; a++) {
        const lr_floats d = lr_load_floats(g->d[a]);
        h->p[a] = lr_load_floats(g->o[a]) + h->t * d;
        const lr_floats cell = lr_rounded_down(h->p[a]), over = h->p[a] - cell;
        doubt |= ~(lr_least(over, 1.0f - over) > h->error) & ~h->crossed[a] & (d > 0.0f);
        h->p[a] = lr_pick(h->crossed[a], plane[a], h->p[a]);
        h->to[a] = lr_pick_ints(h->crossed[a], h->end[a] + 1, lr_ints_of(cell));
    }
    return lr_bits_of(doubt) & g->alive;
}

/* Leave the boxes; ends rays. */
LR_INLINE void leave_boxes(lr_packet *k, lr_group *g, const lr_ahead *h, uint32_t which)
{
    const lr_ints m = lr_lanes_of(which);
    lr_ints on = h->t <= lr_load_floats(g->t_max), axis = lr_all_ints(0);
    for (int a = 0; a < 3; a++) {
        on &= h->to[a] <= lr_load_ints(g->last[a]);
        axis |= h->crossed[a] & a;
        lr_store_ints(g->c[a], lr_pick_ints(m, h->to[a], lr_load_ints(g->c[a])));
        lr_store_floats(g->at[a], lr_pick(m, h->p[a], lr_load_floats(g->at[a])));
    }
    lr_store_floats(g->t, lr_pick(m, h->t, lr_load_floats(g->t)));
    lr_store_floats(g->error, lr_pick(m, h->error, lr_load_floats(g->error)));
    lr_store_ints(g->axis, lr_pick_ints(m, axis, lr_load_ints(g->axis)));
    g->stood &= ~which;
    end_lanes(k, g, which & ~lr_bits_of(on));
}

/* ---- in doubles ------------------------------------------------------------ */

/* Where the ray of a lane stands. */
LR_INLINE lr_cursor cursor_of(const lr_packet *k, const lr_group *g, int l)
{
    const lr_slot *s = &k->slot[g->slot[l]];
    lr_cursor u = {.axis = g->axis[l], .t = s->t};
    for (int a = 0; a < 3; a++)
        u.c[a] = g->c[a][l] ^ g->down[a][l];
    if (u.axis >= 0) {
        const int a = u.axis;
        const double t = (u.c[a] + (s->inv[a] < 0.0) - s->o[a]) * s->inv[a]; /* as lr_plane_t */
        u.t = t > u.t ? t : u.t;
    }
    return u;
}

/* Leave a lane's box in doubles. */
static void leave_surely(lr_packet *k, lr_group *g, const lr_ahead *h, int l)
{
    lr_slot *s = &k->slot[g->slot[l]];
    const lr_ray r = ray_of(k->v, s);
    lr_cursor u = cursor_of(k, g, l);
    int32_t lo[3], hi[3];
    for (int a = 0; a < 3; a++) {
        const int32_t far = h->end[a][l] ^ g->down[a][l];
        lo[a] = r.s[a] < 0 ? far : u.c[a];
        hi[a] = r.s[a] > 0 ? far : u.c[a];
    }
    const bool one = h->one >> l & 1;
    if (!(one ? lr_step(&r, LR_REGULAR, &u) : lr_exit(&r, LR_REGULAR, &u, lo, hi))) {
        end_lanes(k, g, 1u << l);
        return;
    }
    g->stood &= ~(1u << l);
    s->t = u.t;
    for (int a = 0; a < 3; a++) {
        g->c[a][l] = u.c[a] ^ g->down[a][l];
        g->at[a][l] = a == u.axis ? (float)g->c[a][l] : place_of(s, a, u.t, u.c[a]);
    }
    g->axis[l] = u.axis;
    g->t[l] = (float)((u.t - s->begin) * s->scale);
    g->error[l] = 2.0f * g->unit[l];
}

/* The hit test of a lane's ray; ends it where it hits. */
static void test_alone(lr_packet *k, lr_group *g, int l)
{
    lr_slot *s = &k->slot[g->slot[l]];
    const lr_ray r = ray_of(k->v, s);
    const lr_cursor u = cursor_of(k, g, l);
    const uint64_t i = s->i;
    const double d[3] = {k->rays->dx[i], k->rays->dy[i], k->rays->dz[i]};
    const lr_start *start = k->rays->start != NULL ? &k->rays->start[i] : NULL;
    const lr_leaving leaving = lr_leaving_of(start, t_min_of(k, i));
    uint64_t n_samples = 0;
    lr_found found;
    bool hit = true;
    if (k->options->mode == LR_MODE_BINARY)
        lr_put_binary(k->v, k->hits, i, &r, &u);
    else {
        int side = s->side;
        hit = lr_hit(k->v, &r, LR_REGULAR, &u, &leaving, &side, k->options, &found, &n_samples);
        g->side[l] = s->side = side;
        if (hit)
            lr_put_surface(k->v, k->hits, i, &found, d, k->options->normal);
    }
    if (k->counters != NULL) {
        k->counters->samples += n_samples;
        k->counters->hits += hit;
    }
    if (hit)
        end_lanes(k, g, 1u << l);
}

/* The hit tests of rays that wait for them, as many as go side by side. */
static void test_waiting(lr_packet *k)
{
    const int n = k->n_waiting < LR_DOUBLE_LANES ? k->n_waiting : LR_DOUBLE_LANES;
    const uint8_t *which = k->waiting + k->n_waiting - n;
    uint64_t n_samples = 0, i[LR_DOUBLE_LANES];
    k->n_waiting -= n;
    for (int l = 0; l < n; l++) {
        const lr_slot *s = &k->slot[which[l]];
        lr_hit_lane_put(&k->lanes, l, k->v, s->o, s->d, s->inv, s->t_max, &s->u, s->side);
        i[l] = s->i;
    }
    const uint32_t hit = lr_find_hits(&k->lanes, k->v, (1u << n) - 1, k->options, &n_samples);
    if (hit != 0)
        lr_put_hits(&k->lanes, k->v, hit, k->options, k->rays, i, k->hits);
    for (int l = 0; l < n; l++) {
        lr_slot *s = &k->slot[which[l]];
        s->side = 0;
        s->stood = true;
        if (hit >> l & 1)
            end(k, which[l], s->visited);
        else
            k->ready[k->n_ready++] = which[l];
    }
    if (k->counters != NULL) {
        k->counters->samples += n_samples;
        k->counters->hits += (uint64_t)__builtin_popcount(hit);
    }
}

/* A lane's ray waits for its hit test, in no lane; or takes it here where it is no plain one. */
LR_INLINE void test(lr_packet *k, lr_group *g, int l)
{
    lr_slot *s = &k->slot[g->slot[l]];
    const lr_volume *v = k->v;
    s->u = cursor_of(k, g, l);
    if (!k->side_by_side ||
        (v->triangle_cells != NULL && (g->side[l] != 0 || lr_is_triangle_cell(v, s->u.c)))) {
        test_alone(k, g, l);
        return;
    }
    s->visited = g->visited[l];
    k->waiting[k->n_waiting++] = g->slot[l];
    g->alive &= ~(1u << l);
}

/* ---- surface cells ---------------------------------------------------------- */

/* a + b x */
LR_INLINE lr_floats line(lr_floats a, lr_floats b, lr_floats x)
{
    return a + b * x;
}

/* f - T at the corners of the cells of lanes. */
LR_INLINE void fetch_corners(const lr_packet *k, const lr_group *g, const lr_ahead *h,
                             uint32_t lanes, lr_floats s[8])
{
    const lr_ints pair = ((lr_load_ints(g->c[2]) ^ lr_load_ints(g->down[2])) & (LR_SIDE - 1)) >> 1;
    const lr_ints first = lr_gather(k->f->first, (h->brick * LR_CD_PAIRS + pair) * 4, lanes);
    const lr_ints at = (first + h->number) * 8;
    for (int n = 0; n < 2; n++) {
        const lr_ints four = lr_gather(k->f->corners, at + 4 * n, lanes);
        s[4 * n] = lr_floats_of(four << 24 >> 24);
        s[4 * n + 1] = lr_floats_of(four << 16 >> 24);
        s[4 * n + 2] = lr_floats_of(four << 8 >> 24);
        s[4 * n + 3] = lr_floats_of(four >> 24);
    }
}

/* From a mirrored place to one in the cell. */
LR_INLINE lr_floats in_cell(const lr_group *g, int a, lr_floats place)
{
    const lr_floats in = place - lr_floats_of(lr_load_ints(g->c[a]));
    const lr_floats cut = lr_least(lr_greatest(in, lr_all_floats(0.0f)), lr_all_floats(1.0f));
    return lr_pick(lr_load_ints(g->down[a]), 1.0f - cut, cut);
}

/* Lanes whose ray certainly misses in its cell: where the Bernstein coefficients of the cubic along
 * it are on one side of 0. */
LR_INLINE uint32_t find_misses(const lr_packet *k, const lr_group *g, const lr_ahead *h,
                               uint32_t lanes)
{
    lr_floats s[8], p[3], q[3];
    fetch_corners(k, g, h, lanes, s);
    for (int a = 0; a < 3; a++) {
        p[a] = in_cell(g, a, lr_load_floats(g->at[a]));
        q[a] = in_cell(g, a, h->p[a]) - p[a];
    }
    /* f = s0 + g.p + xy + xz + yz + xyz */
    const lr_floats kx = s[1] - s[0], ky = s[2] - s[0], kz = s[4] - s[0];
    const lr_floats xy = s[3] - s[2] - kx, xz = s[5] - s[4] - kx, yz = s[6] - s[4] - ky;
    const lr_floats xyz = s[7] - s[6] - (s[5] - s[4]) - xy;
    const lr_floats u = line(xy, xyz, p[2]), w = line(xz, xyz, p[1]), r = line(yz, xyz, p[0]);
    const lr_floats gx = line(line(kx, xy, p[1]), w, p[2]), gy = line(line(ky, xy, p[0]), r, p[2]),
                    gz = line(line(kz, xz, p[0]), r, p[1]);
    const lr_floats start = line(line(line(s[0], kz, p[2]), line(ky, yz, p[2]), p[1]), gx, p[0]);
    const lr_floats c1 = gx * q[0] + gy * q[1] + gz * q[2];
    const lr_floats both = q[0] * q[1];
    const lr_floats c2 = u * both + (w * q[0] + r * q[1]) * q[2];
    const lr_floats c3 = xyz * both * q[2];
    const lr_floats third = lr_all_floats(1.0f / 3.0f);
    const lr_floats b1 = line(start, c1, third), b2 = line(b1, c1 + c2, third);
    const lr_floats b3 = start + c1 + (c2 + c3);
    const lr_floats low = lr_least(lr_least(start, b1), lr_least(b2, b3));
    const lr_floats high = lr_greatest(lr_greatest(start, b1), lr_greatest(b2, b3));
    const lr_floats clear = CLEAR + STEEPEST * lr_greatest(h->error, lr_load_floats(g->error));
    const lr_ints misses = ((low > clear) | (high < -clear)) & (lr_load_ints(g->side) == 0);
    return lr_bits_of(misses) & lanes;
}

/* ---- the walk --------------------------------------------------------------- */

LR_INLINE void count(const lr_packet *k, lr_group *g, const lr_ahead *h)
{
    lr_counters *c = k->counters;
    const uint32_t come = g->alive & ~(g->stood | g->held);
    c->cells += (uint64_t)__builtin_popcount(come);
    c->jumps += (uint64_t)__builtin_popcount(come & ~h->one);
    if (k->options->mode == LR_MODE_SURFACE)
        c->tests += (uint64_t)__builtin_popcount(h->surface & come);
    lr_store_ints(g->visited, lr_load_ints(g->visited) + lr_lanes_of(come) * -1);
}

/* The hit tests of a group, once enough of its lanes stand on surface cells. */
LR_INLINE void test_held(lr_packet *k, lr_group *g, const lr_ahead *h)
{
    g->held = h->surface & ~g->stood;
    const int n_held = __builtin_popcount(g->held), n_alive = __builtin_popcount(g->alive);
    if (n_held < HELD && n_alive - n_held > n_held)
        return;
    uint32_t to_test = g->held;
    g->held = 0;
    if (to_test != 0 && k->options->mode != LR_MODE_BINARY)
        to_test &= ~find_misses(k, g, h, to_test);
    for (; to_test != 0; to_test &= to_test - 1)
        test(k, g, __builtin_ctz(to_test));
}

/* One box further for all lanes of all groups, side by side, so that what one waits for hides
 * behind the others. */
LR_INLINE void step(lr_packet *k)
{
    lr_ahead h[GROUPS];
    uint32_t doubt[GROUPS];
    for (int n = 0; n < GROUPS; n++)
        find_boxes(k, &k->group[n], &h[n]);
    for (int n = 0; n < GROUPS; n++)
        doubt[n] = find_exits(&k->group[n], &h[n]);
    for (int n = 0; n < GROUPS; n++) {
        if (k->counters != NULL)
            count(k, &k->group[n], &h[n]);
        test_held(k, &k->group[n], &h[n]);
    }
    for (int n = 0; n < GROUPS; n++) {
        lr_group *g = &k->group[n];
        const uint32_t go = g->alive & ~g->held;
        leave_boxes(k, g, &h[n], go & ~doubt[n]);
        for (uint32_t left = go & doubt[n]; left != 0; left &= left - 1)
            leave_surely(k, g, &h[n], __builtin_ctz(left));
    }
}

static void trace(const lr_volume *v, const lr_cd_distances *f, const lr_rays *rays, uint64_t first,
                  uint64_t last, const lr_trace_options *options, const lr_hits *hits,
                  lr_counters *counters)
{
    lr_packet k;
    k.v = v;
    k.f = f;
    k.rays = rays;
    k.options = options;
    k.hits = hits;
    k.counters = counters;
    k.next = first;
    k.end = last;
    k.largest =
        (float)(LR_SIDE * lr_max_i(v->table_size[0], lr_max_i(v->table_size[1], v->table_size[2])));
    k.side_by_side =
        options->mode == LR_MODE_SURFACE && options->root == LR_ROOT_NEWTON && v->objects == NULL;
    k.n_waiting = k.n_ready = 0;
    for (k.n_free = 0; k.n_free < SLOTS; k.n_free++)
        k.free[k.n_free] = (uint8_t)k.n_free;
    lr_put_misses(hits, first, last);
    if (hits->steps != NULL)
        memset(hits->steps + first, 0, (last - first) * sizeof *hits->steps);
    memset(k.group, 0, sizeof k.group);
    memset(&k.lanes, 0, sizeof k.lanes);
    for (bool on = true; on;) {
        uint32_t alive = 0;
        for (int n = 0; n < GROUPS; n++) {
            lr_group *g = &k.group[n];
            if ((k.next < k.end || k.n_ready > 0) &&
                __builtin_popcount(g->alive) <= LR_LANES - FREE)
                refill(&k, g);
            alive |= g->alive;
        }
        if (alive != 0)
            step(&k);
        while (k.n_waiting >= LR_DOUBLE_LANES || (alive == 0 && k.n_waiting > 0))
            test_waiting(&k);
        on = alive != 0 || k.n_ready > 0;
    }
    if (counters != NULL)
        counters->rays += last - first;
}

const lr_cd_packet LR_CD_PACKET = {trace};
