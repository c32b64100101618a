/* Rays and the triangles of an exact cell.
 *
 * A triangle is intersected in a sheared frame in which the ray is an axis. All in
 * f64: an edge sees the same bits from both of its triangles, so that no ray slips
 * between them, and t does not depend on the cell.
 *
 * Where an exact cell has a cell of the field beside it, the two surfaces meet at
 * their common face, but for what the field may be off. Each face then has one
 * truth: a triangle whose side of the face's point is not that which the samples
 * give there lies, for the ray, on the other side of the face. So it is hit in one of
 * the two cells, even where it lies in the other; no ray slips through a step between
 * the two, and none that left the one is stopped by the other.
 *
 * A ray that left a triangle starts on it but for rounding; it is the side, not the
 * rounding, that tells which triangles around its start are behind it.
 *
 * Source: Woop, Benthin, Wald 2013, Watertight ray/triangle intersection. Departures:
 * 1. f64 throughout, and edges belong to both triangles: no second precision;
 * 2. the whole line is searched, both ways.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/exact.h"

/* What the field beside an exact cell may be off, in voxels: corners that are off by
 * more make a cell exact (voxel/cells.c), which is asked for triangles as near to it as
 * LR_EXACT_NEAR. */
static const double OFF = 0.4;
/* A start on a triangle, after the way to the world and back, lies within: */
static const double START_OFF = 1e-6, START_NEAR = 1e-2;
/* Rays through edges and corners of cells may pass by the cell that holds the hit. */
static const double SLACK = 1e-6;

/* The ray as an axis. */
typedef struct shear {
    int x, y, z;
    double sx, sy, sz;
} shear;

/* A triangle that the ray's line meets. */
typedef struct met {
    double t;
    bool inward;  /* the ray goes in, to f >= T */
    double per_t; /* distance from its plane per unit of t, voxels */
    uint32_t triangle;
} met;

/* Where the ray goes through the cell's face towards a neighbour. */
typedef struct gate {
    double t;
    int axis;
    int32_t beside[3]; /* the neighbour */
    bool open;         /* its field is trusted */
    bool known;        /* the next two are found */
    double value;      /* of the field there, in voxels from the surface */
    double p[3];
} gate;

typedef struct scene {
    const lr_volume *v;
    const lr_ray *r;
    const lr_leaving *leaving;
    const uint32_t *list; /* of the cell's triangles */
    uint32_t n;
    double corner[8]; /* of the cell */
    int32_t c[3];
    gate in, out;
    int carried;      /* side */
    double per_voxel; /* t */
    uint64_t *n_samples;
} scene;

static shear shear_of(const lr_ray *r)
{
    shear s = {.z = 0};
    for (int a = 1; a < 3; a++)
        s.z = fabs(r->d[a]) > fabs(r->d[s.z]) ? a : s.z;
    s.x = (s.z + 1) % 3;
    s.y = (s.z + 2) % 3;
    s.sz = 1.0 / r->d[s.z];
    s.sx = r->d[s.x] * s.sz;
    s.sy = r->d[s.y] * s.sz;
    return s;
}

/* False where the line passes by or lies in the plane. */
static bool meet(const lr_exact *e, const lr_ray *r, const shear *s, uint32_t triangle, met *m)
{
    const double *p[3];
    double x[3], y[3], z[3];
    lr_exact_corners(e, triangle, p);
    for (int c = 0; c < 3; c++) {
        z[c] = p[c][s->z] - r->o[s->z];
        x[c] = p[c][s->x] - r->o[s->x] - s->sx * z[c];
        y[c] = p[c][s->y] - r->o[s->y] - s->sy * z[c];
    }
    const double u = x[2] * y[1] - y[2] * x[1];
    const double v = x[0] * y[2] - y[0] * x[2];
    const double w = x[1] * y[0] - y[1] * x[0];
    if ((u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0))
        return false;
    const double sum = u + v + w;
    if (sum == 0.0)
        return false;
    m->t = (u * z[0] + v * z[1] + w * z[2]) * s->sz / sum;
    m->inward = (sum > 0.0) == (s->sz > 0.0);
    m->triangle = triangle;
    return true;
}

static double plane_speed(const scene *s, uint32_t triangle)
{
    double n[3];
    lr_exact_normal(s->v->exact, triangle, n);
    return fabs(lr_dot(n, s->r->d)) / sqrt(lr_dot(n, n));
}

static void point_at(const lr_ray *r, double t, double q[3])
{
    for (int a = 0; a < 3; a++)
        q[a] = r->s[a] == 0 ? r->o[a] : r->o[a] + t * r->d[a];
}

/* ---- faces ------------------------------------------------------------- */

static gate gate_at(const scene *s, int axis, double t, int step)
{
    const lr_volume *v = s->v;
    gate g = {.t = t, .axis = axis};
    memcpy(g.beside, s->c, sizeof g.beside);
    g.beside[axis] += step;
    const int32_t n[3] = {v->desc.nx, v->desc.ny, v->desc.nz};
    g.open = g.beside[axis] >= 1 && g.beside[axis] <= n[axis] + 1 && lr_is_trusted(v, g.beside);
    return g;
}

