/* Transfer functions: made, and asked for what values can be seen.
 *
 * Source: Levoy 1990: what is left out is what the greatest opacity over a range of values is 0 of.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/transfer_function.h"

#include "base/cpu.h"
#include "base/error.h"

enum { COLUMNS = 10, MOST_KNOTS = 1 << 16 };

/* Of extinction, colour, emission and scattering, whose products with lengths stay finite; of
 * values. */
static const double MOST = 1e30, MOST_VALUE = 1e300;

static lr_status check_column(const double *numbers, uint64_t n, const char *name, lr_error *error)
{
    for (uint64_t i = 0; i < n; i++)
        if (!(numbers[i] >= 0.0 && numbers[i] <= MOST))
            return lr_fail(error, LR_E_ARGUMENT, "%s must lie between 0 and %g; one is %g", name,
                           MOST, numbers[i]);
    return LR_OK;
}

static lr_status check_scattering(const lr_transfer_desc *d, lr_error *error)
{
    const lr_status status = check_column(d->scattering, 3 * d->n, "scattering", error);
    for (uint64_t i = 0; i < 3 * d->n && status == LR_OK; i++)
        if (d->scattering[i] > 0.0 && !(d->extinction[i / 3] > 0.0))
            return lr_fail(
                error, LR_E_ARGUMENT,
                "what scatters light extinguishes it; knot %llu has scattering %g and no "
                "extinction",
                (unsigned long long)(i / 3), d->scattering[i]);
    return status;
}

static lr_status check_desc(const lr_transfer_desc *d, lr_error *error)
{
    if (d->n < 1 || d->n > MOST_KNOTS)
        return lr_fail(error, LR_E_SIZE, "a transfer function has 1 to %d knots, not %llu",
                       MOST_KNOTS, (unsigned long long)d->n);
    for (uint64_t i = 0; i < d->n; i++) {
        if (!(fabs(d->values[i]) <= MOST_VALUE))
            return lr_fail(error, LR_E_ARGUMENT,
                           "values of a transfer function must be finite, within %g; knot %llu "
                           "lies at %g",
                           MOST_VALUE, (unsigned long long)i, d->values[i]);
        if (i > 0 && d->values[i] < d->values[i - 1])
            return lr_fail(error, LR_E_ARGUMENT,
                           "values of a transfer function must not descend; knot %llu lies at "
                           "%.17g, the one before at %.17g",
                           (unsigned long long)i, d->values[i], d->values[i - 1]);
    }
    if (!(d->full_gradient >= 0.0 && d->full_gradient <= MOST_VALUE))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the gradient at which all is seen must lie between 0 and %g, it is %g",
                       MOST_VALUE, d->full_gradient);
    lr_status status = check_column(d->extinction, d->n, "extinction", error);
    if (status == LR_OK)
        status = check_column(d->colors, 3 * d->n, "colours of a transfer function", error);
    if (status == LR_OK && d->emission != NULL)
        status = check_column(d->emission, 3 * d->n, "emission", error);
    if (status == LR_OK && d->scattering != NULL)
        status = check_scattering(d, error);
    return status;
}

static lr_status allocate(uint64_t n, lr_transfer **transfer, lr_error *error)
{
    const size_t nbytes = sizeof(lr_transfer) + (n + 1) * sizeof(lr_transfer_piece) +
                          n * (1 + COLUMNS) * sizeof(double);
    lr_transfer *f = calloc(1, nbytes);
    if (f == NULL)
        return lr_fail_memory(error, nbytes, "a transfer function");
    f->n = n;
    f->pieces = (lr_transfer_piece *)(void *)(f + 1);
    f->values = (double *)(void *)(f->pieces + n + 1);
    f->knots = (double (*)[COLUMNS])(void *)(f->values + n);
    *transfer = f;
    return LR_OK;
}

/* The line from y0 at 0 to y1 at width; one so steep that no number tells it from a jump is its
 * middle throughout. */
static void fill_line(double line[2], double y0, double y1, double width)
{
    const double rise = width > 0.0 ? (y1 - y0) / width : 0.0;
    const bool steep = !(fabs(rise) <= MOST_VALUE);
    line[0] = steep ? 0.5 * (y0 + y1) : y0;
    line[1] = steep ? 0.0 : rise;
}

/* Piece i, between its two knots or beyond all. */
static void fill_piece(lr_transfer *f, uint64_t i, double most_color, double most_emission)
{
    lr_transfer_piece *p = &f->pieces[i];
    const uint64_t from = i > 0 ? i - 1 : 0, to = i < f->n ? i : f->n - 1;
    const double *a = f->knots[from], *b = f->knots[to];
    const double width = f->values[to] - f->values[from];
    p->from = f->values[from];
    fill_line(p->extinction, a[0], b[0], width);
    p->absorbs = a[0] > 0.0 || b[0] > 0.0;
    p->one_color = true;
    for (int k = 0; k < 3; k++) {
        fill_line(p->color[k], a[1 + k], b[1 + k], width);
        fill_line(p->emission[k], a[4 + k], b[4 + k], width);
        fill_line(p->scattering[k], a[7 + k], b[7 + k], width);
        p->emits = p->emits || a[4 + k] > 0.0 || b[4 + k] > 0.0;
        p->one_color = p->one_color && p->color[k][1] == 0.0;
        if (most_color > 0.0)
            p->turn = fmax(p->turn, fabs(p->color[k][1]) / most_color);
        if (most_emission > 0.0) {
            p->emitted = fmax(p->emitted, fabs(p->emission[k][1]) / most_emission);
            p->shines = fmax(p->shines, p->emission[k][0] / most_emission);
        }
    }
}

