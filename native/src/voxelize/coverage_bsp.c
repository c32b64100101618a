/* Coverage of a voxel where shells cross, by binary space partitioning.
 *
 * A voxel is divided by the plane of a piece of surface in it, both halves by those of the
 * pieces left in them, and so on until a cell holds none: then the winding number is
 * constant in the cell, and that at its centre decides whether the cell is covered. The
 * coverage is that of the union of all shells, to rounding.
 *
 * Source: Thibault and Naylor 1987, Set operations on polyhedra using binary space
 * partitioning trees; here the winding number decides.
 * Departures: 1. cells for which memory ends or that have too many faces are decided by
 * their centre although they hold pieces; 2. a voxel of more than
 * LR_MOST_PIECES pieces is sampled.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/coverage_bsp.h"

enum {
    MOST_FACES = LR_MOST_CORNERS, /* a cut has a corner on every face that it meets */
    SAMPLES = 6                   /* along each axis */
};

/* Corners so near to a plane lie in it, voxels: well above the rounding of a
 * coordinate up to 8 that was cut some times, and nothing in volume. */
#define ON_PLANE 1e-10

/* Convex; its faces run counter-clockwise as seen from outside. */
typedef struct cell {
    int n;
    lr_polygon face[MOST_FACES];
} cell;

static double height_over(const lr_piece *plane, const double p[3])
{
    const double h = lr_dot(plane->n, p) - plane->d;
    return fabs(h) > ON_PLANE ? h : 0.0;
}

bool lr_piece_plane(const double triangle[3][3], lr_piece *piece)
{
    const bool has_area = lr_normal_of(triangle, piece->n);
    piece->d = lr_dot(piece->n, triangle[0]);
    return has_area;
}

/* The part of a polygon over (side 1) or under (-1) a plane; *leaves is the point where
 * it crosses the plane on the way out. False where nothing is left. */
static bool cut_polygon(const lr_polygon *in, const lr_piece *plane, double side, lr_polygon *out,
                        double leaves[3], bool *crosses)
{
    double h[LR_MOST_CORNERS];
    bool any = false;
    for (int i = 0; i < in->n; i++) {
        h[i] = side * height_over(plane, in->p[i]);
        any = any || h[i] > 0.0;
    }
    out->n = 0;
    *crosses = false;
    for (int i = 0; any && i < in->n; i++) {
        const int next = i + 1 < in->n ? i + 1 : 0;
        if (h[i] > 0.0 && out->n < LR_MOST_CORNERS)
            memcpy(out->p[out->n++], in->p[i], sizeof out->p[0]);
        if ((h[i] > 0.0) == (h[next] > 0.0) || out->n == LR_MOST_CORNERS)
            continue;
        double *p = out->p[out->n++];
        const double fraction = h[i] / (h[i] - h[next]);
        for (int a = 0; a < 3; a++)
            p[a] = in->p[i][a] + fraction * (in->p[next][a] - in->p[i][a]);
        if (h[i] > 0.0) {
            memcpy(leaves, p, 3 * sizeof *leaves);
            *crosses = true;
        }
    }
    return out->n > 2;
}

/* Order the corners of a convex polygon counter-clockwise as seen against n. */
static void go_round(lr_polygon *p, const double n[3])
{
    double middle[3] = {0.0}, u[3], v[3], angle[LR_MOST_CORNERS];
    for (int i = 0; i < p->n; i++)
        for (int a = 0; a < 3; a++)
            middle[a] += p->p[i][a] / p->n;
    const double least[3] = {fabs(n[0]) < 0.6, fabs(n[0]) >= 0.6, 0.0};
    lr_cross_product(n, least, u);
    lr_cross_product(n, u, v);
    for (int i = 0; i < p->n; i++) {
        double corner[3], from[3];
        memcpy(corner, p->p[i], sizeof corner);
        lr_sub(corner, middle, from);
        const double here = atan2(lr_dot(from, v), lr_dot(from, u));
        int to = i;
        for (; to > 0 && angle[to - 1] > here; to--) {
            angle[to] = angle[to - 1];
            memcpy(p->p[to], p->p[to - 1], sizeof corner);
        }
        angle[to] = here;
        memcpy(p->p[to], corner, sizeof corner);
    }
}

/* False where the part would have too many faces. */
static bool cut_cell(const cell *in, const lr_piece *plane, double side, cell *out)
{
    lr_polygon cap = {.n = 0};
    out->n = 0;
    for (int f = 0; f < in->n; f++) {
        bool crosses;
        double leaves[3];
        out->n += cut_polygon(&in->face[f], plane, side, &out->face[out->n], leaves, &crosses);
        if (crosses)
            memcpy(cap.p[cap.n++], leaves, sizeof leaves);
    }
    if (cap.n < 3)
        return true;
    if (out->n == MOST_FACES)
        return false;
    const double out_of[3] = {-side * plane->n[0], -side * plane->n[1], -side * plane->n[2]};
    go_round(&cap, out_of);
    out->face[out->n++] = cap;
    return true;
}

