/* Does the ray meet the surface f = T inside the cell it stands on, where f is a tricubic B-spline?
 *
 * Along the ray f is a polynomial of degree 9. Its Bernstein coefficients between entry and exit
 * are sums of the cell's 4^3 samples with weights that are not negative, so that nothing cancels:
 * with T taken from the samples first, a coefficient is off by less than 2^-47 of the largest of
 * the differences, and has their side where that is one. The first and the last one are f at the
 * entry and the exit, and the same bits in both cells of a face, so that no ray slips between them.
 *
 * The polynomial lies in the hull of its coefficients and has no more roots than these change
 * sides: none where they do not, and one where they do once, between ends that lie on different
 * sides. Else the interval is halved, and its first half comes first. So the first root is found,
 * unless the field passes T by less than NEGLIGIBLE and comes back; and what is found is a root.
 *
 * A ray that leaves the surface starts on it but for rounding, and half of the time beyond it. The
 * surface is taken to lie where the start is on its side, and what is nearer to the start than that
 * may be off (lr_start_off) is the surface that it leaves, unless the ray is beyond it from there
 * on. Where it leaves the cell beyond T all the same, or on it but for rounding, its side goes with
 * it into the next one; what lies beyond T in front of a cell without surface has met the surface.
 *
 * Sources: Lane and Riesenfeld 1981, Bounds on a polynomial; Spencer 1994, who finds the first root
 * like this. Departure: coefficients by the blossoms of the basis, not by a change of basis.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/tricubic_cell.h"

#include "grid/tricubic.h"
#include "trace/cell_common.h"

enum { DEGREE = 9, COUNT = DEGREE + 1, HALVINGS = 26 };

/* Of the chord: of roots that lie nearer together none need be told from the others. */
static const double LEAST_SIZE = 0x1p-26; /* 2^-HALVINGS */

/* Of the largest difference between a sample and T: twice what rounding does to a coefficient. */
static const double NEGLIGIBLE = 0x1p-46;

/* f - T on an interval, in Bernstein form. */
typedef struct lr_polynomial {
    double b[COUNT];
} lr_polynomial;

/* The basis of one axis between p and q: Bernstein coefficients, times 6 and their binomials. Those
 * at p and at q follow from these alone, by the same operations.
 *
 * Source: Ramshaw 1989, Blossoms are polar forms. */
static void restrict_basis(double p, double q, double m[4][4])
{
    static const double binomial[4] = {1.0, 3.0, 3.0, 1.0};
    for (int n = 0; n < 4; n++) {
        const double x = n > 2 ? q : p, y = n > 1 ? q : p, z = n > 0 ? q : p;
        const double u = 1.0 - x, v = 1.0 - y, w = 1.0 - z;
        const double product = x * y * z, opposite = u * v * w;
        m[0][n] = binomial[n] * opposite;
        m[1][n] = binomial[n] * (4.0 - 2.0 * (x * y + x * z + y * z) + 3.0 * product);
        m[2][n] = binomial[n] * (4.0 - 2.0 * (u * v + u * w + v * w) + 3.0 * opposite);
        m[3][n] = binomial[n] * product;
    }
}

/* The field of the samples s along the chord. */
static void restrict_field(const double s[LR_TRICUBIC_SAMPLES], const lr_chord *h, lr_polynomial *f)
{
    /* 1 / (6^3 binomial) */
    static const double scale[COUNT] = {
        1.0 / 216,   1.0 / 1944,  1.0 / 7776, 1.0 / 18144, 1.0 / 27216,
        1.0 / 27216, 1.0 / 18144, 1.0 / 7776, 1.0 / 1944,  1.0 / 216,
    };
    double m[3][4][4], row[7][4] = {{0}};
    for (int a = 0; a < 3; a++)
        restrict_basis(h->in[a], h->out[a], m[a]);
    for (int n = 0; n < 4; n++) {
        double plane[16];
        for (int i = 0; i < 16; i++)
            plane[i] = s[i] * m[2][0][n] + s[16 + i] * m[2][1][n] + s[32 + i] * m[2][2][n] +
                       s[48 + i] * m[2][3][n];
        for (int l = 0; l < 4; l++)
            for (int i = 0; i < 4; i++)
                row[n + l][i] += plane[i] * m[1][0][l] + plane[4 + i] * m[1][1][l] +
                                 plane[8 + i] * m[1][2][l] + plane[12 + i] * m[1][3][l];
    }
    memset(f->b, 0, sizeof f->b);
    for (int l = 0; l < 7; l++)
        for (int n = 0; n < 4; n++)
            f->b[l + n] += row[l][0] * m[0][0][n] + row[l][1] * m[0][1][n] +
                           row[l][2] * m[0][2][n] + row[l][3] * m[0][3][n];
    for (int n = 0; n < COUNT; n++)
        f->b[n] *= scale[n];
}

