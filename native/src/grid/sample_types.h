/* Samples of every type, as sample_types.def describes them.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_SAMPLE_TYPES_H
#define LR_GRID_SAMPLE_TYPES_H

#include "base/base.h"

typedef struct lr_type_of_samples {
    const char *name;
    size_t nbytes; /* of a sample */
    double one;    /* the stored value of occupancy 1 */
    double step;   /* the largest between stored values of occupancies 0..1 */
    bool whole;    /* stored values are whole numbers */
} lr_type_of_samples;

extern const lr_type_of_samples lr_sample_types[]; /* by lr_sample_type */

/* LR_E_ARGUMENT for a number that is none of a sample type. */
lr_status lr_sample_type_check(int32_t type, lr_error *error);

/* The stored value of sample `at`. */
LR_INLINE double lr_load_from(const void *samples, int32_t type, size_t at)
{
    switch (type) {
#define LR_SAMPLE_TYPE(id, name, stored, one, step)                                                \
    case id:                                                                                       \
        return (double)((const stored *)samples)[at];
#include "grid/sample_types.def"
#undef LR_SAMPLE_TYPE
    }
    __builtin_unreachable();
}

/* Store a value that the type has. */
LR_INLINE void lr_store_to(void *samples, int32_t type, size_t at, double value)
{
    switch (type) {
#define LR_SAMPLE_TYPE(id, name, stored, one, step)                                                \
    case id:                                                                                       \
        ((stored *)samples)[at] = (stored)value;                                                   \
        return;
#include "grid/sample_types.def"
#undef LR_SAMPLE_TYPE
    }
}

/* Store n occupancies 0..1 from sample `at` on, each as the nearest value that the type has. */
void lr_store_occupancies(void *samples, int32_t type, size_t at, const float *occupancy, size_t n);

/* The first of n samples that is not finite; n: all are. */
size_t lr_first_not_finite(const void *samples, int32_t type, size_t n);

#endif
