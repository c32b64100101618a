/* Numbers as files hold them: looked at in rows, and stored as samples.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_CONVERT_H
#define LR_GRID_CONVERT_H

#include "grid/sample_types.h"

/* What a column of numbers holds: one for each number of a row, of many rows. */
typedef struct lr_columns {
    void *low, *high; /* of the numbers' type */
    uint8_t *none;    /* 1: one of them lies outside */
    bool rounds;      /* some number is no float */
} lr_columns;

size_t lr_number_nbytes(int32_t number_type);

/* no_data as rows are compared with it; false: no number of that type equals it. */
bool lr_is_number(int32_t number_type, double value);

/* Begin n columns; then add rows of as many numbers. no_data: NaN for none. */
void lr_columns_begin(const lr_columns *columns, int32_t number_type, size_t n);
void lr_columns_add(lr_columns *columns, int32_t number_type, double no_data, const void *row,
                    size_t n);

/* Of columns first..last. */
void lr_columns_range(const lr_columns *columns, int32_t number_type, size_t first, size_t last,
                      double *low, double *high, bool *none);

/* Store n numbers as samples, as the map says. */
void lr_store_numbers(const lr_samples_map *map, int32_t number_type, double no_data,
                      const void *numbers, size_t n, void *samples);

/* The stored value of a number that lies inside. */
double lr_stored_of(const lr_samples_map *map, double number);

#endif
