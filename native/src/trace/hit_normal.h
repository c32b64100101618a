/* The normals of a hit: that of the surface itself, and that of shading.
 *
 * Both are unit vectors in object space, outward. The surface's own is that of the triangle
 * that was hit, or of the field. For shading a volume may carry the mesh's normals; where it
 * does not, the triangle's own stands for it, or differences of the samples around.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_HIT_NORMAL_H
#define LR_TRACE_HIT_NORMAL_H

#include "base/affine.h"
#include "grid/attributes/attributes.h"
#include "grid/triangle_cells.h"
#include "grid/field.h"

/* The outward unit normal in object space of a gradient in storage space; false
 * where there is none. */
LR_INLINE bool lr_outward(const lr_volume *v, const double gradient[3], double normal[3])
{
    lr_map_gradient(v->storage_from_object, gradient, normal);
    double length = sqrt(lr_dot(normal, normal));
    for (int a = 0; a < 3; a++)
        normal[a] /= -length;
    return length > 0.0 && isfinite(length);
}

/* The mesh's own shading normal, if the volume carries it, on the side of `own`: of a mesh
 * whose winding is not that of the solid the surface knows the outside. */
LR_INLINE bool lr_carried_normal(const lr_volume *v, const int32_t c[3], const double p[3],
                                 int32_t id, uint32_t triangle, const double own[3],
                                 double shading[3])
{
    if (!lr_volume_shading_normal(v, c, p, id, triangle, own, shading))
        return false;
    const double side = lr_dot(shading, own) < 0.0 ? -1.0 : 1.0;
    for (int a = 0; a < 3; a++)
        shading[a] *= side;
    return true;
}

/* On a triangle of a triangle cell, at p of storage cell c. */
LR_INLINE void lr_triangle_normals(const lr_volume *v, uint32_t triangle, const int32_t c[3],
                                   const double p[3], int32_t normal_kind, double own[3],
                                   double shading[3])
{
    double inward[3];
    lr_triangle_cell_normal(v->triangle_cells, triangle, inward);
    for (int a = 0; a < 3; a++)
        inward[a] = -inward[a];
    lr_outward(v, inward, own);
    if (normal_kind == LR_NORMAL_ANALYTIC || !lr_carried_normal(v, c, p, 0, triangle, own, shading))
        memcpy(shading, own, 3 * sizeof *own);
}

/* That of the field; false where it vanishes. corner: not of a cubic volume. */
LR_INLINE bool lr_field_normal(const lr_volume *v, const int32_t c[3], const double corner[8],
                               const double p[3], double own[3])
{
    double g[3];
    if (lr_is_cubic(v)) {
        lr_height_in(v, c, p, v->threshold, g);
    } else {
        lr_trilinear_gradient(corner, p, g);
        lr_scale_gradient(v, c, g);
    }
    return lr_outward(v, g, own);
}

/* For shading, where the field was hit, whose own normal is given: of a cubic field that is smooth,
 * and stays unless differences are to be averaged. Beside a crease, and of flat-shaded meshes,
 * differences across cells would see the other side. */
LR_INLINE void lr_field_shading_normal(const lr_volume *v, int32_t object, int32_t id,
                                       const int32_t c[3], const double p[3], int32_t normal_kind,
                                       const double own[3], double shading[3])
{
    double g[3];
    memcpy(shading, own, 3 * sizeof *own);
    if (normal_kind == LR_NORMAL_ANALYTIC ||
        lr_carried_normal(v, c, p, id, LR_NO_TRIANGLE, own, shading) || v->flat ||
        lr_near_doubt(v, c) || (lr_is_cubic(v) && normal_kind <= LR_NORMAL_SMOOTH))
        return;
    if (normal_kind == LR_NORMAL_CENTRAL)
        lr_central_gradient(v, object, c, p, g);
    else if (normal_kind == LR_NORMAL_SMOOTH)
        lr_smooth_gradient(v, object, c, p, g);
    else
        lr_averaged_gradient(v, object, c, p,
                             normal_kind == LR_NORMAL_SOBEL ? lr_sobel : lr_zucker_hummel, g);
    if (!lr_outward(v, g, shading))
        memcpy(shading, own, 3 * sizeof *own);
}

#endif
