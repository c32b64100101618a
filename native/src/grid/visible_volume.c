/* Visible volumes: shared samples and a transfer function, of stored numbers, by which their cells
 * are classified.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "grid/isosurface.h"
#include "grid/transfer_function.h"

static void describe(const lr_samples *s, lr_volume_desc *d)
{
    const bool whole = lr_sample_types[s->map.sample_type].whole;
    *d = (lr_volume_desc){.nx = s->desc.nx,
                          .ny = s->desc.ny,
                          .nz = s->desc.nz,
                          .sample_type = s->map.sample_type,
                          .kind = LR_KIND_SOLID,
                          .interpolation = s->desc.interpolation,
                          .threshold = whole ? 1.0 : s->map.inside,
                          .outside = whole ? 0.0 : s->map.outside,
                          .inside = whole ? 1.0 : s->map.inside};
    memcpy(d->object_from_index, s->desc.object_from_index, sizeof d->object_from_index);
}

static lr_status check(const lr_samples *s, const lr_transfer *numbers, int32_t bounded,
                       lr_error *error)
{
    if (s->desc.interpolation != LR_VOLUME_LINEAR)
        return lr_fail(error, LR_E_ARGUMENT,
                       "volumes of a transfer function are trilinear: interpolation must be "
                       "linear, not cubic");
    if (!(s->map.outside < s->map.inside))
        return lr_fail(error, LR_E_ARGUMENT,
                       "outside must lie below inside; they are stored as %g and %g",
                       s->map.outside, s->map.inside);
    if (!bounded && lr_transfer_sees(numbers, s->map.outside, s->map.outside))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the background is visible by this transfer function: the volume would "
                       "fill all of space");
    return LR_OK;
}

lr_status lr_visible_begin(lr_samples *s, const lr_transfer *transfer, double scale, double offset,
                           int32_t bounded, int32_t everywhere, lr_volume **volume, lr_error *error)
{
    lr_transfer *numbers;
    lr_volume *v;
    lr_volume_desc desc;
    lr_status status = lr_samples_check_state(s, true, error);
    if (status == LR_OK)
        status = lr_transfer_of_numbers(transfer, scale, offset, &numbers, error);
    if (status != LR_OK)
        return status;
    describe(s, &desc);
    status = check(s, numbers, bounded, error);
    if (status == LR_OK)
        status = lr_isosurface_share(s, &desc, &v, error);
    if (status != LR_OK) {
        lr_transfer_free(numbers);
        return status;
    }
    v->transfer = numbers;
    if (v->everywhere || lr_transfer_sees(numbers, v->inside, v->inside))
        memset(v->cells[LR_BRICK_ONE], 0xff, sizeof *v->cells);
    v->value_scale = scale;
    v->value_offset = offset;
    v->bounded = bounded != 0;
    v->everywhere = everywhere != 0;
    *volume = v;
    return LR_OK;
}
