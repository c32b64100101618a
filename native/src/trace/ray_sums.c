/* What adds up along a ray through visible cells.
 *
 * In a cell the trilinear field is a cubic along the ray. Exact sums integrate it between entry and
 * exit; samples at equal steps lie on one lattice of the ray, whatever cells are left out; extremes
 * are those of the cubic, at its ends and where its slope is 0; the mean is its integral.
 *
 * Source: Levoy 1988 (samples, classified before or after interpolation) and 1990 (rays end where
 * they are opaque), Max 1995. Departures: no steps but where they are asked for; opacity for a step
 * follows from extinction, so that it does not depend on the step.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/ray_sums.h"

#include "grid/value_gradient.h"
#include "trace/cell.h"
#include "trace/cell_graze.h"
#include "trace/emission_absorption.h"
#include "trace/hit_record.h"

void lr_sums_begin(lr_ray_sums *sums, const lr_volume *v, const lr_ray *r, const lr_rays *rays,
                   uint64_t i, double t_min, const lr_trace_options *options)
{
    const double d[3] = {rays->dx[i], rays->dy[i], rays->dz[i]};
    *sums = (lr_ray_sums){.options = options,
                          .t_min = t_min,
                          .t_max = r->t_max,
                          .speed = rays->length != NULL ? rays->length[i] : sqrt(lr_dot(d, d)),
                          .step = options->step / sqrt(lr_dot(r->d, r->d)),
                          .t = INFINITY,
                          .transmittance = 1.0,
                          .stop = rays->stop != NULL ? fmax(rays->stop[i], LR_OPAQUE) : 0.0,
                          .best = options->mode == LR_MODE_MINIMUM ? INFINITY : -INFINITY};
    lr_grazes_of(v, r, sums->graze);
}

/* The ray's way through cell c, by its planes alone, and the part of it, 0..1, that lies between
 * t_min and t_max; false: none. */
LR_INLINE bool way_through(const lr_ray_sums *sums, const lr_ray *r, lr_lattice lattice,
                           const int32_t c[3], lr_chord *h, lr_cursor *u, int *axis_out,
                           double part[2])
{
    *u = (lr_cursor){.c = {c[0], c[1], c[2]}, .axis = -1, .t = -INFINITY};
    double out = INFINITY;
    *axis_out = 0;
    for (int a = 0; a < 3; a++) {
        if (r->s[a] == 0)
            continue;
        const double near = lr_plane_t(r, lattice, a, c[a] + (r->s[a] < 0));
        const double far = lr_plane_t(r, lattice, a, c[a] + (r->s[a] > 0));
        if (near > u->t) {
            u->t = near;
            u->axis = a;
        }
        if (far < out) {
            out = far;
            *axis_out = a;
        }
    }
    if (u->axis < 0 || !(out - u->t > fmax(sums->graze[u->axis], sums->graze[*axis_out])))
        return false;
    const double size = out - u->t;
    const double low = fmax(u->t, sums->t_min), high = fmin(out, sums->t_max);
    if (!(high > low))
        return false;
    part[0] = low > u->t ? (low - u->t) / size : 0.0;
    part[1] = high < out ? (high - u->t) / size : 1.0;
    lr_chord_points(h, r, lattice, u, axis_out);
    return part[1] > part[0];
}

/* ---- exact light -------------------------------------------------------------- */

/* Light of a cell, or a part of it, by the cubics of the value and of what is seen (NULL: all),
 * whose x from 0 to 1 is t_low..t_high. */
static void add_cubic(lr_ray_sums *sums, const lr_volume *v, const double c[4], const double *m,
                      const double part[2], double t_low, double t_high)
{
    lr_light_sum sum = {.tolerance = sums->options->tolerance,
                        .transmittance = sums->transmittance,
                        .stop = sums->stop};
    memcpy(sum.color, sums->color, sizeof sum.color);
    lr_add_cubic(&sum, v->transfer, c, m, part[0], part[1], (t_high - t_low) * sums->speed);
    memcpy(sums->color, sum.ended ? sum.albedo : sum.color, sizeof sum.color);
    sums->transmittance = sum.transmittance;
    sums->pieces += sum.pieces;
    if (sum.ended)
        sums->t = lr_mix(t_low, t_high, sum.at);
}

