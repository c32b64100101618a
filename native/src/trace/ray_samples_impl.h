/* Rays side by side, written once for all instruction sets: whoever includes this defines
 * LR_VECTORS, LR_SAMPLE_RAYS, the function's name, and, for x86, has set the instruction set.
 *
 * Each lane goes its own way along its own ray, and takes the next ray where that has ended. Those
 * that stand on a visible sample wait until there are enough to fill vectors: their samples are
 * packed, one after another, and what comes of them goes back to the lanes.
 *
 * Source: Levoy 1988 (samples, classified after interpolation) and 1990 (leaping, and rays that end
 * where they are opaque).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/visible_lanes_impl.h"

#include "trace/enter_lanes_impl.h"
#include "trace/hit_record.h"
#include "trace/light_sum.h"

enum {
    LANES = 64,
    MOST_SAMPLES = LANES + LR_DOUBLE_LANES, /* packed ones, with room for a whole vector behind */
    LINES = 15                              /* numbers of an lr_transfer_piece that samples take */
};

#include "trace/ray_gradients_impl.h"

/* Of the steps to where a ray leaves a box: what rounding can do to their number, at most. */
static const double STEP_SLACK = 1e-6, STEP_ROUNDING = 0x1p-46;

/* Rays: each member has a number of eight bytes for each lane. */
typedef struct ray_lanes {
    _Alignas(64) double o[3][LANES];     /* in storage space, as d; */
    double d[3][LANES];                  /* 0 along an axis that is not moved along, */
    double inv[3][LANES];                /* and its reciprocal, or 0, with */
    double never[3][LANES];              /* infinity there, else 0 */
    double step[LANES], per_step[LANES]; /* in t, and its reciprocal */
    double length[LANES];                /* of a step, as extinction counts */
    double view[3][LANES];               /* in object space, unit: back along the ray */
    double k[LANES], end[LANES];         /* the next sample; the first one that is too far */
    double light[3][LANES], transmittance[LANES], begins[LANES]; /* so far */
    double taken[LANES];
    uint64_t since[LANES]; /* rounds before it */
    uint64_t ray[LANES];
} ray_lanes;

/* Where they stand. */
typedef struct place_lanes {
    _Alignas(64) double p[3][LANES];       /* the sample's place in its cell */
    int32_t c[3][LANES];                   /* that, */
    int32_t place[LANES], cell[LANES];     /* of its brick in the table, and in that */
    int32_t brick[LANES], distance[LANES]; /* see lr_fetch_distances */
    uint64_t busy, visible;                /* a bit each: have a ray; stand on a visible sample */
} place_lanes;

/* Samples of lanes, packed, and what comes of them. */
typedef struct sample_lanes {
    _Alignas(64) double p[3][MOST_SAMPLES], length[MOST_SAMPLES], view[3][MOST_SAMPLES];
    uint64_t rows[LR_CELL_ROWS][MOST_SAMPLES];
    int32_t c[3][MOST_SAMPLES];
    double opacity[MOST_SAMPLES], color[3][MOST_SAMPLES], emitted[3][MOST_SAMPLES];
} sample_lanes;

/* What all lanes share. */
typedef struct sample_job {
    const lr_volume *v;
    const lr_empty_cubes *cubes;
    const lr_rays *rays;
    const lr_trace_options *options;
    const lr_hits *hits;
    lr_counters *counters;
    const lr_watch *watch;
    uint64_t rounds;
    uint64_t next, end;                   /* rays that are not set up */
    ray_lanes ready;                      /* those that are, and meet something: */
    uint64_t left;                        /* a bit each */
    double opaque;                        /* transmittance at which rays end */
    double lamp[3];                       /* to the light, unit; of one at the viewer, 0 */
    double lines[LINES][LR_DOUBLE_LANES]; /* of the transfer function, if it has so few pieces */
    bool central, around; /* normals by central differences; samples around cells are needed */
} sample_job;

/* ---- rays ------------------------------------------------------------------------ */

LR_INLINE lr_doubles rounded_up(lr_doubles x)
{
    return -lr_rounded_down_doubles(-x);
}

/* The first n of eight numbers, or others where there are none; other lanes 0. */
LR_INLINE lr_doubles load_some(const double *from, uint64_t n, double others)
{
    double some[LR_DOUBLE_LANES] = {0};
    if (from == NULL)
        return lr_all_doubles(others);
    if (n >= LR_DOUBLE_LANES)
        return lr_load_doubles(from);
    memcpy(some, from, n * sizeof *some);
    return lr_load_doubles(some);
}

