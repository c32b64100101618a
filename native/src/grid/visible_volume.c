/* Visible volumes: shared samples and a transfer function, of stored numbers, by which their cells
 * are classified.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "grid/isosurface.h"
#include "grid/transfer_function.h"

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
    lr_status status = lr_samples_check_state(s, true, error);
    if (status == LR_OK)
        status = lr_transfer_of_numbers(transfer, scale, offset, &numbers, error);
    if (status != LR_OK)
        return status;
    const bool whole = lr_sample_types[s->map.sample_type].whole;
    status = check(s, numbers, bounded, error);
    if (status == LR_OK)
        status = lr_isosurface_share(s, LR_KIND_SOLID, whole ? 1.0 : s->map.inside, &v, error);
    if (status != LR_OK) {
        lr_transfer_free(numbers);
        return status;
    }
    v->transfer = numbers;
    v->value_scale = scale;
    v->value_offset = offset;
    v->bounded = bounded != 0;
    v->everywhere = everywhere != 0;
    if (v->everywhere || lr_transfer_sees(numbers, v->inside, v->inside))
        memset(v->cells[LR_BRICK_ONE], 0xff, sizeof *v->cells);
    *volume = v;
    return LR_OK;
}
