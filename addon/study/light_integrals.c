/* What light_integrals.py integrates, for many rays: absorption along rays in the x87's 80 bits,
 * with nothing of the core's. Along a ray a cell's trilinear field is a cubic, which four of its
 * values give. It is cut where it turns and, by halving, where it passes a knot. On what lies
 * between, extinction is a polynomial, and so is optical depth; colours are integrated by Gauss and
 * Legendre's rule of 16 nodes, in panels none of which is deeper than 1.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

typedef long double real;

enum { NODES = 16, HALVINGS = 70, MOST_KNOTS = 64, CUTS = 3 * MOST_KNOTS + 4 };

typedef struct ramp {
    int n; /* knots; piece i lies before knot i */
    real x[MOST_KNOTS];
    real from[MOST_KNOTS + 1], start[MOST_KNOTS + 1][4], rise[MOST_KNOTS + 1][4];
} ramp;

typedef struct field {
    const double *samples; /* x fastest */
    int64_t size[3];
} field;

/* y[n][4]: extinction and colour of the knots. */
static void make_ramp(ramp *r, int n, const double *x, const double *y)
{
    r->n = n;
    for (int i = 0; i < n; i++)
        r->x[i] = x[i];
    for (int i = 0; i <= n; i++) {
        const int a = i > 0 ? i - 1 : 0, b = i < n ? i : n - 1;
        r->from[i] = r->x[a];
        for (int k = 0; k < 4; k++) {
            const real width = r->x[b] - r->x[a];
            r->start[i][k] = y[4 * a + k];
            r->rise[i][k] = b > a && width > 0 ? ((real)y[4 * b + k] - y[4 * a + k]) / width : 0;
        }
    }
}

static int piece_of(const ramp *r, real value)
{
    int i = 0;
    while (i < r->n && r->x[i] <= value)
        i++;
    return i;
}

static bool sees(const ramp *r, real low, real high)
{
    const int a = piece_of(r, low), b = piece_of(r, high);
    for (int i = a; i <= b; i++) {
        const real ends[2] = {i == a ? low : r->from[i], i == b ? high : r->x[i]};
        for (int e = 0; e < 2; e++)
            if (r->start[i][0] + (ends[e] - r->from[i]) * r->rise[i][0] > 0)
                return true;
    }
    return false;
}

static real cubic(const real c[4], real x)
{
    return ((c[3] * x + c[2]) * x + c[1]) * x + c[0];
}

static int ascending(const void *a, const void *b)
{
    const real x = *(const real *)a, y = *(const real *)b;
    return (x > y) - (x < y);
}

/* Where the cubic turns between 0 and 1. */
static int add_turns(const real c[4], real *at)
{
    const real a = 3 * c[3], b = 2 * c[2], d = c[1];
    const real q = -(b + copysignl(sqrtl(b * b - 4 * a * d), b)) / 2;
    const real found[2] = {q / a, d / q};
    int n = 0;
    for (int i = 0; i < 2; i++)
        if (found[i] > 0 && found[i] < 1)
            at[n++] = found[i];
    return n;
}

static int add_crossings(const real c[4], const ramp *r, real low, real high, real *at)
{
    int n = 0;
    for (int i = 0; i < r->n; i++) {
        const bool below = cubic(c, low) < r->x[i];
        real a = low, b = high;
        if (below == (cubic(c, high) < r->x[i]))
            continue;
        for (int k = 0; k < HALVINGS; k++) {
            const real middle = (a + b) / 2;
            if ((cubic(c, middle) < r->x[i]) == below)
                a = middle;
            else
                b = middle;
        }
        at[n++] = b;
    }
    return n;
}

/* Light of the cubic's part a..b, which lies on one piece. sum[4]: colour and transmittance. */
static void add_part(const real c[4], const ramp *r, real a, real b, real length,
                     const double *nodes, const double *weights, real sum[4])
{
    const real w = b - a;
    const int p = piece_of(r, cubic(c, (a + b) / 2));
    const real q[4] = {cubic(c, a) - r->from[p], ((3 * c[3] * a + 2 * c[2]) * a + c[1]) * w,
                       (3 * c[3] * a + c[2]) * w * w, c[3] * w * w * w};
    real most = 0, depth[4];
    for (int k = 0; k < 4; k++)
        depth[k] = w * length * ((k == 0 ? r->start[p][0] : 0) + r->rise[p][0] * q[k]) / (k + 1);
    for (int k = 0; k < r->n; k++)
        most = r->start[k][0] > most ? r->start[k][0] : most;
    const int panels = 1 + (int)(w * length * most);
    real own[3] = {0};
    for (int panel = 0; panel < panels; panel++)
        for (int k = 0; k < NODES; k++) {
            const real u = (panel + (1 + (real)nodes[k]) / 2) / panels;
            const real value = cubic(q, u);
            const real extinction = r->start[p][0] + value * r->rise[p][0];
            const real weight = (real)weights[k] / 2 / panels * w * length;
            const real light = weight * extinction * expl(-cubic(depth, u) * u);
            for (int i = 0; i < 3; i++)
                own[i] += light * (r->start[p][1 + i] + value * r->rise[p][1 + i]);
        }
    for (int i = 0; i < 3; i++)
        sum[i] += sum[3] * own[i];
    sum[3] *= expl(-cubic(depth, 1));
}

