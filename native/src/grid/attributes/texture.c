/* Textures: a pyramid of averages, bilinear within a level, blended between two.
 *
 * A stretched footprint is averaged by some looks along its long axis, each as wide
 * as the short one, so that a texture seen obliquely through UVs neither aliases nor
 * blurs more than the voxel does.
 *
 * Texels in sRGB are interpolated as they are and made linear afterwards, as Cycles
 * does: a step between them looks darker than its linear mean. So are texels with a
 * program, which runs at every look. So the first averages are those of what is looked
 * up, not of texels: a texture is as bright from afar.
 *
 * Source: Williams 1983, Pyramidal parametrics. Departures: 1. levels of any size
 * are averaged by exact shares of texels, not only powers of two; 2. looks along the
 * long axis as graphics hardware takes them.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/attributes/texture.h"

#include "base/error.h"
#include "grid/attributes/shader_program.h"

enum {
    MAX_SIDE = 1 << 16,
    MOST_LOOKS = 16,
    POLL = 1 << 12 /* output texels between looks at the stop word */
};

#define NO_DIGITS 1e9 /* of a coordinate: none are left within a texel */

LR_INLINE double finite_or_black(float x)
{
    return isfinite(x) ? (double)x : 0.0;
}

LR_INLINE double from_srgb(double x)
{
    return x < 0.04045 ? x / 12.92 : pow((x + 0.055) / 1.055, 2.4);
}

/* The texel that stands for index i of n; -1: black. */
LR_INLINE int32_t extended(double i, int32_t n, int32_t extension)
{
    if (i >= 0.0 && i < n)
        return (int32_t)i;
    switch (extension) {
    case LR_EXTENSION_REPEAT:
        return (int32_t)lr_clamp(i - floor(i / n) * n, 0.0, n - 1);
    case LR_EXTENSION_MIRROR: {
        double j = i - floor(i / (2.0 * n)) * 2.0 * n;
        return (int32_t)lr_clamp(j < n ? j : 2.0 * n - 1.0 - j, 0.0, n - 1);
    }
    case LR_EXTENSION_CLIP:
        return -1;
    default:
        return (int32_t)lr_clamp(i, 0.0, n - 1);
    }
}

/* ---- the pyramid ------------------------------------------------------- */

/* Texels of the finer level that cell i of n covers: the first, and how much of the
 * three or fewer that follow. */
static int shares(int32_t i, int32_t n, int32_t finer, double share[4])
{
    const double lo = (double)i * finer / n, hi = (double)(i + 1) * finer / n;
    const int first = (int)lo;
    for (int k = 0; k < 4; k++) {
        double from = first + k > lo ? first + k : lo, to = first + k + 1 < hi ? first + k + 1 : hi;
        share[k] = to > from ? (to - from) / (hi - lo) : 0.0;
    }
    return first;
}

/* What is looked up in a texel of bytes, on the average: the mean of its four quarters'
 * middles. */
static void byte_average(const lr_texture *t, int x, int y, double out[3])
{
    const uint8_t *row[3], black[3] = {0, 0, 0};
    int32_t column[3];
    const bool steps = t->interpolation == LR_INTERPOLATION_CLOSEST;
    for (int k = 0; k < 3; k++) {
        const int32_t j = extended(y + k - 1, t->height[0], t->extension);
        row[k] = j < 0 ? NULL : t->bytes + 3 * (size_t)j * (size_t)t->width[0];
        column[k] = extended(x + k - 1, t->width[0], t->extension);
    }
    memset(out, 0, 3 * sizeof *out);
    for (int q = 0; q < 4; q++) {
        const int i = q & 1 ? 2 : 0, j = q >> 1 ? 2 : 0;
        const uint8_t *own = row[1] + 3 * column[1];
        const uint8_t *side = column[i] < 0 ? black : row[1] + 3 * column[i];
        const uint8_t *over = row[j] == NULL ? black : row[j] + 3 * column[1];
        const uint8_t *both = row[j] == NULL || column[i] < 0 ? black : row[j] + 3 * column[i];
        for (int a = 0; a < 3; a++)
            out[a] +=
                0.25 * (double)t->linear[steps ? LR_STEPS * own[a]
                                               : 9 * own[a] + 3 * side[a] + 3 * over[a] + both[a]];
    }
}

