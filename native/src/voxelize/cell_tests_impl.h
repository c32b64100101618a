/* One triangle against the cells of a brick: which are near it, and in which of these it differs
 * from the samples, as choose_triangle_cells.h says. Plain loops over the eight corners of a cell
 * and over the axes that separate it from the triangle, which compilers turn into vector
 * instructions; nothing is fused, so that all instruction sets give the same bits.
 *
 * A mesh of small triangles has several times as many pairs of cells and triangles as triangles:
 * a test decides for all corners before it branches.
 *
 * Whoever includes this defines LR_TEST_CELLS, the function's name, and, for x86, has set its
 * instruction set.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifdef __clang__
#define EACH(i, n) _Pragma("clang loop vectorize(enable)") for (int i = 0; i < (n); i++)
#else
#define EACH(i, n) for (int i = 0; i < (n); i++)
#endif

enum { CORNERS = 8, AXES = 12, MOST_POLYGON = 9 };

/* Tolerances, in voxels. A sphere of radius R leaves its tangent plane by r^2 / (2R) at the
 * distance r, and the error of its field is 1/(4R): smooth surfaces need no triangle cells
 * down to a radius of BEND voxels. */
static const double SURFACE_OFF = 0.05, CORNER_OFF = 0.1, GRADIENT_OFF = 0.25, BEND = 4.0;
/* Tolerance of the gradient for flat-shaded meshes: 1 degree. */
static const double FLAT_OFF = 0.0175;
/* Of distances beside a crease of more than 20 degrees. */
static const double CREASE = 0.35;

/* Where the corners of a cell lie in a field, from its first; and in the cell. */
static const int PLACE[CORNERS] = {0,
                                   1,
                                   LR_FIELD_SIDE,
                                   LR_FIELD_SIDE + 1,
                                   LR_FIELD_LAYER,
                                   LR_FIELD_LAYER + 1,
                                   LR_FIELD_LAYER + LR_FIELD_SIDE,
                                   LR_FIELD_LAYER + LR_FIELD_SIDE + 1};
static const double OFFSET[3][CORNERS] = {
    {0, 1, 0, 1, 0, 1, 0, 1}, {0, 0, 1, 1, 0, 0, 1, 1}, {0, 0, 0, 0, 1, 1, 1, 1}};

/* The separating axes of a triangle and cells, side by side: the triangle's normal and the nine
 * products of edges; the last ones separate nothing. */
typedef struct separators {
    _Alignas(64) double axis[3][AXES], lo[AXES], hi[AXES], half[AXES];
    _Alignas(64) double near[AXES], touch[AXES]; /* the margins on each axis */
} separators;

/* A triangle in coordinates from the brick's first sample. */
typedef struct piece {
    double p[3][3], n[3]; /* unit, outward */
    double wound[3];      /* unit, by the winding */
    double lo[3], hi[3];
    bool ends[3]; /* is the edge from that corner not closed (lr_edge_closed)? */
    bool any_ends;
    uint32_t triangle;
} piece;

static void add(lr_mask mask, int cell)
{
    lr_mask_add(mask, lr_along(cell, 0), lr_along(cell, 1), lr_along(cell, 2));
}

LR_INLINE void read_corners(const double *from, double corner[CORNERS])
{
    for (int l = 0; l < CORNERS; l += 2)
        memcpy(corner + l, from + PLACE[l], 2 * sizeof *corner);
}

/* ---- a triangle near a cell -------------------------------------------- */

static void set_separators(const double p[3][3], separators *s)
{
    double edge[3][3], normal[3];
    memset(s, 0, sizeof *s);
    for (int e = 0; e < 3; e++)
        lr_sub(p[(e + 1) % 3], p[e], edge[e]);
    lr_cross_product(edge[0], edge[1], normal);
    for (int a = 0; a < 3; a++)
        s->axis[a][0] = normal[a];
    for (int e = 0; e < 3; e++)
        for (int a = 0; a < 3; a++) { /* the product of the unit vector a and the edge */
            const int b = (a + 1) % 3, c = (a + 2) % 3;
            s->axis[b][1 + 3 * e + a] = -edge[e][c];
            s->axis[c][1 + 3 * e + a] = edge[e][b];
        }
    EACH(i, AXES)
    {
        const double x = s->axis[0][i], y = s->axis[1][i], z = s->axis[2][i];
        const double at0 = x * p[0][0] + y * p[0][1] + z * p[0][2];
        const double at1 = x * p[1][0] + y * p[1][1] + z * p[1][2];
        const double at2 = x * p[2][0] + y * p[2][1] + z * p[2][2];
        const double lo = at1 < at0 ? at1 : at0, hi = at1 > at0 ? at1 : at0;
        const double extent = fabs(x) + fabs(y) + fabs(z);
        s->near[i] = LR_EXACT_NEAR * extent;
        s->touch[i] = LR_TOUCH * extent;
        s->half[i] = 0.5 * extent;
        s->lo[i] = (at2 < lo ? at2 : lo) - s->half[i];
        s->hi[i] = at2 > hi ? at2 : hi;
    }
}

