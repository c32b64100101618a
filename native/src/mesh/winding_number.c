/* The generalised winding number by a hierarchy of dipoles.
 *
 * The winding number is the sum of the triangles' solid angles over 4 pi. At a
 * distance, the triangles of a node count as one dipole: the sum of their area vectors at
 * their common centre. The hierarchy halves the list of triangles, which are sorted along a
 * Morton curve.
 *
 * Source: Barill, Dickson, Schmidt, Levin, Jacobson 2018, Fast winding numbers
 * for soups and clouds; van Oosterom and Strackee 1983 for the solid angle.
 * Departures: 1. dipoles only, the first term of their series, from twice the
 * node's radius on; 2. a binary tree by count, so that it needs no links.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/pages.h"
#include "mesh/winding_number.h"

enum {
    LEAF = 8, /* triangles of a leaf, at most */
    POLL = 1 << 14,
    DIGIT = 1 << 11, /* of the radix sort: two passes sort 22 bits */
    AXIS_BITS = 7
};

#define FAR  2.0
#define FINE 6.25 /* squared: dipoles from five times the radius on, a sixth of the error */

/* ---- order ------------------------------------------------------------- */

static uint32_t spread(uint32_t x)
{
    uint32_t out = 0;
    for (int bit = 0; bit < AXIS_BITS; bit++)
        out |= (x >> bit & 1) << (3 * bit);
    return out;
}

static uint32_t morton(const lr_topology *m, uint32_t t, const double lo[3], const double scale[3],
                       const uint32_t *spread_of)
{
    double p[3][3];
    uint32_t code = 0;
    lr_triangle(m, t, p);
    for (int a = 0; a < 3; a++) {
        double at = (p[0][a] + p[1][a] + p[2][a]) / 3.0;
        int32_t cell = (int32_t)lr_clamp((at - lo[a]) * scale[a], 0.0, (1 << AXIS_BITS) - 1);
        code |= spread_of[cell] << a;
    }
    return code;
}

/* One pass of a stable counting sort by a digit of key; false where stopped. */
static bool sort_pass(const uint32_t *key, int shift, const uint32_t *in, uint32_t n, uint32_t *out,
                      const lr_watch *watch)
{
    uint32_t count[DIGIT] = {0}, sum = 0;
    for (uint32_t i = 0; i < n; i++)
        count[key[in[i]] >> shift & (DIGIT - 1)]++;
    for (int d = 0; d < DIGIT; d++) {
        uint32_t here = count[d];
        count[d] = sum;
        sum += here;
    }
    for (uint32_t i = 0; i < n; i++) {
        if (i % POLL == 0 && lr_stopped(watch))
            return false;
        out[count[key[in[i]] >> shift & (DIGIT - 1)]++] = in[i];
    }
    return true;
}

/* List the triangles that count, in Morton order. key and other have room for all. */
static bool order(lr_winding *w, uint32_t *key, uint32_t *other, const lr_watch *watch)
{
    const lr_topology *m = w->mesh;
    uint32_t spread_of[1 << AXIS_BITS];
    double lo[3], scale[3];
    for (uint32_t i = 0; i < 1 << AXIS_BITS; i++)
        spread_of[i] = spread(i);
    for (int a = 0; a < 3; a++) {
        lo[a] = m->lo[a] * m->per_unit - m->origin[a];
        double size = (m->hi[a] - m->lo[a]) * m->per_unit;
        scale[a] = size > 0.0 ? (1 << AXIS_BITS) / size : 0.0;
    }
    for (uint32_t t = 0; t < m->source.n_triangles; t++) {
        if (t % POLL == 0 && lr_stopped(watch))
            return false;
        if (!lr_counts(m, t))
            continue;
        key[t] = morton(m, t, lo, scale, spread_of);
        w->list[w->n++] = t;
    }
    return sort_pass(key, 0, w->list, w->n, other, watch) &&
           sort_pass(key, 11, other, w->n, w->list, watch);
}