/* The same of any texel of level 0, by four looks. */
static void look_average(const lr_texture *t, int x, int y, double out[3])
{
    memset(out, 0, 3 * sizeof *out);
    for (int q = 0; q < 4; q++) {
        const double at[2] = {(x + (q & 1 ? 0.75 : 0.25)) / t->width[0],
                              (y + (q >> 1 ? 0.75 : 0.25)) / t->height[0]};
        double rgb[3];
        lr_texture_look(t, at, rgb);
        for (int a = 0; a < 3; a++)
            out[a] += 0.25 * rgb[a];
    }
}

static void average(const lr_texture *t, int level, int x, const double sx[4], int y,
                    const double sy[4], float out[3])
{
    const int32_t width = t->width[level];
    double sum[3] = {0.0, 0.0, 0.0};
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < 4; i++) {
            if (!(sx[i] > 0.0 && sy[j] > 0.0))
                continue;
            double mean[3];
            if (level == 0 && (t->program != NULL || t->interpolation == LR_INTERPOLATION_CUBIC)) {
                look_average(t, x + i, y + j, mean);
            } else if (level == 0 && t->bytes != NULL) {
                byte_average(t, x + i, y + j, mean);
            } else {
                const float *texel =
                    t->pixels[level] + 3 * ((size_t)(y + j) * (size_t)width + (size_t)(x + i));
                for (int a = 0; a < 3; a++)
                    mean[a] = finite_or_black(texel[a]);
            }
            for (int a = 0; a < 3; a++)
                sum[a] += sx[i] * sy[j] * mean[a];
        }
    for (int a = 0; a < 3; a++)
        out[a] = (float)sum[a];
}

static bool shrink(const lr_texture *t, int level, float *out, const lr_watch *watch)
{
    const int32_t w = t->width[level], h = t->height[level];
    size_t done = 0;
    for (int32_t y = 0; y < h; y++) {
        double sx[4], sy[4];
        int fy = shares(y, h, t->height[level - 1], sy);
        for (int32_t x = 0; x < w; x++) {
            if (done++ % POLL == 0 && lr_stopped(watch))
                return false;
            int fx = shares(x, w, t->width[level - 1], sx);
            average(t, level - 1, fx, sx, fy, sy, out);
            out += 3;
        }
    }
    return true;
}

/* Sizes of the levels; texels of all but the first. */
static size_t plan_levels(lr_texture *t)
{
    size_t n = 0;
    t->n_levels = 1;
    for (int l = 0; t->width[l] > 1 || t->height[l] > 1; l++) {
        t->width[l + 1] = lr_max_i(t->width[l] / 2, 1);
        t->height[l + 1] = lr_max_i(t->height[l] / 2, 1);
        n += (size_t)t->width[l + 1] * (size_t)t->height[l + 1];
        t->n_levels = l + 2;
    }
    return n;
}

static lr_status make(lr_texture *t, bool points_only, const lr_watch *watch, lr_error *error)
{
    if (points_only || lr_texture_is_of_corners(t)) {
        t->n_levels = 1;
        t->nbytes = sizeof *t;
        return LR_OK;
    }
    const size_t steps = t->bytes != NULL && t->program == NULL ? LR_STEPS * 255 + 1 : 0;
    const size_t n = steps + 3 * plan_levels(t);
    t->nbytes = sizeof *t + n * sizeof *t->own;
    t->own = malloc((n + 1) * sizeof *t->own);
    if (t->own == NULL)
        return lr_fail_memory(error, t->nbytes, "the smaller versions of an image");
    t->linear = steps > 0 ? t->own : NULL;
    float *next = t->own + steps;
    for (size_t i = 0; i < steps; i++)
        t->linear[i] = (float)from_srgb((double)i / (LR_STEPS * 255.0));
    for (int l = 1; l < t->n_levels; l++) {
        if (!shrink(t, l, next, watch))
            return lr_fail_stopped(error);
        t->pixels[l] = next;
        next += 3 * (size_t)t->width[l] * (size_t)t->height[l];
    }
    return LR_OK;
}