static void fill_pieces(lr_transfer *f)
{
    double most_color = 0.0, most_emission = 0.0;
    for (uint64_t i = 0; i < f->n; i++) {
        for (int k = 0; k < 3; k++) {
            most_color = fmax(most_color, f->knots[i][1 + k]);
            most_emission = fmax(most_emission, f->knots[i][4 + k]);
            f->emits |= f->knots[i][4 + k] > 0.0;
            f->scatters |= f->knots[i][7 + k] > 0.0;
        }
    }
    for (uint64_t i = 0; i <= f->n; i++)
        fill_piece(f, i, most_color, most_emission);
}

lr_status lr_transfer_new(const lr_transfer_desc *d, lr_transfer **transfer, lr_error *error)
{
    lr_status status = check_desc(d, error);
    if (status == LR_OK)
        status = allocate(d->n, transfer, error);
    if (status != LR_OK)
        return status;
    lr_transfer *f = *transfer;
    f->full_gradient = d->full_gradient;
    memcpy(f->values, d->values, d->n * sizeof *f->values);
    for (uint64_t i = 0; i < d->n; i++) {
        f->knots[i][0] = d->extinction[i];
        memcpy(f->knots[i] + 1, d->colors + 3 * i, 3 * sizeof(double));
        if (d->emission != NULL)
            memcpy(f->knots[i] + 4, d->emission + 3 * i, 3 * sizeof(double));
        if (d->scattering != NULL)
            memcpy(f->knots[i] + 7, d->scattering + 3 * i, 3 * sizeof(double));
    }
    fill_pieces(f);
    return LR_OK;
}

void lr_transfer_free(lr_transfer *f)
{
    free(f); /* its arrays lie behind it */
}

lr_status lr_transfer_of_numbers(const lr_transfer *f, double scale, double offset,
                                 lr_transfer **of_numbers, lr_error *error)
{
    if (!(isfinite(offset) && isfinite(scale) && scale != 0.0))
        return lr_fail(error, LR_E_ARGUMENT,
                       "scale and offset of numbers must be finite, scale not 0; they are %g and "
                       "%g",
                       scale, offset);
    const lr_status status = allocate(f->n, of_numbers, error);
    if (status != LR_OK)
        return status;
    lr_transfer *g = *of_numbers;
    g->simd = lr_cpu_simd();
    g->full_gradient = fmin(f->full_gradient / fabs(scale), MOST_VALUE);
    for (uint64_t i = 0; i < f->n; i++) {
        const uint64_t from = scale > 0.0 ? i : f->n - 1 - i;
        g->values[i] = lr_clamp((f->values[from] - offset) / scale, -MOST_VALUE, MOST_VALUE);
        memcpy(g->knots[i], f->knots[from], sizeof *g->knots);
    }
    fill_pieces(g);
    return LR_OK;
}

/* ---- ranges of values ------------------------------------------------------ */

/* A line at a value; from a knot on the constants beyond the ends, whatever the value. */
static double line_at(const double line[2], double from, double value)
{
    return line[1] != 0.0 ? fmax(lr_linear(line, value - from), 0.0) : line[0];
}

/* Raise the greatest extinction and emission to those of low..high in piece i, the values of its
 * knots included. */
static void raise_to_piece(const lr_transfer *f, uint64_t i, double low, double high,
                           double *extinction, double *emission)
{
    const lr_transfer_piece *p = &f->pieces[i];
    if (!p->absorbs && !p->emits)
        return;
    const double part[2] = {i > 0 ? fmax(low, f->values[i - 1]) : low,
                            i < f->n ? fmin(high, f->values[i]) : high};
    for (int e = 0; e < 2; e++) {
        *extinction = fmax(*extinction, line_at(p->extinction, p->from, part[e]));
        for (int k = 0; k < 3 && p->emits; k++)
            *emission = fmax(*emission, line_at(p->emission[k], p->from, part[e]));
    }
}

bool lr_transfer_sees(const lr_transfer *f, double low, double high)
{
    double extinction = 0.0, emission = 0.0;
    for (uint64_t i = lr_piece_below(f, low), last = lr_piece_of(f, high);
         i <= last && extinction == 0.0 && emission == 0.0; i++)
        raise_to_piece(f, i, low, high, &extinction, &emission);
    return extinction > 0.0 || emission > 0.0;
}

static void greatest(const lr_transfer *f, double low, double high, double *extinction,
                     double *emission)
{
    *extinction = *emission = 0.0;
    for (uint64_t i = lr_piece_below(f, low), last = lr_piece_of(f, high); i <= last; i++)
        raise_to_piece(f, i, low, high, extinction, emission);
}

lr_status lr_transfer_greatest(const lr_transfer *f, const double *low, const double *high,
                               uint64_t n, double *extinction, double *emission, lr_error *error)
{
    for (uint64_t i = 0; i < n; i++) {
        if (!(low[i] <= high[i]))
            return lr_fail(error, LR_E_ARGUMENT,
                           "a range of values ends at or above its beginning; one is %g..%g",
                           low[i], high[i]);
        greatest(f, low[i], high[i], &extinction[i], &emission[i]);
    }
    return LR_OK;
}
