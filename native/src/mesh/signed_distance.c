/* Signed distance from a point to the triangle that is nearest to it, in f64.
 *
 * Source: Baerentzen and Aanaes 2005 for the sign; see topology.c and triangle_distance.h.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "mesh/signed_distance.h"

enum { MOST_FACES = 64 /* around an edge; no sensible mesh has more */ };

/* Sum of the unit normals of the faces around an edge, own that of the half-edge's face. */
static void edge_normal(const lr_topology *mesh, uint32_t half_edge, const double own[3],
                        double sum[3])
{
    uint32_t h = mesh->ring[half_edge];
    memcpy(sum, own, 3 * sizeof *sum);
    for (int i = 1; i < MOST_FACES && h != half_edge; i++, h = mesh->ring[h]) {
        double p[3][3], n[3];
        lr_triangle(mesh, h / 3, p);
        lr_normal_of((const double (*)[3])p, n);
        for (int a = 0; a < 3; a++)
            sum[a] += n[a];
    }
}

/* atan(y / x) for y >= 0, to 2e-6: weights need no more.
 * Source: Hastings 1955, Approximations for Digital Computers, sheet 11. */
static double angle_of(double y, double x)
{
    double far = fabs(x), most = y > far ? y : far, least = y > far ? far : y;
    double q = most > 0.0 ? least / most : 0.0, s = q * q;
    double a = q * (0.99997726 +
                    s * (-0.33262347 +
                         s * (0.19354346 + s * (-0.11643287 + s * (0.05265332 - s * 0.0117212)))));
    a = y > far ? 0.5 * LR_PI - a : a;
    return x < 0.0 ? LR_PI - a : a;
}

/* Add the unit normal of a triangle, weighted by its angle at a corner. */
static void add_corner(const lr_topology *mesh, uint32_t t, int corner, double sum[3])
{
    double p[3][3], n[3], u[3], v[3];
    lr_triangle(mesh, t, p);
    if (!lr_cross_of((const double (*)[3])p, n))
        return;
    lr_sub(p[(corner + 1) % 3], p[corner], u);
    lr_sub(p[(corner + 2) % 3], p[corner], v);
    double area = sqrt(lr_dot(n, n)), weight = angle_of(area, lr_dot(u, v)) / area;
    for (int a = 0; a < 3; a++)
        sum[a] += weight * n[a];
}

/* Add the faces of the fan around a vertex from a half-edge that ends or starts
 * there on, the triangle of that half-edge left out. True where the fan closes:
 * it came back to the half-edge called last. */
static bool add_fan(const lr_topology *mesh, uint32_t vertex, uint32_t first, uint32_t last,
                    double sum[3])
{
    for (uint32_t h = first;;) {
        uint32_t over = mesh->ring[h];
        if (over == h || mesh->ring[over] != h)
            return false;
        if (over == last)
            return true;
        uint32_t t = over / 3, e = over % 3;
        bool starts = lr_welded(mesh, t, (int)e) == vertex;
        uint32_t corner = starts ? e : (e + 1) % 3;
        add_corner(mesh, t, (int)corner, sum);
        h = 3 * t + (starts ? (corner + 2) % 3 : corner);
    }
}

/* Angle-weighted normal of the faces around a triangle's corner; true where
 * they form no closed fan. */
static bool vertex_normal(const lr_topology *mesh, uint32_t t, int corner, double sum[3])
{
    uint32_t vertex = lr_welded(mesh, t, corner);
    uint32_t out = 3 * t + (uint32_t)corner, in = 3 * t + (uint32_t)(corner + 2) % 3;
    for (int a = 0; a < 3; a++)
        sum[a] = 0.0;
    add_corner(mesh, t, corner, sum);
    if (add_fan(mesh, vertex, out, in, sum))
        return false;
    add_fan(mesh, vertex, in, out, sum);
    return true;
}

double lr_signed_distance(const lr_topology *mesh, uint32_t t, const lr_frame *f, const double p[3],
                          double *height, bool *border)
{
    double from[3][3], excess[3], place[3];
    bool in_face = true;
    for (int e = 0; e < 3; e++) {
        lr_sub(p, f->p[e], from[e]);
        excess[e] = lr_dot(f->m[e], from[e]);
        place[e] = lr_dot(f->u[e], from[e]);
        in_face = in_face && excess[e] <= 0.0;
    }
    double h = lr_dot(f->n, from[0]);
    *height = -h;
    *border = false;
    if (in_face)
        return -h;
    int nearest = 0;
    double smallest = INFINITY;
    for (int e = 0; e < 3; e++) {
        double outside = place[e] - lr_clamp(place[e], 0.0, f->length[e]);
        double q = excess[e] * excess[e] + outside * outside;
        if (q < smallest) {
            smallest = q;
            nearest = e;
        }
    }
    double n[3], side, distance = sqrt(h * h + smallest);
    if (place[nearest] > 0.0 && place[nearest] < f->length[nearest]) {
        uint32_t half_edge = 3 * t + (uint32_t)nearest;
        edge_normal(mesh, half_edge, f->n, n);
        side = h * lr_dot(n, f->n) + excess[nearest] * lr_dot(n, f->m[nearest]);
        *border = mesh->ring[half_edge] == half_edge; /* its only face is this one: height is set */
    } else {
        int corner = place[nearest] > 0.0 ? (nearest + 1) % 3 : nearest;
        bool rim = vertex_normal(mesh, t, corner, n);
        side = lr_dot(n, from[corner]);
        *border = rim && lr_dot(n, n) > 0.0;
        if (*border)
            *height = -side / sqrt(lr_dot(n, n));
    }
    if (side == 0.0) /* normals that cancel: the face's own side */
        side = h;
    distance = copysign(distance, -side);
    if (!*border)
        *height = distance;
    return distance;
}
