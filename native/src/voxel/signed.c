/* Signed distance from a point to the triangle that is nearest to it, in f64.
 *
 * Source: Baerentzen and Aanaes 2005 for the sign; see mesh.c and frame.h.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxel/brick.h"
#include "voxel/frame.h"

/* Sum of the unit normals of the faces around an edge. */
static void edge_normal(const lr_topology *mesh, uint32_t half_edge, double sum[3])
{
    uint32_t h = half_edge;
    for (int a = 0; a < 3; a++)
        sum[a] = 0.0;
    do {
        double p[3][3], n[3];
        lr_triangle(mesh, h / 3, p);
        lr_normal_of((const double(*)[3])p, n);
        for (int a = 0; a < 3; a++)
            sum[a] += n[a];
        h = mesh->ring[h];
    } while (h != half_edge);
}

double lr_signed_distance(const lr_topology *mesh, uint32_t t, const lr_frame *f,
                          const double p[3], double *height)
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
    bool border;
    if (place[nearest] > 0.0 && place[nearest] < f->length[nearest]) {
        uint32_t half_edge = 3 * t + (uint32_t)nearest;
        edge_normal(mesh, half_edge, n);
        side = h * lr_dot(n, f->n) + excess[nearest] * lr_dot(n, f->m[nearest]);
        border = mesh->ring[half_edge] == half_edge; /* its only face is this one: height is set */
    } else {
        int corner = place[nearest] > 0.0 ? (nearest + 1) % 3 : nearest;
        uint32_t v = lr_welded(mesh, t, corner);
        const double *sum = mesh->vertex_normal[v];
        side = lr_dot(sum, from[corner]);
        border = mesh->at_border[v] && lr_dot(sum, sum) > 0.0;
        if (border)
            *height = -side / sqrt(lr_dot(sum, sum));
    }
    if (side == 0.0) /* normals that cancel: the face's own side */
        side = h;
    distance = copysign(distance, -side);
    if (!border)
        *height = distance;
    return distance;
}