static void centre_of(const cell *c, double centre[3])
{
    int n = 0;
    memset(centre, 0, 3 * sizeof *centre);
    for (int f = 0; f < c->n; f++) {
        n += c->face[f].n;
        for (int i = 0; i < c->face[f].n; i++)
            for (int a = 0; a < 3; a++)
                centre[a] += c->face[f].p[i][a];
    }
    for (int a = 0; a < 3; a++)
        centre[a] /= n;
}

static double volume_of(const cell *c, const double centre[3])
{
    double volume = 0.0;
    for (int f = 0; f < c->n; f++) {
        const lr_polygon *p = &c->face[f];
        double u[3], v[3], w[3], cross[3];
        lr_sub(p->p[0], centre, u);
        for (int i = 2; i < p->n; i++) {
            lr_sub(p->p[i - 1], centre, v);
            lr_sub(p->p[i], centre, w);
            lr_cross_product(v, w, cross);
            volume += fabs(lr_dot(u, cross)) / 6.0;
        }
    }
    return volume;
}

static double covers_at(const lr_crossed *room, const double p[3])
{
    const double at[3] = {p[0] + room->origin[0], p[1] + room->origin[1], p[2] + room->origin[2]};
    return fabs(lr_winding_at(room->winding, at));
}

/* Of a cell that counts as a whole or not at all. */
static double whole(const lr_crossed *room, const cell *c)
{
    double centre[3];
    if (c->n < 4)
        return 0.0;
    centre_of(c, centre);
    const double volume = volume_of(c, centre);
    return volume > 0.0 && covers_at(room, centre) > 0.5 ? volume : 0.0;
}

static int largest_of(const lr_piece *piece, int n)
{
    int best = 0;
    double most = -1.0;
    for (int i = 0; i < n; i++) {
        const lr_polygon *p = &piece[i].polygon;
        double u[3], v[3], cross[3], area2 = 0.0;
        for (int k = 2; k < p->n; k++) {
            lr_sub(p->p[k - 1], p->p[0], u);
            lr_sub(p->p[k], p->p[0], v);
            lr_cross_product(u, v, cross);
            area2 += lr_dot(cross, cross);
        }
        if (area2 > most) {
            most = area2;
            best = i;
        }
    }
    return best;
}

/* Pieces first..first + n of the room lie in the cell. */
static double covered(lr_crossed *room, const cell *c, int first, int n)
{
    if (n == 0 || first + 2 * n > LR_CROSSED_ROOM)
        return whole(room, c);
    const int chosen = first + largest_of(room->piece + first, n), top = first + n;
    const lr_piece *plane = &room->piece[chosen];
    double sum = 0.0;
    for (int side = 1; side >= -1; side -= 2) {
        cell part;
        int kept = 0;
        if (!cut_cell(c, plane, side, &part))
            return whole(room, c);
        for (int i = first; i < top; i++) {
            bool crosses;
            double leaves[3];
            lr_piece *to = &room->piece[top + kept];
            if (i == chosen ||
                !cut_polygon(&room->piece[i].polygon, plane, side, &to->polygon, leaves, &crosses))
                continue;
            memcpy(to->n, room->piece[i].n, sizeof to->n);
            to->d = room->piece[i].d;
            kept++;
        }
        sum += covered(room, &part, top, kept);
    }
    return sum;
}

double lr_crossed_coverage(lr_crossed *room, const double lo[3], int n)
{
    cell cube = {.n = 6};
    for (int f = 0; f < 6; f++) {
        const int axis = f / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
        cube.face[f].n = 4;
        for (int i = 0; i < 4; i++) {
            double *p = cube.face[f].p[i];
            p[axis] = lo[axis] + f % 2;
            p[f % 2 ? u : v] = lo[f % 2 ? u : v] + (i == 1 || i == 2);
            p[f % 2 ? v : u] = lo[f % 2 ? v : u] + (i >= 2);
        }
    }
    return lr_clamp(covered(room, &cube, 0, n), 0.0, 1.0);
}

double lr_sampled_coverage(const lr_crossed *room, const double lo[3], bool *plain)
{
    int n = 0;
    *plain = true;
    for (int i = 0; i < SAMPLES * SAMPLES * SAMPLES; i++) {
        const int at[3] = {i % SAMPLES, i / SAMPLES % SAMPLES, i / SAMPLES / SAMPLES};
        double p[3];
        for (int a = 0; a < 3; a++)
            p[a] = lo[a] + (at[a] + 0.5) / SAMPLES;
        const double covers = covers_at(room, p);
        n += covers > 0.5;
        *plain = *plain && covers < 1.5;
    }
    return (double)n / (SAMPLES * SAMPLES * SAMPLES);
}
