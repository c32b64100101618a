/* Visible volumes: shared samples and a transfer function, of stored numbers, by which their cells
 * are classified.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "grid/isosurface.h"
#include "grid/transfer_function.h"

/* ---- samples that nothing needs --------------------------------------------------- */

/* Is anything visible in a brick's cells? They reach into the bricks above. */
static bool is_seen(const lr_samples *s, const lr_transfer *numbers, const int32_t b[3])
{
    double low = INFINITY, high = -INFINITY;
    for (int n = 0; n < lr_support_count(false); n++) {
        int32_t to[3];
        lr_support_brick(false, n, b, to);
        if (!lr_has_brick(s->table_size, to))
            continue;
        const size_t at = lr_place_of(s->table_size, to[0], to[1], to[2]);
        low = fmin(low, s->low[at]);
        high = fmax(high, s->high[at]);
    }
    return low <= high && lr_transfer_sees(numbers, low, high);
}

/* Mark a brick, and those that its cells reach into. Those below it, where differences at its
 * samples reach, are marked as well, for what is seen of it is within their range, too. */
static void need(const lr_samples *s, const int32_t b[3], uint8_t *needed)
{
    for (int n = 0; n < lr_support_count(false); n++) {
        int32_t to[3];
        lr_support_brick(false, n, b, to);
        if (lr_has_brick(s->table_size, to))
            needed[lr_place_of(s->table_size, to[0], to[1], to[2])] = 1;
    }
}

lr_status lr_samples_hide(lr_samples *s, const lr_transfer *transfer, double scale, double offset,
                          lr_error *error)
{
    lr_transfer *numbers;
    lr_status status = lr_samples_check_state(s, false, error);
    if (status == LR_OK)
        status = lr_transfer_of_numbers(transfer, scale, offset, &numbers, error);
    if (status != LR_OK)
        return status;
    const size_t count = lr_samples_count(s);
    uint8_t *needed = calloc(count, sizeof *needed);
    if (needed == NULL) {
        lr_transfer_free(numbers);
        return lr_fail_memory(error, count * sizeof *needed, "the bricks that are seen");
    }
    int32_t b[3] = {-1, 0, 0};
    while (lr_next_brick(s->table_size, b))
        if (is_seen(s, numbers, b))
            need(s, b, needed);
    for (size_t at = 0; at < count; at++) {
        if (needed[at])
            continue;
        s->low[at] = INFINITY; /* as if it lay outside */
        s->high[at] = -INFINITY;
        s->none[at] |= LR_NONE_BEYOND;
    }
    free(needed);
    lr_transfer_free(numbers);
    return LR_OK;
}

/* ---- volumes ------------------------------------------------------------------------ */

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