/* How near a triangle comes to a cell: not within LR_EXACT_NEAR, not within LR_TOUCH, or nearer. */
typedef enum nearness { FAR, NEAR, TOUCHED } nearness;

LR_INLINE nearness nearness_of(const piece *t, const separators *s, const double cell[3])
{
    const double c[3] = {cell[0] + 0.5, cell[1] + 0.5, cell[2] + 0.5};
    int beyond_near = 0, beyond_touch = 0;
    EACH(i, AXES)
    {
        const double at = s->axis[0][i] * c[0] + s->axis[1][i] * c[1] + s->axis[2][i] * c[2];
        const double below = s->lo[i] - at, above = at - s->hi[i] - s->half[i];
        const double out = below > above ? below : above;
        beyond_near |= out > s->near[i];
        beyond_touch |= out > s->touch[i];
    }
    double gap = 0.0;
    for (int a = 0; a < 3; a++) { /* the cell's own axes */
        const double below = t->lo[a] - cell[a] - 1.0, above = cell[a] - t->hi[a];
        gap = below > gap ? below : gap;
        gap = above > gap ? above : gap;
    }
    if (beyond_near || gap > LR_EXACT_NEAR)
        return FAR;
    return beyond_touch || gap > LR_TOUCH ? NEAR : TOUCHED;
}

/* Does a segment meet the cell, widened by LR_EXACT_NEAR? */
static bool segment_near(const double a[3], const double b[3], const double cell[3])
{
    double in = 0.0, out = 1.0;
    for (int i = 0; i < 3; i++) {
        const double lo = cell[i] - LR_EXACT_NEAR, hi = cell[i] + 1.0 + LR_EXACT_NEAR;
        const double d = b[i] - a[i];
        if (d == 0.0) {
            if (a[i] < lo || a[i] > hi)
                return false;
            continue;
        }
        const double t0 = ((d > 0.0 ? lo : hi) - a[i]) / d, t1 = ((d > 0.0 ? hi : lo) - a[i]) / d;
        in = t0 > in ? t0 : in;
        out = t1 < out ? t1 : out;
    }
    return in <= out;
}

static bool ends_near(const piece *t, const double cell[3])
{
    for (int e = 0; e < 3; e++)
        if (t->ends[e] && segment_near(t->p[e], t->p[(e + 1) % 3], cell))
            return true;
    return false;
}

/* ---- samples that differ ----------------------------------------------- */

/* The distance that a sample stores at the distance s from a plane. */
LR_INLINE double told_at(const lr_voxel_job *job, double s)
{
    const double r = job->half_width;
    return job->filter == LR_FILTER_RAMP
               ? lr_clamp(s, -r, r)
               : (lr_profile(job->filter, s, r) - 0.5) / lr_profile_slope(job->filter, r);
}

/* The distances that samples store at distances s from a plane. */
LR_INLINE void told_at_corners(const lr_voxel_job *job, const double s[CORNERS],
                               double told[CORNERS])
{
    const double r = job->half_width;
    if (job->filter == LR_FILTER_RAMP) {
        EACH(l, CORNERS)
        {
            told[l] = lr_clamp(s[l], -r, r);
        }
        return;
    }
    for (int l = 0; l < CORNERS; l++)
        told[l] = told_at(job, s[l]);
}

/* Does the field around some corners have another gradient than the plane with the normal n? They
 * lie at s from it, and differ by gap, the chosen ones by more than `most`. */