static lr_status check(const lr_texture_desc *d, lr_error *error)
{
    if (d->pixels == NULL && d->program == NULL)
        return lr_fail(error, LR_E_ARGUMENT, "a texture needs pixels or a program");
    if (d->sample_type != LR_U8 && d->sample_type != LR_F32)
        return lr_fail(error, LR_E_ARGUMENT, "pixels are of u8 (sRGB) or f32 (linear), not of %d",
                       d->sample_type);
    if (d->channels != 3 && !(d->channels == 4 && d->program != NULL))
        return lr_fail(error, LR_E_ARGUMENT, "pixels have 3 channels, or 4 with a program, not %d",
                       d->channels);
    if (d->width < 1 || d->height < 1 || d->width > MAX_SIDE || d->height > MAX_SIDE)
        return lr_fail(error, LR_E_SIZE, "an image has 1 to %d texels per side; it is %d x %d",
                       MAX_SIDE, d->width, d->height);
    if (d->interpolation < LR_INTERPOLATION_LINEAR || d->interpolation > LR_INTERPOLATION_CUBIC)
        return lr_fail(error, LR_E_ARGUMENT,
                       "interpolation %d is none of linear (0), closest (1), cubic (2)",
                       d->interpolation);
    if (d->extension < LR_EXTENSION_REPEAT || d->extension > LR_EXTENSION_MIRROR)
        return lr_fail(error, LR_E_ARGUMENT,
                       "extension %d is none of repeat (0), extend (1), clip (2), mirror (3)",
                       d->extension);
    return d->program != NULL ? lr_program_check(d->program, error) : LR_OK;
}

lr_status lr_texture_new(const lr_texture_desc *desc, const lr_watch *watch, lr_texture **texture,
                         lr_error *error)
{
    lr_status status = check(desc, error);
    if (status != LR_OK)
        return status;
    lr_texture *t = calloc(1, sizeof *t);
    if (t == NULL)
        return lr_fail_memory(error, sizeof *t, "a texture");
    t->interpolation = desc->interpolation;
    t->extension = desc->extension;
    t->channels = desc->channels;
    t->width[0] = desc->width;
    t->height[0] = desc->height;
    t->program = desc->program;
    t->bytes = desc->sample_type == LR_U8 ? desc->pixels : NULL;
    t->pixels[0] = desc->sample_type == LR_U8 ? NULL : desc->pixels;
    status = make(t, desc->points_only != 0, watch, error);
    if (status != LR_OK) {
        lr_texture_free(t);
        return status;
    }
    *texture = t;
    return LR_OK;
}

void lr_texture_free(lr_texture *t)
{
    if (t == NULL)
        return;
    free(t->own);
    free(t);
}

uint64_t lr_texture_nbytes(const lr_texture *t)
{
    return t->nbytes;
}

/* ---- looks ------------------------------------------------------------- */

/* Texel (i, j), see extended; of bytes, 255 times as much. */
static void add_texel(const lr_texture *t, int level, int32_t i, int32_t j, double weight,
                      double sum[4])
{
    if (i < 0 || j < 0 || !(weight > 0.0))
        return;
    const size_t channels = level == 0 ? (size_t)t->channels : 3;
    const size_t at = channels * ((size_t)j * (size_t)t->width[level] + (size_t)i);
    const bool bytes = level == 0 && t->bytes != NULL;
    for (size_t a = 0; a < channels; a++)
        sum[a] += weight * (bytes ? t->bytes[at + a] : finite_or_black(t->pixels[level][at + a]));
    if (channels == 3)
        sum[3] += bytes ? 255.0 * weight : weight;
}

