/* Numbers of all types, in rows: least and largest, and their stored values.
 *
 * Whole numbers become whole numbers by arithmetic modulo 2^32, of which the samples keep the low
 * bits: exact, and quick. All others go through double precision, which holds them.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/convert.h"

#include <float.h>

/* id, C type, whole, least, largest */
#define LR_NUMBERS(X)                                                                              \
    X(LR_NUMBER_U8, uint8_t, 1, 0, UINT8_MAX)                                                      \
    X(LR_NUMBER_I8, int8_t, 1, INT8_MIN, INT8_MAX)                                                 \
    X(LR_NUMBER_U16, uint16_t, 1, 0, UINT16_MAX)                                                   \
    X(LR_NUMBER_I16, int16_t, 1, INT16_MIN, INT16_MAX)                                             \
    X(LR_NUMBER_U32, uint32_t, 1, 0, UINT32_MAX)                                                   \
    X(LR_NUMBER_I32, int32_t, 1, INT32_MIN, INT32_MAX)                                             \
    X(LR_NUMBER_F32, float, 0, -INFINITY, INFINITY)                                                \
    X(LR_NUMBER_F64, double, 0, -INFINITY, INFINITY)

size_t lr_number_nbytes(int32_t type)
{
    switch (type) {
#define NBYTES(id, number, whole, least, most)                                                     \
    case id:                                                                                       \
        return sizeof(number);
        LR_NUMBERS(NBYTES)
#undef NBYTES
    }
    return 0;
}

bool lr_is_number(int32_t type, double value)
{
    switch (type) {
#define HOLDS(id, number, whole, least, most)                                                      \
    case id:                                                                                       \
        return value >= (double)(least) && value <= (double)(most) &&                              \
               (double)(number)value == value;
        LR_NUMBERS(HOLDS)
#undef HOLDS
    }
    return false;
}

/* ---- least and largest --------------------------------------------------- */

void lr_columns_begin(const lr_columns *c, int32_t type, size_t n)
{
    memset(c->none, 0, n);
    switch (type) {
#define BEGIN(id, number, whole, least, most)                                                      \
    case id:                                                                                       \
        for (size_t i = 0; i < n; i++) {                                                           \
            ((number *)c->low)[i] = most;                                                          \
            ((number *)c->high)[i] = least;                                                        \
        }                                                                                          \
        break;
        LR_NUMBERS(BEGIN)
#undef BEGIN
    }
}

/* Rows whose numbers all lie inside are the rule, and quick. */
#define ADD(id, number, whole, least, most)                                                        \
    static bool any_none_##id(const number *row, size_t n, bool has_none, number no_data)          \
    {                                                                                              \
        number any = 0;                                                                            \
        for (size_t i = 0; i < n && !(whole); i++)                                                 \
            any += (number)(row[i] - row[i] != 0); /* of infinities, too */                        \
        for (size_t i = 0; i < n && has_none; i++)                                                 \
            any = row[i] == no_data ? 1 : any;                                                     \
        return any != 0;                                                                           \
    }                                                                                              \
    static void add_##id(const lr_columns *c, const number *row, size_t n, bool has_none,          \
                         number no_data)                                                           \
    {                                                                                              \
        number *low = c->low, *high = c->high;                                                     \
        if (!any_none_##id(row, n, has_none, no_data)) {                                           \
            for (size_t i = 0; i < n; i++) {                                                       \
                low[i] = row[i] < low[i] ? row[i] : low[i];                                        \
                high[i] = row[i] > high[i] ? row[i] : high[i];                                     \
            }                                                                                      \
            return;                                                                                \
        }                                                                                          \
        for (size_t i = 0; i < n; i++) {                                                           \
            const bool outside = (has_none && row[i] == no_data) || row[i] != row[i];              \
            low[i] = !outside && row[i] < low[i] ? row[i] : low[i];                                \
            high[i] = !outside && row[i] > high[i] ? row[i] : high[i];                             \
            c->none[i] |= outside;                                                                 \
        }                                                                                          \
    }
LR_NUMBERS(ADD)
#undef ADD

static bool rounds(const double *row, size_t n)
{
    bool any = false;
    for (size_t i = 0; i < n; i++)
        any |= (double)(float)row[i] != row[i] && row[i] == row[i];
    return any;
}

void lr_columns_add(lr_columns *c, int32_t type, double no_data, const void *row, size_t n)
{
    if (type == LR_NUMBER_F64 && !c->rounds)
        c->rounds = rounds(row, n);
    switch (type) {
#define ADD(id, number, whole, least, most)                                                        \
    case id:                                                                                       \
        add_##id(c, row, n, !isnan(no_data), isnan(no_data) ? 0 : (number)no_data);                \
        break;
        LR_NUMBERS(ADD)
#undef ADD
    }
}