LR_INLINE bool goes_elsewhere(const lr_cell_work *w, int at, const double n[3],
                              const double s[CORNERS], const double gap[CORNERS], double most)
{
    static const int stride[3] = {1, LR_FIELD_SIDE, LR_FIELD_LAYER};
    for (int a = 0; a < 3; a++)
        for (int step = -1; step <= 1; step += 2) {
            double there[CORNERS], told[CORNERS], beside[CORNERS];
            read_corners(w->field + at + step * stride[a], beside);
            EACH(l, CORNERS)
            {
                there[l] = s[l] - step * n[a];
            }
            told_at_corners(w->job, there, told);
            int any = 0;
            EACH(l, CORNERS)
            {
                const double off = beside[l] - told[l] - gap[l];
                any |= (fabs(off) > CREASE) & (fabs(gap[l]) > most);
            }
            if (any)
                return true;
        }
    return false;
}

/* Squared distance of a point from the part of the plane that the triangle covers, along
 * the plane. */
static double beside2(const piece *t, const double q[3])
{
    double best = INFINITY;
    bool in_face = true;
    for (int c = 0; c < 3; c++) {
        double along[3], from[3], out[3];
        lr_sub(t->p[(c + 1) % 3], t->p[c], along);
        lr_sub(q, t->p[c], from);
        lr_cross_product(along, t->wound, out);
        const double length2 = lr_dot(along, along), height = lr_dot(t->n, from);
        const double fraction = lr_clamp(lr_dot(along, from) / length2, 0.0, 1.0);
        double square = -height * height;
        for (int a = 0; a < 3; a++)
            square += (from[a] - fraction * along[a]) * (from[a] - fraction * along[a]);
        in_face = in_face && lr_dot(out, from) <= 0.0;
        best = square < best ? square : best;
    }
    return in_face ? 0.0 : best;
}

/* Case 2 of choose_triangle_cells.c. at: of the cell in the field; crease: whether one may be
 * near. */
static bool corners_off(const lr_cell_work *w, const piece *t, const double cell[3], int at,
                        const double corner[CORNERS], bool crease)
{
    double from[3], s[CORNERS], told[CORNERS], gap[CORNERS];
    lr_sub(cell, t->p[0], from);
    const double first = -lr_dot(t->n, from);
    EACH(l, CORNERS)
    {
        s[l] = first - OFFSET[0][l] * t->n[0] - OFFSET[1][l] * t->n[1] - OFFSET[2][l] * t->n[2];
    }
    told_at_corners(w->job, s, told);
    int creased = 0, off = 0;
    EACH(l, CORNERS)
    {
        gap[l] = corner[l] - told[l];
        creased |= fabs(gap[l]) > w->crease_off;
        off |= fabs(gap[l]) - CORNER_OFF > 0.0;
    }
    if (crease && creased && goes_elsewhere(w, at, t->n, s, gap, w->crease_off))
        return true;
    for (int l = 0; l < CORNERS && off; l++) {
        const double q[3] = {cell[0] + OFFSET[0][l], cell[1] + OFFSET[1][l],
                             cell[2] + OFFSET[2][l]};
        const double too_far = fabs(gap[l]) - CORNER_OFF;
        if (too_far > 0.0 && too_far > beside2(t, q) / (2.0 * BEND))
            return true;
    }
    return false;
}

/* The part of a polygon below a plane of one axis, sign * p[a] <= bound.
 *
 * Source: Sutherland and Hodgman 1974. */
static int clip(double p[MOST_POLYGON][3], int n, int a, double sign, double bound)
{
    double out[MOST_POLYGON][3];
    int kept = 0;
    for (int i = 0; i < n; i++) {
        const double *q = p[(i + 1) % n];
        const double at = sign * p[i][a] - bound, next = sign * q[a] - bound;
        if (at <= 0.0 && kept < MOST_POLYGON)
            memcpy(out[kept++], p[i], sizeof out[0]);
        if ((at < 0.0) != (next < 0.0) && at != 0.0 && next != 0.0 && kept < MOST_POLYGON) {
            for (int c = 0; c < 3; c++)
                out[kept][c] = p[i][c] + (q[c] - p[i][c]) * (at / (at - next));
            kept++;
        }
    }
    memcpy(p, out, (size_t)kept * sizeof *p);
    return kept;
}

