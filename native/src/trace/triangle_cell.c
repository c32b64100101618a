/* Rays and the triangles of a triangle cell.
 *
 * A triangle is intersected in a sheared frame in which the ray is an axis. All in
 * f64: an edge sees the same bits from both of its triangles, so that no ray slips
 * between them, and t does not depend on the cell.
 *
 * Where a triangle cell has a cell of the field beside it, the two surfaces meet at
 * their common face, but for what the field may be off. Each face then has one
 * truth: a triangle whose side of the face's point is not that which the samples
 * give there lies, for the ray, on the other side of the face. So it is hit in one of
 * the two cells, even where it lies in the other; no ray slips through a step between
 * the two, and none that left the one is stopped by the other.
 *
 * A ray that left a triangle starts on its side of that, and of others there
 * (trace/start_side.c), so that none behind it is met.
 *
 * It keeps that side until it meets a surface. Where it leaves the cell on the other side
 * all the same, the field is off, and the side is handed on (trace/carried_side.c), or the ray has
 * gone by an edge by rounding and is stopped there: no ray leaves a solid unseen.
 *
 * Source: Woop, Benthin, Wald 2013, Watertight ray/triangle intersection. Departures:
 * 1. f64 throughout, and edges belong to both triangles: no second precision;
 * 2. the whole line is searched, both ways.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/triangle_cell.h"

#include "trace/cell_common.h"

/* Squares of distances from an edge or a corner, over the triangles that share it, agree but for
 * so much of them. */
static const double TIE = 1e-6;
/* A ray that has gone by an edge by rounding did so by no more than so many times what a start may
 * be off. */
static const double SLIP = 4.0;
/* Where the field agrees by less, in voxels, it may change its mind at once. */
static const double BARELY = 1e-4;
/* Rays through edges and corners of cells may pass by the cell that holds the hit. */
static const double SLACK = 1e-6;

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
    double off;       /* of the start, from triangles that it lies on */
    bool beyond;      /* the ray starts in the cell, on a triangle where that sticks out of it */
    bool behind;      /* the ray has left the cell before it starts */
    double per_voxel; /* t */
    uint64_t *n_samples;
} scene;

LR_INLINE double lesser(double a, double b)
{
    return a < b ? a : b;
}

LR_INLINE double greater(double a, double b)
{
    return a > b ? a : b;
}

/* False where the line passes by or lies in the plane. */
static bool meet(const lr_triangle_cells *e, const lr_ray *r, const lr_shear *s, uint32_t triangle,
                 met *m)
{
    const double *p[3];
    double x[3], y[3], z[3];
    lr_triangle_cell_corners(e, triangle, p);
    for (int c = 0; c < 3; c++) {
        z[c] = p[c][s->z] - r->o[s->z];
        x[c] = p[c][s->x] - r->o[s->x] - s->sx * z[c];
        y[c] = p[c][s->y] - r->o[s->y] - s->sy * z[c];
    }
    const double u = x[2] * y[1] - y[2] * x[1];
    const double v = x[0] * y[2] - y[0] * x[2];
    const double w = x[1] * y[0] - y[1] * x[0];
    const double least = lesser(lesser(u, v), w), most = greater(greater(u, v), w);
    if (least < 0.0 && most > 0.0) /* one branch, which nearly all take */
        return false;
    const double sum = u + v + w;
    if (sum == 0.0)
        return false;
    m->t = (u * z[0] + v * z[1] + w * z[2]) * s->sz / sum;
    m->inward = (sum > 0.0) == (s->sz > 0.0);
    m->triangle = triangle;
    return true;
}

static double plane_speed(const lr_volume *v, const lr_ray *r, uint32_t triangle)
{
    double n[3];
    lr_triangle_cell_normal(v->triangle_cells, triangle, n);
    return lr_plane_speed(r, n);
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
        const double t = lr_plane_t(r, LR_REGULAR, a, s->c[a] + (r->s[a] < 0));
        if (r->s[a] != 0 && t > t_in) {
            t_in = t;
            in = a;
        }
    }
    const double t_out = lr_exit_t(r, LR_REGULAR, s->c, s->c, &out);
    s->behind = t_out < t_start - SLACK * s->per_voxel;
    s->out = gate_at(s, out, fmax(t_out, t_start), r->s[out]);
    s->in = t_in > t_start ? gate_at(s, in, t_in, -r->s[in]) : (gate){.t = t_start};
}