static void add_cell(const real c[4], const ramp *r, real length, const double *nodes,
                     const double *weights, real sum[4])
{
    real ends[4] = {0}, cuts[CUTS];
    int n_ends = 1 + add_turns(c, ends + 1), n = 0;
    ends[n_ends++] = 1;
    qsort(ends, (size_t)n_ends, sizeof *ends, ascending);
    for (int i = 0; i < n_ends; i++) {
        cuts[n++] = ends[i];
        if (i + 1 < n_ends)
            n += add_crossings(c, r, ends[i], ends[i + 1], cuts + n);
    }
    qsort(cuts, (size_t)n, sizeof *cuts, ascending);
    for (int i = 0; i + 1 < n; i++)
        if (cuts[i + 1] > cuts[i])
            add_part(c, r, cuts[i], cuts[i + 1], length, nodes, weights, sum);
}

/* The cubic along the ray from t0 to t1, in one cell; false where nothing in it is seen. */
static bool cubic_of(const field *f, const ramp *r, const real o[3], const real d[3], real t0,
                     real t1, real c[4])
{
    int64_t cell[3];
    real corner[8], low = INFINITY, high = -INFINITY, v[4];
    for (int a = 0; a < 3; a++) {
        const real at = floorl(o[a] + (t0 + t1) / 2 * d[a]);
        const real top = (real)(f->size[a] - 2);
        cell[a] = (int64_t)(at < 0 ? 0 : at > top ? top : at);
    }
    for (int b = 0; b < 8; b++) {
        const int64_t x = cell[0] + (b & 1), y = cell[1] + (b >> 1 & 1), z = cell[2] + (b >> 2);
        corner[b] = f->samples[(z * f->size[1] + y) * f->size[0] + x];
        low = corner[b] < low ? corner[b] : low;
        high = corner[b] > high ? corner[b] : high;
    }
    if (!sees(r, low, high))
        return false;
    for (int i = 0; i < 4; i++) {
        const real t = t0 + (t1 - t0) * i / 3;
        real s[8];
        for (int b = 0; b < 8; b++)
            s[b] = corner[b];
        for (int a = 0, n = 4; a < 3; a++, n /= 2)
            for (int b = 0; b < n; b++)
                s[b] = s[2 * b] + (o[a] + t * d[a] - (real)cell[a]) * (s[2 * b + 1] - s[2 * b]);
        v[i] = s[0];
    }
    c[0] = v[0];
    c[1] = (-11 * v[0] + 18 * v[1] - 9 * v[2] + 2 * v[3]) / 2;
    c[2] = 9 * (2 * v[0] - 5 * v[1] + 4 * v[2] - v[3]) / 2;
    c[3] = 9 * (-v[0] + 3 * v[1] - 3 * v[2] + v[3]) / 2;
    return true;
}

/* Where a ray passes planes of samples, within the lattice, ascending: how many. */
static int crossings(const field *f, const real o[3], const real d[3], real *t)
{
    real near = 0, far = INFINITY;
    int n = 0;
    for (int a = 0; a < 3; a++) {
        const real first = -o[a] / d[a], last = ((real)(f->size[a] - 1) - o[a]) / d[a];
        near = fmaxl(near, fminl(first, last));
        far = fminl(far, fmaxl(first, last));
    }
    if (!(near < far))
        return 0;
    t[n++] = near;
    for (int a = 0; a < 3; a++)
        for (int64_t i = 0; i < f->size[a]; i++) {
            const real at = ((real)i - o[a]) / d[a];
            if (at > near && at <= far)
                t[n++] = at;
        }
    qsort(t, (size_t)n, sizeof *t, ascending);
    return n;
}

/* o, d [n][3] in index coordinates, no component of d 0; speed [n]: lengths of directions in object
 * space. nodes and weights [16]. out [n][4]: colour and transmittance. False:
 * there is no memory, or there are too many knots. */
bool light_along(const double *samples, const int64_t size[3], int64_t n, const double *o,
                 const double *d, const double *speed, int32_t n_knots, const double *x,
                 const double *y, const double *nodes, const double *weights, double *out)
{
    const field f = {samples, {size[0], size[1], size[2]}};
    real *t = malloc((size_t)(size[0] + size[1] + size[2] + 1) * sizeof *t);
    ramp r;
    if (t == NULL || n_knots > MOST_KNOTS) {
        free(t);
        return false;
    }
    make_ramp(&r, n_knots, x, y);
    for (int64_t i = 0; i < n; i++) {
        const real from[3] = {o[3 * i], o[3 * i + 1], o[3 * i + 2]};
        const real to[3] = {d[3 * i], d[3 * i + 1], d[3 * i + 2]};
        real sum[4] = {0, 0, 0, 1};
        const int count = crossings(&f, from, to, t);
        for (int k = 0; k + 1 < count; k++) {
            real c[4];
            if (t[k + 1] > t[k] && cubic_of(&f, &r, from, to, t[k], t[k + 1], c))
                add_cell(c, &r, (t[k + 1] - t[k]) * speed[i], nodes, weights, sum);
        }
        for (int k = 0; k < 4; k++)
            out[4 * i + k] = (double)sum[k];
    }
    free(t);
    return true;
}