static void note_beginning(lr_ray_sums *sums, double t)
{
    const double *light = sums->color;
    if (sums->t == INFINITY && !(sums->stop > 0.0) &&
        (sums->transmittance < 1.0 || sums->length > 0.0 || light[0] + light[1] + light[2] > 0.0))
        sums->t = t;
}

LR_INLINE bool goes_on(const lr_ray_sums *sums)
{
    const double end = sums->stop > 0.0 ? sums->stop : 1.0 - sums->options->stop_opacity;
    return sums->transmittance > (end > LR_OPAQUE ? end : LR_OPAQUE);
}

/* ---- samples at equal steps ------------------------------------------------- */

enum { OPACITY = 0, RED = 1, LIGHTS = 4 };

/* What a sample of that value adds over a length: opacity, and radiance, premultiplied. */
static void classify(const lr_transfer *f, double value, double length, double light[LIGHTS])
{
    const lr_transfer_piece *p = &f->pieces[lr_piece_of(f, value)];
    const double from = value - p->from;
    light[OPACITY] = 1.0 - exp(-length * fmax(lr_linear(p->extinction, from), 0.0));
    for (int k = 0; k < 3; k++)
        light[RED + k] = light[OPACITY] * lr_linear(p->color[k], from) +
                         length * lr_linear(p->emission[k], from);
}

/* As classified at the corners, each light apart; m: how much is seen, or NULL. */
static void classify_corners(const lr_transfer *f, const lr_chord *h, const lr_chord *m,
                             double length, double lights[LIGHTS][8])
{
    for (int b = 0; b < 8; b++) {
        double light[LIGHTS];
        classify(f, h->corner[b], m != NULL ? length * m->corner[b] : length, light);
        for (int k = 0; k < LIGHTS; k++)
            lights[k][b] = light[k];
    }
}

static void add_samples(lr_ray_sums *sums, const lr_volume *v, const lr_chord *h, const lr_chord *m)
{
    const bool before = sums->options->sampling == LR_SAMPLING_PRE;
    const double size = h->t_out - h->t_in, length = sums->step * sums->speed;
    const double low = fmax(h->t_in, sums->t_min), high = fmin(h->t_out, sums->t_max);
    double lights[LIGHTS][8];
    if (before)
        classify_corners(v->transfer, h, m, length, lights);
    double k = ceil(low / sums->step);
    for (double t = k * sums->step; t < high; t = k * sums->step) {
        double light[LIGHTS];
        const double x = lr_clamp((t - h->t_in) / size, 0.0, 1.0);
        if (before) {
            double p[3];
            for (int a = 0; a < 3; a++)
                p[a] = lr_mix(h->in[a], h->out[a], x);
            for (int i = 0; i < LIGHTS; i++)
                light[i] = lr_trilinear(lights[i], p);
        } else {
            const double seen = m != NULL ? lr_clamp(lr_cubic(m->c, x), 0.0, 1.0) : 1.0;
            classify(v->transfer, lr_cubic(h->c, x), length * seen, light);
        }
        for (int i = 0; i < 3; i++)
            sums->color[i] += sums->transmittance * light[RED + i];
        sums->transmittance *= 1.0 - light[OPACITY];
        sums->pieces++;
        if (!(k + 1.0 > k))
            return; /* so far away that steps are lost in rounding */
        k += 1.0;
    }
}

/* ---- values ------------------------------------------------------------------- */

/* Can the cell hold a better value than the best so far? */
static bool may_better(const lr_ray_sums *sums, const double corner[8])
{
    const double sign = sums->options->mode == LR_MODE_MINIMUM ? -1.0 : 1.0;
    double most = -INFINITY;
    for (int b = 0; b < 8; b++)
        most = fmax(most, sign * corner[b]);
    return most > sign * sums->best;
}

