/* Samples that volumes of several thresholds share: bricks of numbers as they were given, and how
 * far these reach in every brick, by which a threshold finds its surface cells.
 *
 * A brick takes memory unless it and its upper neighbours, of a cubic field all its neighbours, are
 * alike and constant, so that a surface cell's brick always does, whatever the threshold.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_SAMPLES_H
#define LR_GRID_SAMPLES_H

#include "grid/convert.h"
#include "grid/layout.h"

enum { LR_NONE_BEYOND = 1, LR_NONE_NUMBER = 2 /* beyond the lattice; a number that is none */ };

struct lr_samples {
    lr_samples_desc desc;
    lr_samples_map map;     /* outside and inside as they are stored */
    double no_data;         /* NaN: none */
    int32_t table_size[3];  /* bricks per axis */
    double *low, *high;     /* [table]: of the bricks' numbers, once allocated of their samples */
    uint8_t *none;          /* [table]: whether samples lie outside, and why */
    uint8_t *rounds;        /* [table]: 1 where some number is no float */
    uint32_t *table;        /* brick << 8; NULL until allocated */
    uint32_t n_bricks;      /* with the two constant ones */
    unsigned char *samples; /* [n_bricks][LR_CELLS] of map.sample_type */
    int32_t references;
};

/* One more owner, to be given to lr_samples_free. */
lr_samples *lr_samples_share(lr_samples *samples);

LR_INLINE size_t lr_samples_count(const lr_samples *s)
{
    return (size_t)s->table_size[0] * (size_t)s->table_size[1] * (size_t)s->table_size[2];
}

/* The samples of a stored brick. */
LR_INLINE unsigned char *lr_samples_of_brick(const lr_samples *s, uint32_t brick)
{
    return s->samples + (size_t)brick * LR_CELLS * lr_sample_types[s->map.sample_type].nbytes;
}

/* LR_E_ARGUMENT unless part is a layer of bricks. */
lr_status lr_samples_check_part(const lr_samples *samples, int32_t part, lr_error *error);

/* LR_E_ARGUMENT before lr_samples_allocate where that is wanted, or after. */
lr_status lr_samples_check_state(const lr_samples *samples, bool allocated, lr_error *error);

#endif
