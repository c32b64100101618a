/* The trilinear field at points of object space.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "error.h"
#include "volume/affine.h"
#include "volume/field.h"

lr_status lr_volume_sample(const lr_volume *v, const double *points, const uint16_t *ids,
                           uint64_t n, double *value, double *gradient, lr_error *error)
{
    if (!v->finished)
        return lr_fail(error, LR_E_ARGUMENT, "the volume is not finished");
    const int32_t last[3] = {v->desc.nx + 1, v->desc.ny + 1, v->desc.nz + 1}; /* storage cells */
    for (uint64_t i = 0; i < n; i++) {
        double q[3], p[3], corner[8], g[3] = {0}, f = 0.0;
        int32_t c[3];
        lr_map_point(v->storage_from_object, points + 3 * i, q);
        bool inside = true;
        for (int a = 0; a < 3; a++) {
            inside = inside && q[a] >= 1.0 && q[a] <= last[a] + 1.0;
            c[a] = (int32_t)lr_clamp(floor(q[a]), 1.0, last[a]);
            p[a] = q[a] - c[a];
        }
        if (inside) {
            lr_block_of(v, ids != NULL ? lr_object_of(v, ids[i]) : LR_NO_OBJECT, c[0], c[1], c[2],
                        2, corner);
            f = lr_trilinear(corner, p) / v->one;
            lr_trilinear_gradient(corner, p, g);
        }
        if (value != NULL)
            value[i] = f;
        if (gradient != NULL) {
            lr_map_gradient(v->storage_from_object, g, gradient + 3 * i);
            for (int a = 0; a < 3; a++)
                gradient[3 * i + (uint64_t)a] /= v->one;
        }
    }
    return LR_OK;
}