static void add_extremes(lr_ray_sums *sums, const lr_chord *h, const double part[2])
{
    const double sign = sums->options->mode == LR_MODE_MINIMUM ? -1.0 : 1.0;
    double x[4] = {part[0]};
    int n = 1 + lr_cubic_extrema(h->c, x + 1);
    x[n++] = part[1];
    for (int i = 0; i < n; i++) {
        if (!(x[i] >= part[0] && x[i] <= part[1]))
            continue;
        const double f = x[i] == 1.0 ? h->f_out : lr_cubic(h->c, x[i]);
        if (sign * f > sign * sums->best) {
            sums->best = f;
            sums->t = h->t_in + x[i] * (h->t_out - h->t_in);
        }
    }
}

static void add_mean(lr_ray_sums *sums, const lr_chord *h, const double part[2])
{
    const double size = h->t_out - h->t_in, *c = h->c;
    double ends[2];
    for (int e = 0; e < 2; e++) {
        const double x = part[e];
        ends[e] = (((0.25 * c[3] * x + c[2] * (1.0 / 3.0)) * x + 0.5 * c[1]) * x + c[0]) * x;
    }
    sums->sum += size * (ends[1] - ends[0]);
    sums->length += size * (part[1] - part[0]);
}

/* ---- light of one cell ---------------------------------------------------------- */

/* How much is seen along the chord h, in the place of its values; false: nothing, for the cell has
 * a sample that is no value. */
static bool modulate(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int axis_out,
                     const lr_chord *h, lr_chord *m)
{
    *m = *h;
    if (!lr_modulation_at(v, u->c, v->transfer->full_gradient, m->corner))
        return false;
    lr_chord_values(m, r, u, axis_out);
    lr_chord_cubic(m);
    return true;
}

/* Add the light of a part of the chord. */
static void add_chord(lr_ray_sums *sums, const lr_volume *v, const lr_ray *r, const lr_cursor *u,
                      int axis_out, const lr_chord *h, const double part[2])
{
    const bool modulated = v->transfer->full_gradient > 0.0;
    lr_chord m;
    if (modulated && !modulate(v, r, u, axis_out, h, &m))
        return;
    if (sums->options->sampling == LR_SAMPLING_EXACT)
        add_cubic(sums, v, h->c, modulated ? m.c : NULL, part, h->t_in, h->t_out);
    else
        add_samples(sums, v, h, modulated ? &m : NULL);
}

/* ---- all of it ---------------------------------------------------------------- */

bool lr_sums_cell(lr_ray_sums *sums, const lr_volume *v, const lr_ray *r, lr_lattice lattice,
                  const int32_t c[3])
{
    lr_chord h;
    lr_cursor u;
    double part[2];
    int axis_out;
    const int32_t mode = sums->options->mode;
    const bool extreme = mode == LR_MODE_MAXIMUM || mode == LR_MODE_MINIMUM;
    if (!way_through(sums, r, lattice, c, &h, &u, &axis_out, part))
        return true;
    lr_corners(v, c, h.corner);
    if (extreme && !may_better(sums, h.corner))
        return true;
    sums->cells++;
    lr_chord_values(&h, r, &u, axis_out);
    lr_chord_cubic(&h);
    if (extreme) {
        add_extremes(sums, &h, part);
        return true;
    }
    if (mode == LR_MODE_MEAN)
        add_mean(sums, &h, part);
    else
        add_chord(sums, v, r, &u, axis_out, &h, part);
    note_beginning(sums, h.t_in + part[0] * (h.t_out - h.t_in));
    return goes_on(sums);
}

bool lr_sums_put(const lr_ray_sums *sums, const lr_volume *v, const lr_hits *hits, uint64_t i)
{
    const bool mean = sums->options->mode == LR_MODE_MEAN, seen = sums->t < INFINITY;
    const double stored = mean ? sums->sum / sums->length : sums->best;
    hits->t[i] = sums->t;
    lr_put_triple(hits->red, hits->green, hits->blue, i, sums->color);
    if (hits->transmittance != NULL)
        hits->transmittance[i] = sums->transmittance;
    if (hits->value != NULL)
        hits->value[i] = seen ? v->value_offset + v->value_scale * stored : NAN;
    if (hits->length != NULL)
        hits->length[i] = sums->length * sums->speed;
    return seen;
}
