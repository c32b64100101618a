/* The distance to a triangle as seven linear forms.
 *
 * With the unit normal n, and for every edge its direction u and the outward
 * m = u x n, a point p has the height h = n.(p - a), the place t = u.(p - a)
 * along the edge and the excess e = m.(p - a) over it. Where no e is positive
 * the closest point lies in the face, at |h|; otherwise it lies on an edge, and
 * the squared distance is h^2 + e^2 + r^2, r being how far t lies outside the
 * edge's [0, length]; the smallest of the three counts. All forms are sums of
 * squares, so nothing cancels, however long the triangle.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_MESH_TRIANGLE_DISTANCE_H
#define LR_MESH_TRIANGLE_DISTANCE_H

#include "mesh/topology.h"

typedef struct lr_frame {
    double p[3][3]; /* corners */
    double n[3];
    double u[3][3], m[3][3];
    double length[3];
} lr_frame;

/* Fill the rest from p; false where the triangle has no area. */
LR_INLINE bool lr_frame_make(lr_frame *f)
{
    if (!lr_normal_of((const double (*)[3])f->p, f->n))
        return false;
    for (int e = 0; e < 3; e++) {
        lr_sub(f->p[(e + 1) % 3], f->p[e], f->u[e]);
        f->length[e] = sqrt(lr_dot(f->u[e], f->u[e]));
        for (int a = 0; a < 3; a++)
            f->u[e][a] /= f->length[e];
        lr_cross_product(f->u[e], f->n, f->m[e]);
    }
    return true;
}

/* Squared distance of a point. */
LR_INLINE double lr_frame_distance2(const lr_frame *f, const double p[3])
{
    double edge = INFINITY, from[3];
    bool in_face = true;
    for (int e = 0; e < 3; e++) {
        lr_sub(p, f->p[e], from);
        double excess = lr_dot(f->m[e], from), place = lr_dot(f->u[e], from);
        double outside = place - lr_clamp(place, 0.0, f->length[e]);
        edge = fmin(edge, excess * excess + outside * outside);
        in_face = in_face && excess <= 0.0;
    }
    double h = lr_dot(f->n, from);
    return h * h + (in_face ? 0.0 : edge);
}

#endif