/* Cut at x, by de Casteljau. lower may be NULL, upper may be f. */
static void cut(const lr_polynomial *f, double x, lr_polynomial *lower, lr_polynomial *upper)
{
    lr_polynomial rest = *f;
    for (int n = 0; n < COUNT; n++) {
        if (lower != NULL)
            lower->b[n] = rest.b[0];
        for (int i = 0; i < DEGREE - n; i++)
            rest.b[i] = (1.0 - x) * rest.b[i] + x * rest.b[i + 1];
    }
    *upper = rest;
}

/* f at x, and its slope. */
static double evaluate(const lr_polynomial *f, double x, double *slope)
{
    static const double binomial[DEGREE] = {1.0, 8.0, 28.0, 56.0, 70.0, 56.0, 28.0, 8.0, 1.0};
    const double y = 1.0 - x;
    double power[DEGREE], opposite[DEGREE], low = 0.0, high = 0.0;
    power[0] = opposite[0] = 1.0;
    for (int i = 1; i < DEGREE; i++) {
        power[i] = x * power[i - 1];
        opposite[i] = y * opposite[i - 1];
    }
    for (int i = 0; i < DEGREE; i++) {
        const double weight = binomial[i] * power[i] * opposite[DEGREE - 1 - i];
        low += weight * f->b[i];
        high += weight * f->b[i + 1];
    }
    *slope = DEGREE * (high - low);
    return y * low + x * high;
}

static bool is_off(double f, bool above)
{
    return (f >= 0.0) != above;
}

/* Where f, whose start counts as on the side `above` and whose end is off it, changes sides. */
static double refine(const lr_polynomial *f, bool above, int32_t root, uint64_t *n_samples)
{
    double a = 0.0, b = 1.0, slope, x = f->b[0] / (f->b[0] - f->b[DEGREE]);
    if (root == LR_ROOT_LINEAR)
        return x > 0.0 && x < 1.0 ? x : 0.0;
    for (int step = 0; step < 60 && b - a > LR_ROOT_ENOUGH; step++) {
        if (!(x > a && x < b) || root == LR_ROOT_BISECT)
            x = 0.5 * (a + b);
        const double value = evaluate(f, x, &slope);
        ++*n_samples;
        if (is_off(value, above))
            b = x;
        else
            a = x;
        const double next = x - value / slope; /* NaN and infinity are caught above */
        if (root == LR_ROOT_NEWTON && fabs(next - x) <= LR_ROOT_ENOUGH)
            return lr_clamp(next, a, b);
        x = next;
    }
    return 0.5 * (a + b);
}

/* How often the coefficients change sides, f starting on the side `above`; *most: by how much they
 * are off it. */
static int count_changes(const lr_polynomial *f, bool above, double *most)
{
    int n = 0;
    bool before = false;
    *most = 0.0;
    for (int i = 1; i < COUNT; i++) {
        const bool off = is_off(f->b[i], above);
        n += off != before;
        before = off;
        if (off && fabs(f->b[i]) > *most)
            *most = fabs(f->b[i]);
    }
    return n;
}

/* The first change of sides of f, whose start counts as on the side `above`; false: there is none.
 */
static bool find_change(const lr_polynomial *f, bool above, double negligible, int32_t root,
                        uint64_t *n_samples, double *x)
{
    lr_polynomial held[HALVINGS + 2];
    double from[HALVINGS + 2], size[HALVINGS + 2], most;
    int n = 1;
    held[0] = *f;
    from[0] = 0.0;
    size[0] = 1.0;
    while (n > 0) {
        const lr_polynomial *now = &held[n - 1];
        const int count = count_changes(now, above, &most);
        const bool off = is_off(now->b[DEGREE], above);
        if (count > 1 && size[n - 1] > LEAST_SIZE && !(most <= negligible)) {
            size[n - 1] *= 0.5;
            size[n] = size[n - 1];
            from[n] = from[n - 1];
            from[n - 1] += size[n];
            cut(now, 0.5, &held[n], &held[n - 1]);
            n++;
            continue;
        }
        if (off) {
            *x = from[n - 1] + size[n - 1] * refine(now, above, root, n_samples);
            return true;
        }
        n--;
    }
    return false;
}

