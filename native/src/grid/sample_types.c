/* Samples of every type: what is done with many of them.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/sample_types.h"

#include <stdio.h>

#include "base/error.h"

const lr_type_of_samples lr_sample_types[] = {
#define LR_SAMPLE_TYPE(id, name, stored, one, step)                                                \
    [id] = {name, sizeof(stored), one, step, (stored)0.5 == 0},
#include "grid/sample_types.def"
#undef LR_SAMPLE_TYPE
};

enum { COUNT = sizeof lr_sample_types / sizeof lr_sample_types[0] };

lr_status lr_sample_type_check(int32_t type, lr_error *error)
{
    char known[24 * COUNT];
    if (type >= 0 && type < COUNT)
        return LR_OK;
    for (int i = 0, n = 0; i < COUNT; i++)
        n += snprintf(known + n, sizeof known - (size_t)n, "%s%s (%d)", i > 0 ? ", " : "",
                      lr_sample_types[i].name, i);
    return lr_fail(error, LR_E_ARGUMENT, "sample type %d is none of %s", type, known);
}

void lr_store_occupancies(void *samples, int32_t type, size_t at, const float *occupancy, size_t n)
{
    switch (type) {
#define LR_SAMPLE_TYPE(id, name, stored, one, step)                                                \
    case id:                                                                                       \
        for (size_t i = 0; i < n; i++)                                                             \
            ((stored *)samples)[at + i] =                                                          \
                (stored)(occupancy[i] * (float)(one) + ((stored)0.5 == 0 ? 0.5f : 0.0f));          \
        break;
#include "grid/sample_types.def"
#undef LR_SAMPLE_TYPE
    }
}

size_t lr_first_not_finite(const void *samples, int32_t type, size_t n)
{
    for (size_t i = 0; i < n && !lr_sample_types[type].whole; i++)
        if (!isfinite(lr_load_from(samples, type, i)))
            return i;
    return n;
}