void lr_columns_range(const lr_columns *c, int32_t type, size_t first, size_t last, double *low,
                      double *high, bool *none)
{
    switch (type) {
#define RANGE(id, number, whole, least, most)                                                      \
    case id:                                                                                       \
        for (size_t i = first; i <= last; i++) {                                                   \
            const number a = ((const number *)c->low)[i], b = ((const number *)c->high)[i];        \
            if (a <= b) {                                                                          \
                *low = fmin(*low, (double)a);                                                      \
                *high = fmax(*high, (double)b);                                                    \
            }                                                                                      \
            *none = *none || c->none[i];                                                           \
        }                                                                                          \
        break;
        LR_NUMBERS(RANGE)
#undef RANGE
    }
}

/* ---- stored values ------------------------------------------------------- */

LR_INLINE float nearest_float(const lr_samples_map *m, double number)
{
    return (float)lr_clamp(m->gain * number - m->base, -(double)FLT_MAX, (double)FLT_MAX);
}

/* Of a map onto floats. Where numbers are rounded, none comes to the other side of the threshold,
 * nor onto it from outside. */
LR_INLINE float to_float(const lr_samples_map *m, double number)
{
    const float nearest = nearest_float(m, number);
    if (!m->rounded)
        return nearest;
    const float level = nearest_float(m, m->threshold);
    const bool inside = m->gain > 0.0 ? number >= m->threshold : number <= m->threshold;
    return inside ? fmaxf(nearest, level) : fminf(nearest, nextafterf(level, -INFINITY));
}

double lr_stored_of(const lr_samples_map *m, double number)
{
    return m->sample_type == LR_F32 ? (double)to_float(m, number) : m->gain * number - m->base;
}

#define WHOLE(sample, number)                                                                      \
    static void number##_as_##sample(const lr_samples_map *m, double no_data, const number *from,  \
                                     size_t n, sample *to)                                         \
    {                                                                                              \
        const uint32_t flip = m->gain < 0.0 ? UINT32_MAX : 0;                                      \
        const uint32_t base = (uint32_t)(int64_t)m->base + flip;                                   \
        if (isnan(no_data)) {                                                                      \
            for (size_t i = 0; i < n; i++)                                                         \
                to[i] = (sample)(((uint32_t)from[i] ^ flip) - base);                               \
            return;                                                                                \
        }                                                                                          \
        const number none = (number)no_data;                                                       \
        for (size_t i = 0; i < n; i++)                                                             \
            to[i] = from[i] == none ? 0 : (sample)(((uint32_t)from[i] ^ flip) - base);             \
    }
#define REAL(sample, number)                                                                       \
    static void number##_as_##sample(const lr_samples_map *m, double no_data, const number *from,  \
                                     size_t n, sample *to)                                         \
    {                                                                                              \
        for (size_t i = 0; i < n; i++) {                                                           \
            const double x = (double)from[i];                                                      \
            to[i] = x == no_data || isnan(x) ? 0 : (sample)(m->gain * x - m->base);                \
        }                                                                                          \
    }
#define FLOATS(number)                                                                             \
    static void number##_as_float(const lr_samples_map *m, double no_data, const number *from,     \
                                  size_t n, float *to)                                             \
    {                                                                                              \
        for (size_t i = 0; i < n; i++) {                                                           \
            const double x = (double)from[i];                                                      \
            to[i] = x == no_data || isnan(x) ? (float)m->outside : to_float(m, x);                 \
        }                                                                                          \
    }
#define EACH_WHOLE(id, number, whole, least, most)                                                 \
    EACH_WHOLE_##whole(uint8_t, number) EACH_WHOLE_##whole(uint16_t, number) FLOATS(number)
#define EACH_WHOLE_1 WHOLE
#define EACH_WHOLE_0 REAL
LR_NUMBERS(EACH_WHOLE)

/* Floats that stay what they are, or change signs: nothing is rounded. */
static void keep_floats(const lr_samples_map *m, double no_data, const float *from, size_t n,
                        float *to)
{
    const float gain = (float)m->gain, outside = (float)m->outside, none = (float)no_data;
    for (size_t i = 0; i < n; i++) {
        float x = gain * from[i];
        x = x > FLT_MAX ? FLT_MAX : x;
        x = x < -FLT_MAX ? -FLT_MAX : x;
        x = x != x ? outside : x;
        to[i] = from[i] == none ? outside : x;
    }
}

void lr_store_numbers(const lr_samples_map *m, int32_t type, double no_data, const void *numbers,
                      size_t n, void *samples)
{
    if (type == LR_NUMBER_F32 && m->sample_type == LR_F32 && !m->rounded && fabs(m->gain) == 1.0 &&
        m->base == 0.0) {
        keep_floats(m, no_data, numbers, n, samples);
        return;
    }
    switch (type) {
#define STORE(id, number, whole, least, most)                                                      \
    case id:                                                                                       \
        if (m->sample_type == LR_U8)                                                               \
            number##_as_uint8_t(m, no_data, numbers, n, samples);                                  \
        else if (m->sample_type == LR_U16)                                                         \
            number##_as_uint16_t(m, no_data, numbers, n, samples);                                 \
        else                                                                                       \
            number##_as_float(m, no_data, numbers, n, samples);                                    \
        break;
        LR_NUMBERS(STORE)
#undef STORE
    }
}
