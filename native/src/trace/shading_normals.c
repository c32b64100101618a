/* The shading normals that hits at given points would have.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "trace/hit_normal.h"

static bool normal_at(const lr_volume *v, const double q[3], int32_t id, int32_t normal_kind,
                      double shading[3])
{
    double p[3], own[3], corner[8];
    int32_t c[3];
    for (int a = 0; a < 3; a++) {
        c[a] = (int32_t)lr_clamp(floor(q[a]), lr_first_cell(v), lr_last_cell(v, a));
        p[a] = lr_clamp(q[a] - c[a], 0.0, 1.0);
    }
    const uint32_t triangle = lr_triangle_cell_nearest(v, c, q);
    if (triangle != LR_NO_TRIANGLE) {
        lr_triangle_normals(v, triangle, c, p, normal_kind, own, shading);
        return true;
    }
    const int32_t object = lr_object_of(v, id);
    if (!lr_is_cubic(v))
        lr_block_of(v, object, c[0], c[1], c[2], 2, corner);
    if (!lr_field_normal(v, c, corner, p, own))
        return false;
    lr_field_shading_normal(v, object, id, c, p, normal_kind, own, shading);
    return true;
}

lr_status lr_volume_normals(const lr_volume *v, const double *points, const uint16_t *ids,
                            uint64_t n, int32_t normal_kind, double *normals, lr_error *error)
{
    if (!v->finished || v->planes[0] != NULL)
        return lr_fail(error, LR_E_ARGUMENT, "the volume is not finished, or rectilinear");
    const lr_status status = lr_check_choice("normal", normal_kind, LR_NORMAL_ZUCKER_HUMMEL, error);
    if (status != LR_OK)
        return status;
    for (uint64_t i = 0; i < n; i++) {
        double q[3], normal[3];
        lr_map_point(v->storage_from_object, points + 3 * i, q);
        const bool found =
            lr_all_finite(q, 3) && normal_at(v, q, ids != NULL ? ids[i] : 0, normal_kind, normal);
        for (int a = 0; a < 3; a++)
            normals[3 * i + (uint64_t)a] = found ? normal[a] : NAN;
    }
    return LR_OK;
}