static void find_gates(scene *s, const lr_ray *r, double t_start)
{
    int in = 0, out;
    double t_in = -INFINITY;
    for (int a = 0; a < 3; a++) {
        const double t = lr_plane_t(r, LR_EVEN, a, s->c[a] + (r->s[a] < 0));
        if (r->s[a] != 0 && t > t_in) {
            t_in = t;
            in = a;
        }
    }
    const double t_out = lr_exit_t(r, LR_EVEN, s->c, s->c, &out);
    s->out = gate_at(s, out, t_out, r->s[out]);
    s->in = t_in > t_start ? gate_at(s, in, t_in, -r->s[in]) : (gate){.t = t_start};
}

/* The field's distance from the surface at the face, in voxels, positive inside: from
 * the face's own samples, as the cell beside it takes it. */
static double value_at(scene *s, gate *g)
{
    if (!g->known) {
        double p[3];
        point_at(s->r, g->t, g->p);
        for (int a = 0; a < 3; a++)
            p[a] = lr_clamp(g->p[a] - s->c[a], 0.0, 1.0);
        const double f = lr_face_value(s->corner, g->axis, g->beside[g->axis] > s->c[g->axis], p);
        g->value = (f - s->v->threshold) * s->v->exact->voxels_per_value;
        g->known = true;
        ++*s->n_samples;
    }
    return g->value;
}

/* Does the ray meet the triangle after the face? side: on which the ray passes the
 * face, if that is known better than by the field there, else 0. */
static bool after(scene *s, gate *g, int side, const met *m)
{
    const bool later = m->t > g->t;
    const double height = fabs(m->t - g->t) * m->per_t;
    if (!g->open || height > OFF)
        return later;
    const double value = side != 0 ? 0.0 : value_at(s, g);
    const bool by_field = side != 0 ? side > 0 : value >= 0.0;
    const bool by_triangle = later != m->inward; /* inside? */
    if (by_field == by_triangle || fabs(value) + height > OFF ||
        lr_exact_distance2(s->v->exact, m->triangle, g->p) > LR_EXACT_NEAR * LR_EXACT_NEAR)
        return later;
    return !later;
}

/* ---- the cell ---------------------------------------------------------- */

/* Does another triangle that the ray leaves, to its own side, hide this one at the start?
 * So it does over a convex edge: nothing of this one rises over its plane. */
static bool is_hidden(const scene *s, uint32_t triangle)
{
    const lr_exact *e = s->v->exact;
    double start[3];
    const double *p[3], *q[3];
    point_at(s->r, s->leaving->t, start);
    lr_exact_corners(e, triangle, p);
    for (uint32_t i = 0; i < s->n; i++) {
        double n[3], highest = -INFINITY;
        lr_exact_normal(e, s->list[i], n);
        if (s->list[i] == triangle || !(lr_dot(n, s->r->d) * s->leaving->side < 0.0) ||
            lr_exact_distance2(e, s->list[i], start) > START_OFF * START_OFF)
            continue;
        lr_exact_corners(e, s->list[i], q);
        for (int c = 0; c < 3; c++) {
            const double from[3] = {p[c][0] - q[0][0], p[c][1] - q[0][1], p[c][2] - q[0][2]};
            highest = fmax(highest, -s->leaving->side * lr_dot(n, from));
        }
        if (highest <= START_OFF * sqrt(lr_dot(n, n)))
            return true;
    }
    return false;
}

/* Is this the triangle that the ray left, where the field stood for it? The field may be
 * off, and so the ray may cross the triangle again, to the side on which it is already. */
static bool is_left(const scene *s, const met *m)
{
    double start[3];
    if (m->inward == (s->leaving->side < 0) || lr_is_exact(s->v, s->leaving->cell))
        return false;
    point_at(s->r, s->leaving->t, start);
    return lr_exact_distance2(s->v->exact, m->triangle, start) <= LR_EXACT_NEAR * LR_EXACT_NEAR;
}

/* Is the triangle in front of the ray's start? Moves a hit that rounding has put
 * behind the start onto it. */
static bool in_front(const scene *s, met *m)
{
    const double ahead = (m->t - s->leaving->t) / s->per_voxel;
    if (s->leaving->side == 0 || fabs(m->t - s->leaving->t) * m->per_t > START_OFF ||
        ahead < -START_NEAR)
        return ahead >= 0.0 && (s->leaving->side == 0 || !is_left(s, m));
    m->t = ahead >= 0.0 ? m->t : s->leaving->t;
    return m->inward == (s->leaving->side < 0) && !is_hidden(s, m->triangle);
}

static bool accept(scene *s, met *m)
{
    m->per_t = plane_speed(s, m->triangle);
    if (!in_front(s, m))
        return false;
    const double slack = SLACK * s->per_voxel;
    if (s->in.open ? !after(s, &s->in, s->carried, m) : m->t < s->in.t - slack)
        return false;
    return s->out.open ? !after(s, &s->out, 0, m) : m->t <= s->out.t + slack;
}