/* Of a ray that starts on the surface: move T, so that the start lies on its side by `least`; false
 * where it lies beyond by more than it may be off. */
static bool move_to_side(lr_polynomial *f, bool above, double least, double off)
{
    const double sign = above ? 1.0 : -1.0, height = sign * f->b[0];
    for (int n = 0; n < COUNT && height < least; n++)
        f->b[n] += sign * (least - height);
    return height >= -off;
}

/* Does the cell that the ray goes on into hold surface? */
static bool goes_on(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int axis)
{
    int32_t beside[3] = {u->c[0], u->c[1], u->c[2]};
    beside[axis] += r->s[axis];
    return lr_holds_surface(v, beside);
}

/* find_change of a ray that has left the surface, on the side `above`: nothing is met before
 * `from`, and the start may be off by so much. */
static bool find_next(const lr_polynomial *f, bool above, double from, double off,
                      double negligible, int32_t root, uint64_t *n_samples, double *x)
{
    lr_polynomial rest = *f;
    *x = 0.0;
    if (!move_to_side(&rest, above, 2.0 * negligible, off))
        return true;
    if (!(from < 1.0))
        return false;
    if (from > 0.0)
        cut(&rest, from, NULL, &rest);
    from = fmax(from, 0.0);
    const bool found = find_change(&rest, above, negligible, root, n_samples, x);
    *x = from + (1.0 - from) * *x;
    return found;
}

/* The samples of a cell, less T; returns the largest size. */
static double take_samples(const lr_volume *v, const int32_t c[3], double s[LR_TRICUBIC_SAMPLES])
{
    double most[4] = {0}; /* of every fourth one, which are found side by side */
    lr_tricubic_samples(v, c, s);
    for (int n = 0; n < LR_TRICUBIC_SAMPLES; n += 4)
        for (int i = 0; i < 4; i++) {
            const double height = s[n + i] - v->threshold, size = fabs(height);
            s[n + i] = height;
            most[i] = size > most[i] ? size : most[i];
        }
    return fmax(fmax(most[0], most[1]), fmax(most[2], most[3]));
}

bool lr_hit_tricubic(const lr_volume *v, const lr_ray *r, const lr_cursor *u, double t_start,
                     int *side, const lr_trace_options *options, lr_found *found,
                     uint64_t *n_samples)
{
    lr_chord h;
    lr_polynomial f;
    int axis;
    double s[LR_TRICUBIC_SAMPLES], x;
    lr_chord_points(&h, r, LR_REGULAR, u, &axis);
    const double scale = take_samples(v, u->c, s), negligible = NEGLIGIBLE * scale;
    restrict_field(s, &h, &f);
    *n_samples += 2;
    const int start = *side;
    const bool above = start != 0 ? start > 0 : f.b[0] >= 0.0,
               ends_off = is_off(f.b[DEGREE], above);
    /* by how much a start may be off: no slope is larger than 2 scale along each of three axes */
    const double voxels = lr_start_off(v), off = 4.0 * voxels * scale;
    *side = 0;
    if (options->hit_test == LR_HIT_FACES && start == 0 && !ends_off)
        return false;
    const double clear = t_start + voxels / sqrt(lr_dot(r->d, r->d));
    const double from = (clear - h.t_in) / (h.t_out - h.t_in);
    const bool met =
        start == 0 ? find_change(&f, above, negligible, options->root, n_samples, &x)
                   : find_next(&f, above, from, off, negligible, options->root, n_samples, &x);
    if (!met && start != 0 && (ends_off || fabs(f.b[DEGREE]) <= off) && goes_on(v, r, u, axis)) {
        *side = start;
        return false;
    }
    if (!met && !ends_off)
        return false;
    x = met ? x : 1.0;
    found->t = h.t_in + x * (h.t_out - h.t_in);
    for (int a = 0; a < 3; a++)
        found->p[a] = h.in[a] + x * (h.out[a] - h.in[a]);
    memcpy(found->c, u->c, sizeof found->c);
    return found->t <= r->t_max; /* asked only now, so that t does not depend on it */
}