/* Four texels of bytes, of which none is black by extension. */
LR_INLINE void mix_bytes(const lr_texture *t, const int32_t i[2], const int32_t j[2],
                         const double w[4], double sum[4])
{
    const uint8_t *row[2] = {t->bytes + 3 * (size_t)j[0] * (size_t)t->width[0],
                             t->bytes + 3 * (size_t)j[1] * (size_t)t->width[0]};
    for (int a = 0; a < 3; a++)
        sum[a] = w[0] * row[0][3 * i[0] + a] + w[1] * row[0][3 * i[1] + a] +
                 w[2] * row[1][3 * i[0] + a] + w[3] * row[1][3 * i[1] + a];
}

/* How the box from -half to +half around x, in texels and no wider than one, is shared
 * by texel *first and the next: the next one's part. */
LR_INLINE double next_share(double x, double half, double *first)
{
    *first = floor(x - half);
    return half > 0.0 ? lr_clamp((x + half - *first - 1.0) / (2.0 * half), 0.0, 1.0) : 0.0;
}

/* Weights of the four texels around x, the first of which is *first. */
static void cubic_weights(double x, double *first, double weight[4])
{
    *first = floor(x - 0.5) - 1.0;
    const double t = x - 0.5 - floor(x - 0.5), u = 1.0 - t;
    weight[0] = u * u * u / 6.0;
    weight[1] = (4.0 + t * t * (3.0 * t - 6.0)) / 6.0;
    weight[2] = (4.0 + u * u * (3.0 * u - 6.0)) / 6.0;
    weight[3] = t * t * t / 6.0;
}

static void add_cubic(const lr_texture *t, const double uv[2], double sum[4])
{
    double x, y, p[4], q[4];
    int32_t i[4], j[4];
    cubic_weights(uv[0] * t->width[0], &x, p);
    cubic_weights(uv[1] * t->height[0], &y, q);
    for (int k = 0; k < 4; k++) {
        i[k] = extended(x + k, t->width[0], t->extension);
        j[k] = extended(y + k, t->height[0], t->extension);
    }
    for (int n = 0; n < 16; n++)
        add_texel(t, 0, i[n & 3], j[n >> 2], p[n & 3] * q[n >> 2], sum);
}

/* Linear RGB of what was looked up in level 0, as add_texel adds it up. */
static void decode(const lr_texture *t, const double sum[4], double rgb[3])
{
    const double white = t->bytes != NULL ? 255.0 : 1.0;
    if (t->program != NULL) {
        const float rgba[4] = {(float)(sum[0] / white), (float)(sum[1] / white),
                               (float)(sum[2] / white), (float)(sum[3] / white)};
        float made[3];
        lr_program_color(t->program, rgba, made);
        for (int a = 0; a < 3; a++)
            rgb[a] = finite_or_black(made[a]);
        return;
    }
    for (int a = 0; a < 3; a++) {
        const double at = LR_STEPS * sum[a];
        const int i = t->linear != NULL ? (int)fmin(at, LR_STEPS * 255 - 1) : 0;
        const float *linear = t->linear != NULL ? t->linear + i : NULL;
        rgb[a] = t->bytes == NULL    ? sum[a]
                 : t->linear == NULL ? from_srgb(sum[a] / white)
                                     : linear[0] + (at - i) * (linear[1] - linear[0]);
    }
}

/* The average over a box as wide as a texel, which is bilinear interpolation; of level
 * 0 without interpolation over a narrower one, down to the closest texel alone. */