/* ---- hierarchy --------------------------------------------------------- */

typedef struct extent {
    double lo[3], hi[3], area, moment[3], normal[3];
} extent;

static void add_triangle(const lr_topology *m, uint32_t t, extent *e)
{
    double p[3][3], n[3];
    lr_triangle(m, t, p);
    if (!lr_cross_of((const double (*)[3])p, n))
        return;
    double area = 0.5 * sqrt(lr_dot(n, n));
    e->area += area;
    for (int a = 0; a < 3; a++) {
        e->lo[a] = fmin(e->lo[a], fmin(fmin(p[0][a], p[1][a]), p[2][a]));
        e->hi[a] = fmax(e->hi[a], fmax(fmax(p[0][a], p[1][a]), p[2][a]));
        e->moment[a] += area * (p[0][a] + p[1][a] + p[2][a]) / 3.0;
        e->normal[a] += 0.5 * n[a];
    }
}

static void add_extent(const extent *of, extent *e)
{
    e->area += of->area;
    for (int a = 0; a < 3; a++) {
        e->lo[a] = fmin(e->lo[a], of->lo[a]);
        e->hi[a] = fmax(e->hi[a], of->hi[a]);
        e->moment[a] += of->moment[a];
        e->normal[a] += of->normal[a];
    }
}

/* False where stopped. */
static bool build(lr_winding *w, size_t at, uint32_t first, uint32_t n, const lr_watch *watch,
                  extent *e)
{
    lr_winding_node *node = &w->nodes[at];
    *e = (extent){.lo = {INFINITY, INFINITY, INFINITY}, .hi = {-INFINITY, -INFINITY, -INFINITY}};
    if (n <= LEAF) {
        for (uint32_t i = first; i < first + n; i++)
            add_triangle(w->mesh, w->list[i], e);
    } else {
        extent half;
        uint32_t left = n / 2;
        if ((n > 1024 && lr_stopped(watch)) || !build(w, 2 * at + 1, first, left, watch, e) ||
            !build(w, 2 * at + 2, first + left, n - left, watch, &half))
            return false;
        add_extent(&half, e);
    }
    *node = (lr_winding_node){.first = first, .n = n};
    double r2 = 0.0;
    for (int a = 0; a < 3 && e->area > 0.0; a++) {
        node->centre[a] = e->moment[a] / e->area;
        node->normal[a] = e->normal[a];
        double r = fmax(e->hi[a] - node->centre[a], node->centre[a] - e->lo[a]);
        r2 += r * r;
    }
    node->far2 = e->area > 0.0 ? FAR * FAR * r2 : -1.0;
    return true;
}

/* Nodes of a tree over n triangles, with gaps. */
static size_t tree_size(uint32_t n)
{
    size_t size = 1;
    for (uint32_t largest = n; largest > LEAF; largest -= largest / 2)
        size = 2 * size + 1;
    return size;
}

lr_status lr_winding_make(const lr_topology *mesh, const lr_watch *watch, lr_winding *w,
                          lr_error *error)
{
    size_t n = mesh->source.n_triangles, n_nodes = tree_size((uint32_t)n);
    extent whole;
    *w = (lr_winding){.mesh = mesh};
    w->list = lr_pages_new(n, sizeof *w->list);
    w->nodes = lr_pages_new(n_nodes, sizeof *w->nodes);
    uint32_t *key = lr_pages_new(n, sizeof *key), *other = lr_pages_new(n, sizeof *other);
    lr_status status = LR_OK;
    if (w->list == NULL || w->nodes == NULL || key == NULL || other == NULL)
        status =
            lr_fail_memory(error, n * 12 + n_nodes * sizeof *w->nodes, "the mesh's winding number");
    else if (!order(w, key, other, watch) || !build(w, 0, 0, w->n, watch, &whole))
        status = lr_fail_stopped(error);
    lr_pages_free(key);
    lr_pages_free(other);
    return status;
}

