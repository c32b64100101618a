/* Coverage of voxels by the divergence theorem, one brick at a time.
 *
 * A sweep along x adds up a voxel's coverage: the covered area of its lower face, and for
 * every piece of surface inside it the piece's area, projected along x, times its distance
 * from the upper face; pieces behind count in full. So the coverages of a row of voxels
 * follow from the covered area where the row enters the brick; that area, by the same sweep
 * along y over the cut of the mesh with the brick's face, from a covered length; and that
 * length, along z over the cut with the brick's edge, from the covering of the brick's
 * corner. Nothing beyond the brick is needed, and nothing is approximated: the coverages of
 * all voxels add up to the volume.
 *
 * How often the corner is covered is the whole number for which the coverages agree best
 * with the sides of the samples. Surface in a corner, edge or face counts by an
 * infinitesimal shift of these in +x, +y, +z.
 *
 * Where shells cross or lie in each other, the sweep would count space once per shell.
 * There sides come from the winding number, and voxels that hold surface are divided by a
 * BSP one by one (coverage_bsp.c).
 *
 * Source: the sweep is that of font rasterizers (area and cover of a cell, FreeType),
 * a dimension up.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/coverage.h"

#include "grid/layers.h"

enum {
    MOST_COVERS = 3, /* where a mesh cuts itself, a corner may be covered so often */
    POLL = 1 << 8
};

/* A coverage so far beyond 0..1 is more than rounding: shells cross. */
#define BEYOND 1e-6

typedef lr_polygon polygon; /* of a triangle after six cuts: nine corners */

/* What pieces add within a cell, and to all cells after it. */
typedef struct sweep {
    double own[LR_CELLS], later[LR_CELLS];
    double own_area[LR_SIDE][LR_SIDE], later_area[LR_SIDE][LR_SIDE]; /* [z][y] of the plane x = 0 */
    double own_length[LR_SIDE], later_length[LR_SIDE];               /* of the edge x = y = 0 */
    lr_layers crossed;
} sweep;

static void meet(const double a[3], const double b[3], int axis, double at, double out[3])
{
    const double fraction = (at - a[axis]) / (b[axis] - a[axis]);
    for (int i = 0; i < 3; i++)
        out[i] = a[i] + fraction * (b[i] - a[i]);
    out[axis] = at;
}

/* The part of a polygon on the upper (side 1) or lower (-1) side of a plane across an
 * axis. What lies in the plane belongs to the lower side. */
static void cut(const polygon *in, int axis, double at, int side, polygon *out)
{
    out->n = 0;
    for (int i = 0; i < in->n; i++) {
        const double *a = in->p[i], *b = in->p[(i + 1) % in->n];
        const bool a_in = (a[axis] > at) == (side > 0), b_in = (b[axis] > at) == (side > 0);
        if (a_in && out->n < LR_MOST_CORNERS)
            memcpy(out->p[out->n++], a, sizeof out->p[0]);
        if (a_in != b_in && out->n < LR_MOST_CORNERS) {
            if (a_in) /* the same order of both ends from both triangles of an edge */
                meet(b, a, axis, at, out->p[out->n++]);
            else
                meet(a, b, axis, at, out->p[out->n++]);
        }
    }
}

static void cut_slab(const polygon *in, int axis, int cell, polygon *out)
{
    polygon upper;
    cut(in, axis, cell, 1, &upper);
    cut(&upper, axis, cell + 1, -1, out);
}

/* The first and last of a brick's cells that a polygon meets along an axis; false: none. */
static bool cells_of(const polygon *p, int axis, int *first, int *last)
{
    double lo = INFINITY, hi = -INFINITY;
    for (int i = 0; i < p->n; i++) {
        lo = fmin(lo, p->p[i][axis]);
        hi = fmax(hi, p->p[i][axis]);
    }
    if (p->n == 0 || !(lo < LR_SIDE && hi > 0.0))
        return false;
    *first = lo > 0.0 ? (int)ceil(lo) - 1 : 0;
    *last = hi < LR_SIDE ? (int)ceil(hi) - 1 : LR_SIDE - 1;
    return true;
}

/* A piece of surface inside voxel (x, y, z): its signed area along x, which is positive
 * where a ray along x leaves the solid, and that area times the distance to the upper face. */
static void add_piece(const polygon *p, int x, int y, int z, double side, sweep *s)
{
    const int at = lr_in_brick(x, y, z);
    for (int i = 2; i < p->n; i++) {
        const double *a = p->p[0], *b = p->p[i - 1], *c = p->p[i];
        const double area =
            0.5 * side * ((b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1]));
        s->own[at] -= area * (x + 1 - (a[0] + b[0] + c[0]) / 3.0);
        s->later[at] -= area;
    }
    lr_layers_add(s->crossed, at, p->n > 2);
}

/* The piece of the cut with the plane x = 0 that runs from a to b, the solid on its
 * left as seen against x, inside cell (y, z) of that plane. */