/* A ray that left a triangle may find itself, by the field beside the cell, on the
 * wrong side of it; then the side goes with it. */
static int hand_on(scene *s)
{
    const int side = s->leaving->side;
    if (side == 0 || !s->out.open)
        return 0;
    const double value = value_at(s, &s->out), gone = s->out.t - s->leaving->t;
    if ((value >= 0.0) == (side > 0))
        return 0;
    double start[3];
    point_at(s->r, s->leaving->t, start);
    for (uint32_t i = 0; i < s->n; i++)
        if (fabs(value) + gone * plane_speed(s, s->list[i]) <= OFF &&
            lr_exact_distance2(s->v->exact, s->list[i], start) <= START_OFF * START_OFF &&
            lr_exact_distance2(s->v->exact, s->list[i], s->out.p) <= LR_EXACT_NEAR * LR_EXACT_NEAR)
            return 2 * side;
    return 0;
}

/* A triangle that is met beyond the cell lies in one where a ray may start, if that is a
 * surface cell. */
static void locate(const lr_volume *v, const lr_ray *r, double t, const int32_t c[3],
                   lr_found *found)
{
    double q[3];
    int32_t there[3];
    bool inside = true, same = true;
    point_at(r, t, q);
    for (int a = 0; a < 3; a++) {
        there[a] =
            q[a] >= c[a] && q[a] <= c[a] + 1.0 ? c[a] : (int32_t)lr_clamp(floor(q[a]), 0, 1 << 24);
        same = same && there[a] == c[a];
        inside = inside && there[a] >= v->surface_lo[a] && there[a] <= v->surface_hi[a];
    }
    memcpy(found->c, !same && inside && lr_wanted(v, there) ? there : c, sizeof found->c);
    for (int a = 0; a < 3; a++)
        found->p[a] = lr_clamp(q[a] - found->c[a], 0.0, 1.0);
}

bool lr_hit_exact(const lr_volume *v, const lr_ray *r, const lr_cursor *u,
                  const lr_leaving *leaving, const lr_trace_options *options, int *side,
                  lr_found *found, uint64_t *n_samples)
{
    scene s = {.v = v, .r = r, .leaving = leaving, .n_samples = n_samples};
    memcpy(s.c, u->c, sizeof s.c);
    lr_corners(v, s.c, s.corner);
    s.per_voxel = 1.0 / sqrt(lr_dot(r->d, r->d));
    find_gates(&s, r, leaving->t);
    s.carried = abs(*side) > 1 ? *side : 0;
    const shear frame = shear_of(r);
    met best = {.t = INFINITY};
    s.list = lr_exact_list(v, s.c, &s.n);
    for (uint32_t i = 0; i < s.n; i++) {
        met m;
        if (meet(v->exact, r, &frame, s.list[i], &m) && m.t < best.t && accept(&s, &m) &&
            m.t < best.t)
            best = m;
    }
    const int start = *side;
    *side = 0;
    if (best.t < INFINITY) {
        found->t = best.t;
        found->triangle = best.triangle;
        found->object = LR_NO_OBJECT;
        locate(v, r, best.t, s.c, found);
        return best.t <= r->t_max;
    }
    if (v->desc.kind == LR_KIND_SOLID && start == 0 && s.in.open && s.out.open &&
        (value_at(&s, &s.in) >= 0.0) != (value_at(&s, &s.out) >= 0.0)) {
        found->triangle = LR_NO_TRIANGLE; /* where a solid's mesh has a hole */
        found->object = LR_NO_OBJECT;
        return lr_hit_cell(v, r, LR_EVEN, u, 0, options, found, n_samples);
    }
    *side = hand_on(&s);
    return false;
}

int lr_handed_on(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int side,
                 uint64_t *n_samples)
{
    int axis;
    double corner[8], p[3];
    const double t = lr_exit_t(r, LR_EVEN, u->c, u->c, &axis);
    lr_corners(v, u->c, corner);
    point_at(r, t, p);
    for (int a = 0; a < 3; a++)
        p[a] = lr_clamp(p[a] - u->c[a], 0.0, 1.0);
    ++*n_samples;
    const double f = lr_face_value(corner, axis, r->s[axis] > 0, p);
    const double value = (f - v->threshold) * v->exact->voxels_per_value;
    if ((value >= 0.0) == (side > 0))
        return side;
    return fabs(value) <= OFF ? LR_STILL : 0;
}

bool lr_starts_off(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int side)
{
    double corner[8], p[3];
    lr_corners(v, u->c, corner);
    point_at(r, u->t, p);
    for (int a = 0; a < 3; a++)
        p[a] = lr_clamp(p[a] - u->c[a], 0.0, 1.0);
    const double value =
        (lr_trilinear(corner, p) - v->threshold) * v->exact->voxels_per_value * side;
    return value < -START_OFF && value >= -OFF;
}
