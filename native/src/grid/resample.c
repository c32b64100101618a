/* The field at points of object space.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/affine.h"
#include "base/error.h"
#include "grid/field.h"
#include "grid/quantize.h"

/* The storage cell along an axis that q lies in, and where in it; false outside. */
static bool locate(const lr_volume *v, int a, double q, int32_t *c, double *p)
{
    const int32_t first = lr_first_cell(v), last = lr_last_cell(v, a);
    const double *planes = v->planes[a];
    if (planes == NULL) {
        *c = (int32_t)lr_clamp(floor(q), first, last);
        *p = q - *c;
        return q >= first && q <= last + 1.0;
    }
    int32_t lo = first, hi = last;
    while (lo < hi) {
        const int32_t middle = hi - (hi - lo) / 2;
        if (planes[middle] <= q)
            lo = middle;
        else
            hi = middle - 1;
    }
    *c = lo;
    *p = (q - planes[lo]) / (planes[lo + 1] - planes[lo]);
    return q >= planes[first] && q <= planes[last + 1];
}

lr_status lr_volume_sample(const lr_volume *v, const double *points, const uint16_t *ids,
                           uint64_t n, double gain, double *value, double *gradient,
                           lr_error *error)
{
    if (!v->finished)
        return lr_fail(error, LR_E_ARGUMENT, "the volume is not finished");
    if (lr_is_cubic(v) && gain > 0.0)
        return lr_fail(error, LR_E_ARGUMENT, "a cubic volume keeps its samples as they are");
    const double one = gain > 0.0 ? LR_NARROW_ONE : v->one;
    for (uint64_t i = 0; i < n; i++) {
        double q[3], p[3], corner[8], g[3] = {0}, f = 0.0;
        int32_t c[3];
        lr_map_point(v->storage_from_object, points + 3 * i, q);
        bool inside = true;
        for (int a = 0; a < 3; a++)
            inside = locate(v, a, q[a], &c[a], &p[a]) && inside;
        if (inside && lr_is_cubic(v)) {
            f = lr_height_in(v, c, p, 0.0, g) / one;
        } else if (inside) {
            lr_block_of(v, ids != NULL ? lr_object_of(v, ids[i]) : LR_NO_OBJECT, c[0], c[1], c[2],
                        2, corner);
            for (int b = 0; b < 8 && gain > 0.0; b++)
                corner[b] = lr_narrowed(v, corner[b], gain);
            f = lr_trilinear(corner, p) / one;
            lr_trilinear_gradient(corner, p, g);
            lr_scale_gradient(v, c, g);
        }
        if (value != NULL)
            value[i] = f;
        if (gradient != NULL) {
            lr_map_gradient(v->storage_from_object, g, gradient + 3 * i);
            for (int a = 0; a < 3; a++)
                gradient[3 * i + (uint64_t)a] /= one;
        }
    }
    return LR_OK;
}