static bool point_off(const double corner[8], const double cell[3], const double p[3],
                      const double n[3], double gradient_off)
{
    double q[3], g[3];
    for (int a = 0; a < 3; a++)
        q[a] = lr_clamp(p[a] - cell[a], 0.0, 1.0);
    if (fabs(lr_trilinear(corner, q)) > SURFACE_OFF)
        return true;
    lr_trilinear_gradient(corner, q, g);
    for (int a = 0; a < 3; a++)
        g[a] += n[a];
    return lr_dot(g, g) > gradient_off * gradient_off;
}

/* Case 3 above, at the corners and the middle of the triangle's part in the cell. */
static bool surface_off(const piece *t, const double cell[3], const double corner[8],
                        double gradient_off)
{
    double p[MOST_POLYGON][3], middle[3] = {0.0, 0.0, 0.0};
    int n = 3;
    memcpy(p, t->p, sizeof t->p);
    for (int a = 0; a < 3 && n > 0; a++) {
        if (t->hi[a] > cell[a] + 1.0)
            n = clip(p, n, a, 1.0, cell[a] + 1.0 + LR_TOUCH);
        if (t->lo[a] < cell[a])
            n = clip(p, n, a, -1.0, LR_TOUCH - cell[a]);
    }
    for (int i = 0; i < n; i++) {
        if (point_off(corner, cell, p[i], t->n, gradient_off))
            return true;
        for (int a = 0; a < 3; a++)
            middle[a] += p[i][a] / n;
    }
    return n > 0 && point_off(corner, cell, middle, t->n, gradient_off);
}

/* ---- a cell, a triangle ------------------------------------------------ */

static bool add_pair(lr_cell_work *w, uint32_t cell, uint32_t triangle)
{
    if (w->n_pairs == w->room) {
        const size_t room = 2 * w->room + 4096;
        lr_cell_pair *pairs = realloc(w->pairs, room * sizeof *pairs);
        if (pairs == NULL)
            return false;
        w->pairs = pairs;
        w->room = room;
    }
    w->pairs[w->n_pairs++] = (lr_cell_pair){cell, triangle};
    return true;
}

static bool test_cell(lr_cell_work *w, const piece *t, const separators *s, const int32_t c[3])
{
    const double cell[3] = {c[0], c[1], c[2]};
    const int number = lr_in_brick(c[0], c[1], c[2]);
    const nearness how = nearness_of(t, s, cell);
    const bool touched = how == TOUCHED;
    if (how == FAR)
        return true;
    add(w->near, number);
    if (touched)
        add(w->touched, number);
    if (!lr_mask_has(w->bad, c[0], c[1], c[2])) {
        const int at = lr_field_at(c[0], c[1], c[2]);
        double corner[CORNERS];
        read_corners(w->field + at, corner);
        if (w->job->every || (t->any_ends && ends_near(t, cell)) ||
            corners_off(w, t, cell, at, corner, touched && !w->crease_free) ||
            (touched && surface_off(t, cell, corner, w->job->flat ? FLAT_OFF : GRADIENT_OFF)))
            add(w->bad, number);
    }
    return add_pair(w, (uint32_t)number, t->triangle);
}

bool LR_TEST_CELLS(lr_cell_work *w, uint32_t triangle)
{
    const lr_topology *mesh = w->job->mesh;
    piece t = {.triangle = triangle};
    lr_triangle(mesh, triangle, t.p);
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++)
            t.p[c][a] -= w->first[a];
    int32_t lo[3], hi[3];
    if (!lr_cell_range((const double (*)[3])t.p, LR_EXACT_NEAR, lo, hi) ||
        !lr_normal_of((const double (*)[3])t.p, t.wound))
        return true;
    for (int a = 0; a < 3; a++) {
        t.n[a] = t.wound[a] * mesh->side;
        t.lo[a] = fmin(fmin(t.p[0][a], t.p[1][a]), t.p[2][a]);
        t.hi[a] = fmax(fmax(t.p[0][a], t.p[1][a]), t.p[2][a]);
        t.ends[a] = !lr_edge_closed(mesh, 3 * triangle + (uint32_t)a);
        t.any_ends = t.any_ends || t.ends[a];
    }
    separators s;
    set_separators((const double (*)[3])t.p, &s);
    int32_t c[3];
    for (c[2] = lo[2]; c[2] <= hi[2]; c[2]++)
        for (c[1] = lo[1]; c[1] <= hi[1]; c[1]++)
            for (c[0] = lo[0]; c[0] <= hi[0]; c[0]++)
                if (!test_cell(w, &t, &s, c))
                    return false;
    return true;
}