/* The field's distance from the surface at the face, in voxels, positive inside: from
 * the face's own samples, as the cell beside it takes it. */
static double value_at(scene *s, gate *g)
{
    if (!g->known) {
        double p[3];
        lr_point_at(s->r, g->t, g->p);
        for (int a = 0; a < 3; a++)
            p[a] = lr_clamp(g->p[a] - s->c[a], 0.0, 1.0);
        const double f = lr_face_value(s->corner, g->axis, g->beside[g->axis] > s->c[g->axis], p);
        g->value = (f - s->v->threshold) * s->v->triangle_cells->voxels_per_value;
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
    if (!g->open || height > LR_FIELD_OFF)
        return later;
    const double by_samples = value_at(s, g), value = side != 0 ? 0.0 : by_samples;
    const bool by_field = side != 0 ? side > 0 : value >= 0.0;
    const bool by_triangle = later != m->inward; /* inside? */
    if (by_field == by_triangle || fabs(value) + height > LR_FIELD_OFF ||
        lr_triangle_cell_distance2(s->v->triangle_cells, m->triangle, g->p) >
            LR_EXACT_NEAR * LR_EXACT_NEAR)
        return later;
    return !later;
}

/* ---- the cell ---------------------------------------------------------- */

/* Is this the triangle that the ray left, where the field stood for it? The field may be
 * off, and so the ray may cross the triangle again, to the side on which it is already. */
static bool is_left(const scene *s, const met *m)
{
    double start[3];
    if (m->inward == (s->leaving->side < 0) || lr_is_triangle_cell(s->v, s->leaving->cell))
        return false;
    lr_point_at(s->r, s->leaving->t, start);
    return lr_triangle_cell_distance2(s->v->triangle_cells, m->triangle, start) <=
           LR_EXACT_NEAR * LR_EXACT_NEAR;
}

/* Is the triangle in front of the ray's start? There, the ray goes through triangles only away
 * from its side, but where they are wound against each other. */
static bool in_front(const scene *s, const met *m)
{
    if (!(m->t >= s->leaving->t))
        return false;
    if (s->leaving->side == 0)
        return true;
    return fabs(m->t - s->leaving->t) * m->per_t <= s->off ? m->inward == (s->leaving->side < 0)
                                                           : !is_left(s, m);
}

/* The angle of a triangle at the corner where a point is nearest to it, by the square of its
 * distance; 1 where it is nearest to no corner. */
static double angle_at(const double *const p[3], const double q[3], double square)
{
    for (int c = 0; c < 3; c++) {
        double from[3], a[3], b[3];
        for (int i = 0; i < 3; i++) {
            from[i] = q[i] - p[c][i];
            a[i] = p[(c + 1) % 3][i] - p[c][i];
            b[i] = p[(c + 2) % 3][i] - p[c][i];
        }
        if (lr_dot(from, from) <= (1.0 + TIE) * square)
            return acos(lr_clamp(lr_dot(a, b) / sqrt(lr_dot(a, a) * lr_dot(b, b)), -1.0, 1.0));
    }
    return 1.0;
}

/* By how much a point is on the ray's side of the cell's triangles: how far it is from them, less
 * than 0 on the other side; NaN where none is near. Of those that share the nearest edge or corner
 * none need tell alone: their normals, weighted by their angles there, do; and `triangle` is the
 * one that is seen most from the front or the back.
 *
 * Source: Baerentzen, Aanaes 2005, Signed distance computation using the angle weighted
 * pseudonormal. */
static double height_at(const scene *s, const double q[3], uint32_t *triangle)
{
    const lr_triangle_cells *e = s->v->triangle_cells;
    double best = LR_EXACT_NEAR * LR_EXACT_NEAR, sum = 0.0, most = -1.0;
    bool any = false;
    for (uint32_t i = 0; i < s->n; i++) {
        const double square = lr_triangle_cell_distance2(e, s->list[i], q);
        any = any || square <= best;
        best = fmin(best, square);
    }
    for (uint32_t i = 0; i < s->n && any; i++) {
        if (!(lr_triangle_cell_distance2(e, s->list[i], q) <= (1.0 + TIE) * best))
            continue;
        const double *p[3];
        double n[3];
        lr_triangle_cell_corners(e, s->list[i], p);
        lr_triangle_cell_normal(e, s->list[i], n);
        const double from[3] = {q[0] - p[0][0], q[1] - p[0][1], q[2] - p[0][2]};
        const double h = -s->leaving->side * lr_dot(n, from) / sqrt(lr_dot(n, n));
        sum += angle_at(p, q, best) * h;
        if (fabs(h) > most) {
            most = fabs(h);
            *triangle = s->list[i];
        }
    }
    return any ? copysign(sqrt(best), sum) : NAN;
}

/* Is the ray within LR_EXACT_NEAR of the cell at t, where the list has every triangle? */
static bool is_near(const scene *s, double t)
{
    double q[3];
    bool near = true;
    lr_point_at(s->r, t, q);
    for (int a = 0; a < 3; a++)
        near = near && fabs(q[a] - s->c[a] - 0.5) <= 0.5 + LR_EXACT_NEAR;
    return near;
}

static bool starts_beyond(const scene *s, const lr_cursor *u)
{
    double q[3];
    bool within = true;
    lr_point_at(s->r, s->leaving->t, q);
    for (int a = 0; a < 3; a++)
        within = within && fabs(q[a] - s->c[a] - 0.5) <= 0.5 + SLACK;
    return u->axis < 0 && s->leaving->side != 0 && !within;
}

static bool accept(scene *s, met *m)
{
    m->per_t = plane_speed(s->v, s->r, m->triangle);
    if (!in_front(s, m))
        return false;
    const double slack = SLACK * s->per_voxel;
    const bool stops = m->inward == (s->leaving->side < 0);
    if (s->beyond && stops && is_near(s, m->t))
        return true; /* the field beside the cell knows nothing of what sticks out of it */
    if (s->carried != 0 && stops && s->v->desc.kind == LR_KIND_SOLID)
        ; /* where the field before the cell stood for it, or later */
    else if (s->in.open ? !after(s, &s->in, s->carried, m) : m->t < s->in.t - slack)
        return false;
    return s->out.open ? !after(s, &s->out, 0, m) : m->t <= s->out.t + slack;
}

/* Was the ray on its side of the triangles, or of the field before them, where it came into the
 * cell or starts in it? If it left the field's own surface, that may lie beside them. */
static bool comes_from_inside(scene *s)
{
    uint32_t triangle;
    double q[3];
    if (!lr_is_triangle_cell(s->v, s->leaving->cell))
        return false;
    if (s->in.open && (value_at(s, &s->in) >= 0.0) == (s->leaving->side > 0))
        return true;
    lr_point_at(s->r, fmax(s->in.t, s->leaving->t), q);
    return !(height_at(s, q, &triangle) < -s->off);
}

/* Does the ray go away from the triangle, to its own side? */
static bool leads_in(const scene *s, uint32_t triangle, double height)
{
    double n[3];
    if (isnan(height))
        return false;
    lr_triangle_cell_normal(s->v->triangle_cells, triangle, n);
    return lr_dot(n, s->r->d) * s->leaving->side < 0.0;
}

/* Has the field beyond the face the outside where the triangle has it? */
static bool is_wound_well(const scene *s, const gate *at, uint32_t triangle)
{
    double n[3], corner[8], g[3], p[3];
    lr_triangle_cell_normal(s->v->triangle_cells, triangle, n);
    for (int a = 0; a < 3; a++)
        p[a] = lr_clamp(at->p[a] - at->beside[a], 0.0, 1.0);
    lr_corners(s->v, at->beside, corner);
    lr_trilinear_gradient(corner, p, g);
    return lr_dot(n, g) <= 0.0;
}

/* Is a triangle of a sheet, which the ray left, still beside it where it leaves the cell? */
static bool is_beside(const scene *s, double value)
{
    const lr_triangle_cells *e = s->v->triangle_cells;
    const double gone = s->out.t - s->leaving->t;
    double start[3];
    lr_point_at(s->r, s->leaving->t, start);
    for (uint32_t i = 0; i < s->n; i++)
        if (fabs(value) + gone * plane_speed(s->v, s->r, s->list[i]) <= LR_FIELD_OFF &&
            lr_triangle_cell_distance2(e, s->list[i], start) <= s->off * s->off &&
            lr_triangle_cell_distance2(e, s->list[i], s->out.p) <= LR_EXACT_NEAR * LR_EXACT_NEAR)
            return true;
    return false;
}

/* What becomes of the side on which a ray left a surface and has met nothing in the cell. */
typedef enum lost {
    LR_AGREES, /* the field says the same beyond it, or the side may be wrong */
    LR_ASTRAY, /* it says the other, or barely the same, and may be off by so much: the side is
                  handed on */
    LR_PASSED, /* it says the other, and is right: the surface has been passed */
    LR_SLIPPED /* it says the other, and no triangle is near: the ray may have gone by an edge by
                  rounding */
} lost;

/* Did a ray that left a triangle come through the face on its side, by the field, but beyond the
 * triangles there? The two are off by so much, and it has passed the surface in cells of the field,
 * which had it further on. */
static bool passed_before(scene *s)
{
    uint32_t triangle = 0;
    if (!s->in.open || !lr_is_triangle_cell(s->v, s->leaving->cell) ||
        (value_at(s, &s->in) >= 0.0) != (s->leaving->side > 0) || fabs(s->in.value) > LR_FIELD_OFF)
        return false;
    const double height = height_at(s, s->in.p, &triangle);
    return height < -s->off && fabs(s->in.value) - height <= LR_FIELD_OFF &&
           is_wound_well(s, &s->in, triangle);
}

static lost lose(scene *s)
{
    const lr_volume *v = s->v;
    if (v->desc.kind == LR_KIND_SOLID && passed_before(s))
        return LR_PASSED;
    const double value = value_at(s, &s->out);
    const bool agrees = (value >= 0.0) == (s->leaving->side > 0);
    if (agrees && s->carried == 0 && !(fabs(value) < BARELY))
        return LR_AGREES;
    const bool further = lr_holds_surface(v, s->out.beside), told = s->out.open || !further;
    if (v->desc.kind != LR_KIND_SOLID)
        return s->out.open && !agrees && is_beside(s, value) ? LR_ASTRAY : LR_AGREES;
    if (agrees && s->carried == 0)
        return s->out.open && further ? LR_ASTRAY : LR_AGREES;
    if (agrees)
        return told ? LR_AGREES : LR_ASTRAY;
    uint32_t triangle = 0;
    const double height = height_at(s, s->out.p, &triangle);
    if (height < -s->off)
        return s->carried != 0 || comes_from_inside(s) ? LR_PASSED : LR_AGREES;
    if (isnan(height) && s->carried == 0)
        return LR_SLIPPED; /* no triangle is near any more */
    if (!told)
        return s->carried != 0 ? LR_ASTRAY : LR_AGREES;
    /* of a triangle that is wound inside out the side is wrong, but not of the field */
    if (!isnan(height) &&
        !(fabs(value) + height <= LR_FIELD_OFF && is_wound_well(s, &s->out, triangle)))
        return LR_AGREES;
    if (fabs(value) > LR_FIELD_OFF)
        return LR_PASSED;
    return further || leads_in(s, triangle, height) ? LR_ASTRAY : LR_PASSED;
}

/* A triangle that is met beyond the cell lies in one where a ray may start, if that is a
 * surface cell. */
static void locate(const lr_volume *v, const lr_ray *r, double t, const int32_t c[3],
                   lr_found *found)
{
    double q[3];
    int32_t there[3];
    bool same = true;
    lr_point_at(r, t, q);
    for (int a = 0; a < 3; a++) {
        there[a] =
            q[a] >= c[a] && q[a] <= c[a] + 1.0 ? c[a] : (int32_t)lr_clamp(floor(q[a]), 0, 1 << 24);
        same = same && there[a] == c[a];
    }
    memcpy(found->c, !same && lr_holds_surface(v, there) ? there : c, sizeof found->c);
    for (int a = 0; a < 3; a++)
        found->p[a] = lr_clamp(q[a] - found->c[a], 0.0, 1.0);
}

/* The surface that the ray has passed in the cell, though it meets none of its triangles: it
 * went by where the field and they do not quite join, or beside an edge by rounding. The
 * nearest of them to where the ray goes through its plane, `most` away at most. */
static bool stop_at_passed(const scene *s, double most, lr_found *found)
{
    const double low = s->carried != 0 ? s->leaving->t : fmax(s->in.t, s->leaving->t);
    const double high = fmax(s->out.t, low);
    /* In cells of the field before this one the plane may have been passed by what that is off. */
    const double behind = s->in.open && s->carried == 0 ? LR_FIELD_OFF : s->off;
    double nearest = most * most;
    found->triangle = LR_NO_TRIANGLE;
    found->object = LR_NO_OBJECT;
    for (uint32_t i = 0; i < s->n; i++) {
        const double *p[3];
        double n[3], q[3];
        lr_triangle_cell_normal(s->v->triangle_cells, s->list[i], n);
        lr_triangle_cell_corners(s->v->triangle_cells, s->list[i], p);
        const double from[3] = {p[0][0] - s->r->o[0], p[0][1] - s->r->o[1], p[0][2] - s->r->o[2]};
        const double speed = lr_dot(n, s->r->d);
        if (!(speed * s->leaving->side > 0.0))
            continue;
        double t = lr_dot(n, from) / speed;
        if (t < low && (low - t) * fabs(speed) <= behind * sqrt(lr_dot(n, n)))
            t = low;
        if (!(t >= low && t <= high))
            continue;
        lr_point_at(s->r, t, q);
        const double square = lr_triangle_cell_distance2(s->v->triangle_cells, s->list[i], q);
        if (square < nearest) {
            nearest = square;
            found->triangle = s->list[i];
            found->t = t;
        }
    }
    if (found->triangle != LR_NO_TRIANGLE) {
        locate(s->v, s->r, found->t, s->c, found);
    } else if (most < INFINITY) {
        return false;
    } else { /* none of them faces the ray: the field does */
        found->t = high;
        memcpy(found->c, s->c, sizeof found->c);
        memcpy(found->corner, s->corner, sizeof found->corner);
        for (int a = 0; a < 3; a++)
            found->p[a] = lr_clamp(s->out.p[a] - s->c[a], 0.0, 1.0);
    }
    return found->t <= s->r->t_max;
}

bool lr_hit_triangle_cell(const lr_volume *v, const lr_ray *r, const lr_cursor *u,
                          const lr_leaving *leaving, const lr_trace_options *options, int *side,
                          lr_found *found, uint64_t *n_samples)
{
    scene s = {.v = v, .r = r, .leaving = leaving, .n_samples = n_samples};
    memcpy(s.c, u->c, sizeof s.c);
    lr_corners(v, s.c, s.corner);
    s.per_voxel = 1.0 / sqrt(lr_dot(r->d, r->d));
    find_gates(&s, r, leaving->t);
    s.carried = abs(*side) > 1 ? *side : 0;
    const lr_shear frame = lr_shear_of(r);
    s.off = leaving->side != 0 ? lr_start_off(v) : 0.0;
    s.beyond = starts_beyond(&s, u);
    met best = {.t = INFINITY};
    s.list = lr_triangle_cell_list(v, s.c, &s.n);
    for (uint32_t i = 0; i < s.n; i++) {
        met m;
        if (meet(v->triangle_cells, r, &frame, s.list[i], &m) && m.t < best.t && accept(&s, &m) &&
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
        return lr_hit_cell(v, r, LR_REGULAR, u, 0, options, found, n_samples);
    }
    if (leaving->side == 0)
        return false;
    const lost end = s.behind ? LR_ASTRAY : lose(&s);
    *side = end == LR_ASTRAY ? 2 * leaving->side : 0;
    if (end < LR_PASSED)
        return false;
    if (end == LR_SLIPPED)
        return comes_from_inside(&s) && stop_at_passed(&s, SLIP * s.off, found);
    return stop_at_passed(&s, INFINITY, found);
}