static void add_line(const double a[3], const double b[3], int y, int z, double side, sweep *s)
{
    const double length = side * (b[2] - a[2]);
    s->own_area[z][y] -= length * (y + 1 - 0.5 * (a[1] + b[1]));
    s->later_area[z][y] -= length;
}

static void add_point(double z, double sign, sweep *s)
{
    if (!(z > 0.0 && z < LR_SIDE))
        return;
    const int k = lr_min_i((int)floor(z), LR_SIDE - 1);
    s->own_length[k] += sign * (k + 1 - z);
    s->later_length[k] += sign;
}

/* The part of line a b inside lo..hi along an axis; false: none. */
static bool cut_line(double a[3], double b[3], int axis, double lo, double hi)
{
    double *ends[2] = {a, b};
    if ((a[axis] <= lo && b[axis] <= lo) || (a[axis] > hi && b[axis] > hi))
        return false;
    const double from[3] = {a[0], a[1], a[2]}, to[3] = {b[0], b[1], b[2]};
    for (int e = 0; e < 2; e++) {
        const double at = ends[e][axis] <= lo ? lo : ends[e][axis] > hi ? hi : ends[e][axis];
        if (at != ends[e][axis])
            meet(from, to, axis, at, ends[e]);
    }
    return true;
}

/* What the plane x = 0 cuts out of a triangle: a line between the two edges that cross
 * it, in the order of the cut polygon. */
static void add_plane(const polygon *triangle, double side, sweep *s)
{
    double ends[2][3] = {{0.0}};
    int n_up = 0, n_down = 0;
    for (int i = 0; i < 3; i++) {
        const double *a = triangle->p[i], *b = triangle->p[(i + 1) % 3];
        if (a[0] > 0.0 && !(b[0] > 0.0)) {
            meet(b, a, 0, 0.0, ends[0]);
            n_down++;
        } else if (!(a[0] > 0.0) && b[0] > 0.0) {
            meet(a, b, 0, 0.0, ends[1]);
            n_up++;
        }
    }
    if (n_up == 0 || n_down == 0)
        return;
    const double *a = ends[0], *b = ends[1];
    if ((a[1] > 0.0) != (b[1] > 0.0)) {
        double p[3];
        if (a[1] > 0.0)
            meet(b, a, 1, 0.0, p);
        else
            meet(a, b, 1, 0.0, p);
        add_point(p[2], b[1] > 0.0 ? side : -side, s);
    }
    for (int z = 0; z < LR_SIDE; z++) {
        double p[3], q[3];
        memcpy(p, a, sizeof p);
        memcpy(q, b, sizeof q);
        if (!cut_line(p, q, 2, z, z + 1))
            continue;
        for (int y = 0; y < LR_SIDE; y++) {
            double u[3], v[3];
            memcpy(u, p, sizeof u);
            memcpy(v, q, sizeof v);
            if (cut_line(u, v, 1, y, y + 1))
                add_line(u, v, y, z, side, s);
        }
    }
}

static void add_triangle(const polygon *triangle, double side, sweep *s)
{
    int z0, z1, y0, y1, x0, x1;
    polygon row, column, piece;
    if (!cells_of(triangle, 1, &y0, &y1) || !cells_of(triangle, 2, &z0, &z1) ||
        !cells_of(triangle, 0, &x0, &x1))
        return;
    add_plane(triangle, side, s);
    for (int z = z0; z <= z1; z++) {
        cut_slab(triangle, 2, z, &row);
        if (!cells_of(&row, 1, &y0, &y1))
            continue;
        for (int y = y0; y <= y1; y++) {
            cut_slab(&row, 1, y, &column);
            if (!cells_of(&column, 0, &x0, &x1))
                continue;
            for (int x = x0; x <= x1; x++) {
                cut_slab(&column, 0, x, &piece);
                add_piece(&piece, x, y, z, side, s);
            }
        }
    }
}

/* Shares of all voxels if the brick's corner is not covered, into s->own. */
static void sum_up(sweep *s)
{
    double length = 0.0;
    for (int z = 0; z < LR_SIDE; z++) {
        double area = length + s->own_length[z];
        length += s->later_length[z];
        for (int y = 0; y < LR_SIDE; y++) {
            double volume = area + s->own_area[z][y];
            area += s->later_area[z][y];
            for (int x = 0; x < LR_SIDE; x++) {
                const int at = lr_in_brick(x, y, z);
                s->own[at] += volume;
                volume += s->later[at];
            }
        }
    }
}

/* How far a coverage is from the side of its sample. What is covered twice, where a mesh
 * intersects itself, counts half: it is no error, but rare. */
LR_INLINE double miss_of(double coverage, bool inside)
{
    if (!inside)
        return fabs(coverage);
    return coverage < 1.0 ? 1.0 - coverage : 0.5 * (coverage - 1.0);
}