/* Set up the next n rays, eight at most, in lanes from l on; which of them meet something. */
static uint32_t set_up_eight(sample_job *job, uint64_t n, int l)
{
    const lr_rays *rays = job->rays;
    const lr_volume *v = job->v;
    const uint64_t i = job->next;
    const lr_doubles zero = {0},
                     o[3] = {load_some(rays->ox + i, n, 0.0), load_some(rays->oy + i, n, 0.0),
                             load_some(rays->oz + i, n, 0.0)};
    const lr_doubles d[3] = {load_some(rays->dx + i, n, 0.0), load_some(rays->dy + i, n, 0.0),
                             load_some(rays->dz + i, n, 0.0)};
    const lr_doubles t_min = load_some(rays->t_min != NULL ? rays->t_min + i : NULL, n, 0.0);
    const lr_doubles t_max = load_some(rays->t_max != NULL ? rays->t_max + i : NULL, n, INFINITY);
    const lr_doubles along = lr_root_doubles(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    ray_lanes *k = &job->ready;
    lr_enter_lanes r;
    lr_cursor_lanes u;
    lr_doubles out = lr_all_doubles(INFINITY);
    lr_set_up_lanes(&r, v, o, d, t_max);
    lr_longs meets = lr_enter_box_lanes(&r, v->surface_lo, v->surface_hi, t_min, &u);
    const lr_doubles step =
        job->options->step / lr_root_doubles(r.d[0] * r.d[0] + r.d[1] * r.d[1] + r.d[2] * r.d[2]);
    for (int a = 0; a < 3; a++) {
        const lr_longs moves = r.up[a] | r.down[a];
        const lr_doubles never = lr_pick_doubles(moves, zero, lr_all_doubles(INFINITY));
        const lr_doubles far = lr_pick_doubles(r.up[a], lr_all_doubles(v->surface_hi[a] + 1),
                                               lr_all_doubles(v->surface_lo[a]));
        out = lr_lesser_lanes((far - r.o[a]) * r.inv[a] + never, out);
        lr_store_doubles(k->o[a] + l, r.o[a]);
        lr_store_doubles(k->d[a] + l, lr_pick_doubles(moves, r.d[a], zero));
        lr_store_doubles(k->inv[a] + l, r.inv[a]);
        lr_store_doubles(k->never[a] + l, never);
        lr_store_doubles(k->view[a] + l, -d[a] / along);
        lr_store_doubles(k->light[a] + l, zero);
    }
    /* a sample more at both ends, which rounding may take from the box */
    const lr_doubles first =
        lr_greater_lanes(rounded_up(t_min / step), rounded_up(u.t / step) - 1.0);
    const lr_doubles end = lr_lesser_lanes(rounded_up(t_max / step), rounded_up(out / step) + 1.0);
    meets &=
        (first < end) & (end < end + 1.0); /* not so far away that steps are lost in rounding */
    lr_store_doubles(k->k + l, first);
    lr_store_doubles(k->end + l, end);
    lr_store_doubles(k->step + l, step);
    lr_store_doubles(k->per_step + l, 1.0 / step);
    lr_store_doubles(k->length + l,
                     step * (rays->length != NULL ? load_some(rays->length + i, n, 0.0) : along));
    lr_store_doubles(k->transmittance + l, lr_all_doubles(1.0));
    lr_store_doubles(k->begins + l, lr_all_doubles(INFINITY));
    lr_store_doubles(k->taken + l, zero);
    for (int n_th = 0; n_th < LR_DOUBLE_LANES; n_th++)
        k->ray[l + n_th] = i + (uint64_t)n_th;
    return v->surface_lo[0] > v->surface_hi[0] ? 0 : lr_bits_of_longs(meets);
}

/* Give lane l the next ray that meets something; false: there is none, and it stands beside the
 * volume, for ever. */
static bool next_ray(ray_lanes *k, int l, sample_job *job)
{
    while (job->left == 0 && job->next < job->end) {
        const uint64_t first = job->next;
        for (int m = 0; m < LANES && job->next < job->end; m += LR_DOUBLE_LANES) {
            const uint64_t n =
                job->end - job->next < LR_DOUBLE_LANES ? job->end - job->next : LR_DOUBLE_LANES;
            job->left |= (uint64_t)set_up_eight(job, n, m) << m;
            job->next += n;
        }
        lr_put_dark(job->hits, first, job->next);
    }
    if (job->left == 0) {
        for (int a = 0; a < 3; a++) {
            k->o[a][l] = -1.0;
            k->d[a][l] = k->inv[a][l] = k->never[a][l] = 0.0;
        }
        k->step[l] = k->per_step[l] = k->transmittance[l] = 1.0;
        k->k[l] = 0.0;
        k->end[l] = INFINITY;
        return false;
    }
    const size_t from = (size_t)__builtin_ctzll(job->left) * sizeof(double);
    for (size_t at = 0; at < sizeof *k; at += LANES * sizeof(double))
        memcpy((char *)k + at + (size_t)l * sizeof(double), (const char *)&job->ready + at + from,
               sizeof(double));
    k->since[l] = job->rounds;
    job->left &= job->left - 1;
    return true;
}

static void put_ray(const ray_lanes *k, int l, const sample_job *job)
{
    const double light[3] = {k->light[0][l], k->light[1][l], k->light[2][l]};
    lr_put_light(job->hits, k->ray[l], k->begins[l], light, k->transmittance[l],
                 job->rounds - k->since[l], job->counters);
    job->counters->tests += (uint64_t)k->taken[l];
    job->counters->samples += (uint64_t)k->taken[l];
}

/* Lanes whose ray has ended take others. */
LR_INLINE void refill(ray_lanes *k, place_lanes *at, sample_job *job)
{
    uint64_t ended = 0;
    for (int l = 0; l < LANES; l += LR_DOUBLE_LANES)
        ended |=
            (uint64_t)(lr_bits_of_longs((lr_load_doubles(k->k + l) >= lr_load_doubles(k->end + l)) |
                                        (lr_load_doubles(k->transmittance + l) <= job->opaque)))
            << l;
    for (; ended != 0; ended &= ended - 1) {
        const int l = __builtin_ctzll(ended);
        put_ray(k, l, job);
        if (!next_ray(k, l, job))
            at->busy &= ~((uint64_t)1 << l);
    }
}

/* ---- where samples lie ------------------------------------------------------------ */

/* The cells of the next samples of lanes from l on; those beside the box of visible cells are put
 * next to it. */
LR_INLINE void find_cells(const ray_lanes *k, place_lanes *at, const lr_volume *v, int l)
{
    const lr_doubles t = lr_load_doubles(k->k + l) * lr_load_doubles(k->step + l);
    lr_eight_ints c[3];
    for (int a = 0; a < 3; a++) {
        const lr_doubles low = lr_all_doubles(v->surface_lo[a] - 1);
        const lr_doubles high = lr_all_doubles(v->surface_hi[a] + 1);
        const lr_doubles q = lr_load_doubles(k->o[a] + l) + t * lr_load_doubles(k->d[a] + l);
        const lr_doubles own = lr_clamp_doubles(lr_rounded_down_doubles(q), low, high);
        lr_store_doubles(at->p[a] + l, q - own);
        c[a] = lr_eight_ints_of(own);
        lr_store_eight(at->c[a] + l, c[a]);
    }
    lr_find_places(v, c, at->place + l, at->cell + l);
}

/* Look at them; those that are not visible go on by leaving the cube that has nothing. Beside the
 * box, something in the same brick may be visible. */
LR_INLINE void leap(ray_lanes *k, place_lanes *at, const sample_job *job, int l)
{
    const lr_volume *v = job->v;
    const lr_doubles sample = lr_load_doubles(k->k + l), zero = {0};
    lr_eight_ints c[3], inside = ~(lr_eight_ints){0};
    lr_doubles out = lr_all_doubles(INFINITY);
    for (int a = 0; a < 3; a++) {
        c[a] = lr_load_eight(at->c[a] + l);
        inside &= (c[a] >= v->surface_lo[a]) & (c[a] <= v->surface_hi[a]);
    }
    const lr_view seen = job->cubes != NULL ? lr_look_at_distances(at->brick + l, at->distance + l)
                                            : lr_look_at_masks(v, c, at->place + l);
    const lr_longs visible = lr_longs_of_ints(seen.visible & inside);
    const lr_eight_ints block = seen.block & inside, reach = seen.reach & inside;
    for (int a = 0; a < 3; a++) {
        const lr_doubles inv = lr_load_doubles(k->inv[a] + l), o = lr_load_doubles(k->o[a] + l);
        const lr_doubles low = lr_doubles_of((c[a] & ~block) - reach);
        const lr_doubles high = lr_doubles_of((c[a] | block) + reach + 1);
        const lr_doubles plane = lr_pick_doubles(inv > zero, high, low);
        out = lr_lesser_lanes((plane - o) * inv + lr_load_doubles(k->never[a] + l), out);
    }
    const lr_doubles steps = out * lr_load_doubles(k->per_step + l);
    const lr_doubles off = lr_absolute_doubles(steps) * STEP_ROUNDING;
    const lr_doubles first = rounded_up(steps - lr_greater_lanes(off, lr_all_doubles(STEP_SLACK)));
    lr_store_doubles(k->k + l,
                     lr_pick_doubles(visible, sample, lr_greater_lanes(first, sample + 1.0)));
    at->visible |= (uint64_t)lr_bits_of_longs(visible) << l;
}

/* ---- samples ------------------------------------------------------------------------ */

/* The rows of corners of the cells of lanes. */
LR_INLINE void fetch_rows(sample_lanes *s, const place_lanes *at, uint64_t lanes,
                          const lr_volume *v, size_t size)
{
    uint64_t apart = 0, wide = 0; /* corners in several bricks, along x */
    for (int l = 0; l < LANES; l += LR_DOUBLE_LANES) {
        const lr_eight_ints c = lr_load_eight(at->cell + l), last = c & c >> 1 & c >> 2;
        apart |= (uint64_t)lr_bits_of_eight((last & lr_in_brick(1, 1, 1)) != 0) << l;
        wide |= (uint64_t)lr_bits_of_eight((last & 1) != 0) << l;
    }
    const uint64_t kinds[3] = {lanes & ~apart, lanes & apart & ~wide, lanes & wide};
    LR_UNROLLED for (int kind = 0; kind < 3; kind++)
    {
        for (uint64_t left = kinds[kind]; left != 0; left &= left - 1) {
            const int l = __builtin_ctzll(left);
            const int to = __builtin_popcountll(lanes & (((uint64_t)1 << l) - 1));
            uint64_t row[LR_CELL_ROWS];
            if (kind == 0)
                lr_load_rows_of(v, size, (size_t)at->place[l], at->cell[l], row);
            else
                lr_load_rows(v, size, (size_t)at->place[l], at->cell[l], kind == 2, row);
            for (int n = 0; n < LR_CELL_ROWS; n++)
                s->rows[n][to] = row[n];
        }
    }
}

/* Pack the samples of lanes. */
LR_INLINE void pack_samples(sample_lanes *s, const ray_lanes *k, const place_lanes *at,
                            uint64_t lanes, const sample_job *job)
{
    for (int l = 0, n = 0; l < LANES; l += LR_DOUBLE_LANES) {
        const uint32_t bits = (uint32_t)(lanes >> l & 0xff);
        lr_pack_doubles(s->length + n, k->length + l, bits);
        for (int a = 0; a < 3; a++)
            lr_pack_doubles(s->p[a] + n, at->p[a] + l, bits);
        for (int a = 0; a < 3 && job->options->phong != NULL; a++)
            lr_pack_doubles(s->view[a] + n, k->view[a] + l, bits);
        n += __builtin_popcount(bits);
    }
    if (!job->around)
        return;
    int n = 0;
    for (uint64_t left = lanes; left != 0; left &= left - 1, n++)
        for (int a = 0; a < 3; a++)
            s->c[a][n] = at->c[a][__builtin_ctzll(left)];
}

/* The field at samples; never beyond the corners', between which a cell's values are told
 * visible. */
LR_INLINE lr_doubles interpolate(const lr_doubles corner[8], const lr_doubles p[3])
{
    lr_doubles low = corner[0], high = low;
    for (int b = 1; b < 8; b++) {
        low = lr_lesser_lanes(corner[b], low);
        high = lr_greater_lanes(corner[b], high);
    }
    return lr_clamp_doubles(lr_trilinear_lanes(corner, p), low, high);
}

/* The lines of the pieces in which values lie: the members of an lr_transfer_piece. */
LR_INLINE void load_lines(const sample_job *job, lr_doubles value, lr_doubles line[LINES])
{
    const lr_transfer *f = job->v->transfer;
    const lr_longs piece = lr_pieces_of_lanes(f, value);
    const int n_lines = f->emits ? LINES : LINES - 6;
    double lines[LINES][LR_DOUBLE_LANES];
    if (f->n < LR_DOUBLE_LANES) {
        for (int n = 0; n < n_lines; n++)
            line[n] = lr_pick_of_eight(job->lines[n], piece);
        return;
    }
    for (int l = 0; l < LR_DOUBLE_LANES; l++)
        for (int n = 0; n < n_lines; n++)
            lines[n][l] = ((const double *)&f->pieces[piece[l]])[n];
    for (int n = 0; n < n_lines; n++)
        line[n] = lr_load_doubles(lines[n]);
}

/* Eight packed samples from n on, of which `count` are some: the opacity, colours and emission of
 * each. */
LR_INLINE void shade(sample_lanes *s, gradient_lanes *g, const sample_job *job, int n, int count,
                     int32_t type)
{
    const lr_transfer *f = job->v->transfer;
    const lr_phong *phong = job->options->phong;
    const lr_doubles zero = {0};
    lr_unsigned_longs row[LR_CELL_ROWS];
    lr_doubles corner[8], p[3], line[LINES], length = lr_load_doubles(s->length + n);
    for (int i = 0; i < LR_CELL_ROWS; i++)
        memcpy(&row[i], s->rows[i] + n, sizeof *row);
    for (int a = 0; a < 3; a++)
        p[a] = lr_clamp_doubles(lr_load_doubles(s->p[a] + n), zero, lr_all_doubles(1.0));
    lr_unpack_rows(row, type, corner);
    const lr_doubles value = interpolate(corner, p);
    load_lines(job, value, line);
    const lr_doubles from = value - line[0], extinction = line[1] + line[2] * from;
    lr_doubles share = lr_all_doubles(1.0), highlight = zero;
    if (job->around) {
        const uint32_t live = count < LR_DOUBLE_LANES ? (1u << count) - 1 : LR_ALL_DOUBLE_LANES;
        load_around(g, job->v, s->c, n,
                    f->emits ? live : live & lr_bits_of_longs(extinction > zero), type);
    }
    if (f->full_gradient > 0.0)
        length *= modulation(g, job->v, p);
    if (phong != NULL) {
        lr_doubles slope[3], view[3];
        for (int a = 0; a < 3; a++)
            view[a] = lr_load_doubles(s->view[a] + n);
        if (job->central)
            central_gradients(g, p, slope);
        else
            lr_trilinear_gradient_lanes(corner, p, slope);
        light_normals(job->v, slope, view, job->lamp, phong, &share, &highlight);
    }
    const lr_doubles after =
        lr_lane_exp_lanes(-length * lr_pick_doubles(extinction > zero, extinction, zero));
    lr_store_doubles(s->opacity + n, 1.0 - after);
    for (int a = 0; a < 3; a++) {
        lr_doubles color = line[3 + 2 * a] + line[4 + 2 * a] * from;
        if (phong != NULL)
            color = color * share + highlight;
        lr_store_doubles(s->color[a] + n, color);
        if (f->emits)
            lr_store_doubles(s->emitted[a] + n,
                             length * (line[9 + 2 * a] + line[10 + 2 * a] * from));
    }
}

/* Add the samples of lanes to their rays, which go on. */
LR_INLINE void add_samples(ray_lanes *k, const sample_lanes *s, uint64_t lanes, bool emits)
{
    for (int l = 0, n = 0; l < LANES; l += LR_DOUBLE_LANES) {
        const uint32_t bits = (uint32_t)(lanes >> l & 0xff);
        const lr_doubles opacity = lr_unpack_doubles(s->opacity + n, bits);
        const lr_doubles one =
            lr_pick_doubles(lr_longs_of(bits), lr_all_doubles(1.0), (lr_doubles){0});
        lr_doubles transmittance = lr_load_doubles(k->transmittance + l), light[3];
        for (int a = 0; a < 3; a++) {
            const lr_doubles color = lr_unpack_doubles(s->color[a] + n, bits);
            light[a] = lr_load_doubles(k->light[a] + l) + transmittance * (opacity * color);
            if (emits)
                light[a] += transmittance * lr_unpack_doubles(s->emitted[a] + n, bits);
            lr_store_doubles(k->light[a] + l, light[a]);
        }
        transmittance *= 1.0 - opacity;
        lr_store_doubles(k->transmittance + l, transmittance);
        const lr_doubles sample = lr_load_doubles(k->k + l),
                         begins = lr_load_doubles(k->begins + l);
        const lr_longs none = begins == INFINITY;
        if (lr_any(none)) {
            const lr_doubles seen = 1.0 - transmittance + light[0] + light[1] + light[2];
            const lr_doubles t = sample * lr_load_doubles(k->step + l);
            lr_store_doubles(k->begins + l, lr_pick_doubles(none & (seen > 0.0), t, begins));
        }
        lr_store_doubles(k->k + l, sample + one);
        lr_store_doubles(k->taken + l, lr_load_doubles(k->taken + l) + one);
        n += __builtin_popcount(bits);
    }
}

/* ---- all of it ------------------------------------------------------------------------ */

/* Of lanes that wait those that fill vectors, the last one by half; or all where nobody else could
 * join them. */
LR_INLINE uint64_t enough_of(uint64_t waiting, uint64_t busy)
{
    const int beyond = __builtin_popcountll(waiting) % LR_DOUBLE_LANES;
    uint64_t taken = waiting;
    for (int n = waiting == busy || 2 * beyond >= LR_DOUBLE_LANES ? 0 : beyond; n > 0; n--)
        taken &= ~(0x8000000000000000u >> __builtin_clzll(taken));
    return taken;
}

LR_INLINE void sample_rays(sample_job *job, int32_t type, size_t size)
{
    ray_lanes k;
    place_lanes at;
    sample_lanes s;
    gradient_lanes g;
    memset(&at, 0, sizeof at);
    memset(&s, 0, sizeof s);
    if (job->around)
        memset(&g, 0, sizeof g);
    for (int l = 0; l < LANES; l++)
        if (next_ray(&k, l, job))
            at.busy |= (uint64_t)1 << l;
    while (at.busy != 0 && !lr_stopped(job->watch)) {
        job->rounds++;
        at.visible = 0;
        for (int l = 0; l < LANES; l += LR_DOUBLE_LANES)
            find_cells(&k, &at, job->v, l);
        for (int l = 0; l < LANES && job->cubes != NULL; l += LR_DOUBLE_LANES)
            lr_fetch_distances(job->cubes, at.place + l, at.cell + l, at.brick + l,
                               at.distance + l);
        for (int l = 0; l < LANES; l += LR_DOUBLE_LANES)
            leap(&k, &at, job, l);
        const uint64_t taken = enough_of(at.visible, at.busy);
        if (taken != 0) {
            fetch_rows(&s, &at, taken, job->v, size);
            pack_samples(&s, &k, &at, taken, job);
            const int count = __builtin_popcountll(taken);
            for (int n = 0; n < count; n += LR_DOUBLE_LANES)
                shade(&s, &g, job, n, count - n, type);
            add_samples(&k, &s, taken, job->v->transfer->emits);
        }
        refill(&k, &at, job);
    }
}

void LR_SAMPLE_RAYS(const lr_volume *v, const lr_empty_cubes *cubes, const lr_rays *rays,
                    uint64_t first, uint64_t end, const lr_trace_options *options,
                    const lr_hits *hits, lr_counters *counters, const lr_watch *watch)
{
    const lr_transfer *f = v->transfer;
    sample_job job = {.v = v,
                      .cubes = cubes,
                      .rays = rays,
                      .options = options,
                      .hits = hits,
                      .counters = counters,
                      .watch = watch,
                      .next = first,
                      .end = end};
    job.central = options->phong != NULL && options->normal == LR_NORMAL_CENTRAL;
    job.around = job.central || f->full_gradient > 0.0;
    job.opaque = fmax(1.0 - options->stop_opacity, LR_OPAQUE);
    if (options->phong != NULL)
        find_lamp(options->phong, job.lamp);
    for (uint64_t i = 0; i <= f->n && f->n < LR_DOUBLE_LANES; i++)
        for (int n = 0; n < LINES; n++)
            job.lines[n][i] = ((const double *)&f->pieces[i])[n];
    counters->rays += end - first;
    switch (v->desc.sample_type) {
#define LR_SAMPLE_TYPE(id, name, stored, one, step)                                                \
    case id:                                                                                       \
        sample_rays(&job, id, sizeof(stored));                                                     \
        return;
#include "grid/sample_types.def"
#undef LR_SAMPLE_TYPE
    }
}
