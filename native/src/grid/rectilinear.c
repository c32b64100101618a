/* Rectilinear volumes: tables of where the planes of samples lie.
 *
 * A table begins with the planes of storage sample 0 and goes on beyond the lattice as
 * far as any structure's boxes reach, in even steps, so that no one has to ask whether
 * a plane is in it.
 *
 * Source: Slater 1992.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/affine.h"
#include "base/error.h"
#include "grid/brick_grid.h"

/* Cells along a cube of 2^k that holds the whole table of bricks. */
static int32_t cube_side(const lr_volume *v)
{
    int32_t side = LR_SIDE;
    for (int a = 0; a < 3; a++)
        while (side < LR_SIDE * v->table_size[a])
            side *= 2;
    return side;
}

static lr_status check_planes(const double *x, int32_t n, char axis, lr_error *error)
{
    for (int32_t i = 0; i < n; i++) {
        if (!isfinite(x[i]))
            return lr_fail(error, LR_E_ARGUMENT, "planes must be finite; plane %d along %c is %g",
                           i, axis, x[i]);
        if (i > 0 && !(x[i] > x[i - 1] && isfinite(x[i] - x[i - 1])))
            return lr_fail(error, LR_E_ARGUMENT,
                           "planes must increase; along %c plane %d lies at %.17g and plane %d "
                           "at %.17g",
                           axis, i - 1, x[i - 1], i, x[i]);
    }
    return LR_OK;
}

/* False where planes beyond the lattice are too near together to be told apart. */
static bool fill_table(double *table, int32_t n_planes, const double *x, int32_t n)
{
    const double first = n > 1 ? x[1] - x[0] : 1.0, last = n > 1 ? x[n - 1] - x[n - 2] : 1.0;
    bool increases = true;
    for (int32_t k = 0; k < n_planes; k++) {
        const int32_t i = k - LR_PAD;
        table[k] = i < 0 ? x[0] + i * first : i < n ? x[i] : x[n - 1] + (i - n + 1) * last;
        increases = increases && isfinite(table[k]) && (k == 0 || table[k] > table[k - 1]);
    }
    return increases;
}

lr_status lr_volume_set_planes(lr_volume *v, const double *x, const double *y, const double *z,
                               lr_error *error)
{
    const double *given[3] = {x, y, z};
    const int32_t n[3] = {v->desc.nx, v->desc.ny, v->desc.nz};
    if (v->finished || v->planes[0] != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       v->finished ? "a finished volume takes no planes"
                                   : "the volume has its planes already");
    if (lr_is_cubic(v))
        return lr_fail(error, LR_E_ARGUMENT, "a cubic volume takes no planes");
    for (int a = 0; a < 3; a++) {
        lr_status status = check_planes(given[a], n[a], "xyz"[a], error);
        if (status != LR_OK)
            return status;
    }
    const int32_t n_planes = cube_side(v) + 1;
    double *table = malloc(3 * (size_t)n_planes * sizeof *table);
    if (table == NULL)
        return lr_fail_memory(error, 3 * (uint64_t)n_planes * sizeof *table, "tables of planes");
    for (int a = 0; a < 3; a++)
        if (!fill_table(table + (size_t)a * (size_t)n_planes, n_planes, given[a], n[a])) {
            free(table);
            return lr_fail(error, LR_E_ARGUMENT,
                           "the outermost planes along %c lie too near together", "xyz"[a]);
        }
    for (int a = 0; a < 3; a++)
        v->planes[a] = table + (size_t)a * (size_t)n_planes;
    v->n_planes = n_planes;
    memcpy(v->object_from_storage, v->desc.object_from_index, sizeof v->object_from_storage);
    lr_affine_invert(v->desc.object_from_index,
                     v->storage_from_object); /* as lr_volume_begin saw */
    return LR_OK;
}