static double covers_of_corner(const sweep *s, const lr_layers inside)
{
    double best = INFINITY, covers = 0.0;
    for (int c = -MOST_COVERS; c <= MOST_COVERS; c++) {
        double miss = 0.0;
        for (int at = 0; at < LR_CELLS; at++)
            miss += miss_of(s->own[at] + c, lr_layers_have(inside, at));
        if (miss < best) {
            best = miss;
            covers = c;
        }
    }
    return covers;
}

static void shift(const lr_topology *mesh, const int32_t first[3], uint32_t t, polygon *triangle)
{
    triangle->n = 3;
    lr_triangle(mesh, t, triangle->p);
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++) /* voxels extend half a voxel around their samples */
            triangle->p[c][a] += 0.5 - first[a];
}

/* List the pieces of a voxel, up to one more than LR_MOST_PIECES; false where stopped. */
static bool gather(const lr_topology *mesh, const int32_t first[3], const uint32_t *list,
                   uint32_t n, const int voxel[3], const lr_watch *watch, lr_crossed *room,
                   int *n_pieces)
{
    *n_pieces = 0;
    for (uint32_t i = 0; i < n && *n_pieces <= LR_MOST_PIECES; i++) {
        polygon in, out;
        lr_piece *piece = &room->piece[*n_pieces];
        if (i % POLL == POLL - 1 && lr_stopped(watch))
            return false;
        shift(mesh, first, list[i], &in);
        bool misses = !lr_counts(mesh, list[i]);
        for (int a = 0; a < 3 && !misses; a++) {
            const double *p = in.p[0], *q = in.p[1], *r = in.p[2];
            misses = (p[a] <= voxel[a] && q[a] <= voxel[a] && r[a] <= voxel[a]) ||
                     (p[a] > voxel[a] + 1 && q[a] > voxel[a] + 1 && r[a] > voxel[a] + 1);
        }
        if (misses || !lr_piece_plane((const double (*)[3])in.p, piece))
            continue;
        cut_slab(&in, 2, voxel[2], &out);
        cut_slab(&out, 1, voxel[1], &in);
        cut_slab(&in, 0, voxel[0], &piece->polygon);
        *n_pieces += piece->polygon.n > 2;
    }
    return true;
}

/* The coverages of the union of all shells; where nothing is covered twice, those of the sweep.
 * False where stopped. */
static bool cover_union(const lr_topology *mesh, const int32_t first[3], const uint32_t *list,
                        uint32_t n, const sweep *s, const lr_watch *watch, lr_crossed *room,
                        float *value)
{
    for (int a = 0; a < 3; a++)
        room->origin[a] = first[a] - 0.5;
    const double covers = round(mesh->side * lr_winding_at(room->winding, room->origin));
    for (int z = 0; z < LR_SIDE; z++)
        for (uint64_t left = s->crossed[z]; left != 0; left &= left - 1) {
            const int at = LR_LAYER_SAMPLES * z + __builtin_ctzll(left);
            const int voxel[3] = {lr_along(at, 0), lr_along(at, 1), z};
            const double lo[3] = {voxel[0], voxel[1], voxel[2]};
            int n_pieces;
            bool plain;
            if (lr_stopped(watch) || !gather(mesh, first, list, n, voxel, watch, room, &n_pieces))
                return false;
            double coverage = n_pieces <= LR_MOST_PIECES ? lr_crossed_coverage(room, lo, n_pieces)
                                                         : lr_sampled_coverage(room, lo, &plain);
            if (n_pieces > LR_MOST_PIECES && plain)
                coverage = s->own[at] + covers;
            value[at] = (float)lr_clamp(coverage, 0.0, 1.0);
        }
    return true;
}

bool lr_box_brick(const lr_topology *mesh, const int32_t first[3], const uint32_t *list, uint32_t n,
                  const lr_layers inside, const lr_watch *watch, lr_crossed *room, float *value,
                  bool *crosses)
{
    sweep s;
    uint64_t any = 0;
    memset(&s, 0, sizeof s);
    for (uint32_t i = 0; i < n; i++) {
        polygon triangle;
        if (i % POLL == POLL - 1 && lr_stopped(watch))
            return false;
        if (!lr_counts(mesh, list[i]))
            continue;
        shift(mesh, first, list[i], &triangle);
        add_triangle(&triangle, mesh->side, &s);
    }
    for (int z = 0; z < LR_SIDE; z++)
        any |= s.crossed[z];
    if (any == 0)
        return true;
    sum_up(&s);
    if (room != NULL)
        return cover_union(mesh, first, list, n, &s, watch, room, value);
    const double covers = covers_of_corner(&s, inside);
    for (int z = 0; z < LR_SIDE; z++)
        for (uint64_t left = s.crossed[z]; left != 0; left &= left - 1) {
            const int at = LR_LAYER_SAMPLES * z + __builtin_ctzll(left);
            const double coverage = s.own[at] + covers;
            *crosses = *crosses || coverage < -BEYOND || coverage > 1.0 + BEYOND;
            value[at] = (float)lr_clamp(coverage, 0.0, 1.0);
        }
    return true;
}