void lr_winding_free(lr_winding *w)
{
    lr_pages_free(w->list);
    lr_pages_free(w->nodes);
    *w = (lr_winding){0};
}

uint64_t lr_winding_nbytes(const lr_winding *w)
{
    return w->nodes == NULL
               ? 0
               : w->mesh->source.n_triangles * sizeof *w->list +
                     tree_size((uint32_t)w->mesh->source.n_triangles) * sizeof *w->nodes;
}

/* ---- query ------------------------------------------------------------- */

/* Add c times the change of the solid angle that the edge from a to b makes, both seen from
 * the point: Biot and Savart's field of a current along it. */
LR_INLINE void add_edge(const double a[3], double a_length, const double b[3], double b_length,
                        double c, double gradient[3])
{
    double cross[3];
    const double product = a_length * b_length, below = product * (product + lr_dot(a, b));
    if (!(below > 0.0)) /* on the edge itself */
        return;
    lr_cross_product(a, b, cross);
    for (int i = 0; i < 3; i++)
        gradient[i] += c * (a_length + b_length) / below * cross[i];
}

/* Solid angle over 4 pi. */
LR_INLINE double solid_angle_of(const lr_topology *m, uint32_t t, const double at[3],
                                double *gradient)
{
    double p[3][3], length[3], cross[3];
    lr_triangle(m, t, p);
    for (int c = 0; c < 3; c++) {
        lr_sub(p[c], at, p[c]);
        length[c] = sqrt(lr_dot(p[c], p[c]));
    }
    lr_cross_product(p[1], p[2], cross);
    double above = lr_dot(p[0], cross);
    double below = length[0] * length[1] * length[2] + lr_dot(p[0], p[1]) * length[2] +
                   lr_dot(p[1], p[2]) * length[0] + lr_dot(p[2], p[0]) * length[1];
    for (int e = 0; gradient != NULL && e < 3; e++) {
        const int next = (e + 1) % 3;
        add_edge(p[e], length[e], p[next], length[next], -1.0 / (4.0 * LR_PI), gradient);
    }
    return above == 0.0 ? 0.0 : atan2(above, below) / (2.0 * LR_PI);
}

LR_INLINE double dipole(const lr_winding_node *node, const double to[3], double d2,
                        double *gradient)
{
    const double d = sqrt(d2), scale = 1.0 / (4.0 * LR_PI * d2 * d),
                 along = lr_dot(node->normal, to);
    for (int a = 0; gradient != NULL && a < 3; a++)
        gradient[a] += scale * (3.0 * along / d2 * to[a] - node->normal[a]);
    return scale * along;
}

/* fine: how much farther than far2 a node has to be. */
LR_INLINE double sum_at(const lr_winding *w, const double p[3], double fine, double *gradient)
{
    uint32_t open[64]; /* the tree is at most 30 deep, and each level leaves one */
    int n_open = 0;
    double sum = 0.0;
    open[n_open++] = 0;
    while (n_open > 0) {
        uint32_t at = open[--n_open];
        const lr_winding_node *node = &w->nodes[at];
        double to[3];
        lr_sub(node->centre, p, to);
        double d2 = lr_dot(to, to);
        if (d2 > fine * node->far2) {
            sum += node->far2 < 0.0 ? 0.0 : dipole(node, to, d2, gradient);
        } else if (node->n <= LEAF) {
            for (uint32_t i = node->first; i < node->first + node->n; i++)
                sum += solid_angle_of(w->mesh, w->list[i], p, gradient);
        } else {
            open[n_open++] = 2 * at + 1;
            open[n_open++] = 2 * at + 2;
        }
    }
    return sum;
}

double lr_winding_at(const lr_winding *w, const double p[3])
{
    return sum_at(w, p, 1.0, NULL);
}

double lr_winding_slope(const lr_winding *w, const double p[3], bool fine, double gradient[3])
{
    memset(gradient, 0, 3 * sizeof *gradient);
    return sum_at(w, p, fine ? FINE : 1.0, gradient);
}