static void add_level(const lr_texture *t, int level, const double uv[2], double width,
                      double weight, double rgb[3])
{
    const bool steps = level == 0 && t->interpolation == LR_INTERPOLATION_CLOSEST;
    const double half = steps && width < 1.0 ? 0.5 * width : 0.5;
    double x, y, sum[4] = {0.0, 0.0, 0.0, 0.0};
    if (level == 0 && t->interpolation == LR_INTERPOLATION_CUBIC) {
        add_cubic(t, uv, sum);
    } else {
        const double p = next_share(uv[0] * t->width[level], half, &x);
        const double q = next_share(uv[1] * t->height[level], half, &y);
        int32_t i[2], j[2];
        for (int k = 0; k < 2; k++) {
            i[k] = extended(x + k, t->width[level], t->extension);
            j[k] = extended(y + k, t->height[level], t->extension);
        }
        const double w[4] = {(1.0 - p) * (1.0 - q), p * (1.0 - q), (1.0 - p) * q, p * q};
        if (level == 0 && t->linear != NULL && (i[0] | i[1] | j[0] | j[1]) >= 0)
            mix_bytes(t, i, j, w, sum);
        else
            for (int n = 0; n < 4; n++)
                add_texel(t, level, i[n & 1], j[n >> 1], w[n], sum);
    }
    double color[3] = {sum[0], sum[1], sum[2]};
    if (level == 0)
        decode(t, sum, color);
    for (int a = 0; a < 3; a++)
        rgb[a] += weight * color[a];
}

void lr_texture_look(const lr_texture *t, const double uv[2], double rgb[3])
{
    memset(rgb, 0, 3 * sizeof *rgb);
    if (fabs(uv[0]) < NO_DIGITS && fabs(uv[1]) < NO_DIGITS)
        add_level(t, 0, uv, 0.0, 1.0, rgb);
}

void lr_texture_of_corners(const lr_texture *t, const double color[3], double rgb[3])
{
    decode(t, (const double[4]){color[0], color[1], color[2], 1.0}, rgb);
}

/* One look as wide as `width` texels; textures without interpolation over `box`. */
static void add_look(const lr_texture *t, const double uv[2], double width, double box,
                     double weight, double rgb[3])
{
    const double level = lr_clamp(log2(width), 0.0, t->n_levels - 1);
    const int below = (int)level;
    const double above = level - below;
    add_level(t, below, uv, box, weight * (1.0 - above), rgb);
    if (above > 0.0)
        add_level(t, below + 1, uv, box, weight * above, rgb);
}

void lr_texture_average(const lr_texture *t, const double uv[2], const lr_footprint *f,
                        double rgb[3])
{
    memset(rgb, 0, 3 * sizeof *rgb);
    if (!(fabs(uv[0]) < NO_DIGITS && fabs(uv[1]) < NO_DIGITS))
        return;
    const double length = hypot(f->major[0], f->major[1]);
    const double across = f->width > 1.0 ? f->width : 1.0;
    const int n = (int)lr_clamp(ceil(length / across), 1.0, MOST_LOOKS);
    const double width = across > length / n ? across : length / n;
    for (int i = 0; i < n; i++) {
        const double along = (i + 0.5) / n - 0.5;
        const double at[2] = {uv[0] + along * f->major[0] / t->width[0],
                              uv[1] + along * f->major[1] / t->height[0]};
        add_look(t, at, width, f->width, 1.0 / n, rgb);
    }
}

lr_status lr_texture_sample(const lr_texture *t, const float *uvs, const float *footprints,
                            uint64_t n, float *colors, lr_error *error)
{
    if (lr_texture_is_of_corners(t))
        return lr_fail(error, LR_E_ARGUMENT, "a texture of corners' colours has no pixels");
    for (uint64_t i = 0; i < n; i++) {
        const double uv[2] = {uvs[2 * i], uvs[2 * i + 1]};
        lr_footprint f = {{0.0, 0.0}, 0.0};
        if (footprints != NULL)
            f = (lr_footprint){{footprints[3 * i], footprints[3 * i + 1]}, footprints[3 * i + 2]};
        if (!(f.width >= 0.0 && isfinite(f.major[0]) && isfinite(f.major[1])))
            return lr_fail(error, LR_E_ARGUMENT,
                           "footprints must be finite and of a width of 0 or more; one is "
                           "(%g, %g) wide %g",
                           f.major[0], f.major[1], f.width);
        double rgb[3];
        lr_texture_average(t, uv, &f, rgb);
        for (int a = 0; a < 3; a++)
            colors[3 * i + (uint64_t)a] = (float)rgb[a];
    }
    return LR_OK;
}
