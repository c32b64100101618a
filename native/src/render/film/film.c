/* The film: the sums of a range of pixels.
 *
 * With a noise threshold, a pixel takes no more samples once its noise is below it. The
 * noise is estimated from the differences between the means of its samples' interleaved
 * quarters, which takes the sequence's low discrepancy into account.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/film/film.h"

#include "render/film/pixel_filter.h"
#include "render/film/sampling.h"

static const float FAR_AWAY = 1e10f; /* depth of the background, as in Blender */

void lr_film_lay(lr_arena *arena, uint64_t n, lr_film *film)
{
    film->pixels = lr_arena_take(arena, n, sizeof *film->pixels);
    film->place = lr_arena_take(arena, n, sizeof *film->place);
    film->hash = lr_arena_take(arena, n, sizeof *film->hash);
    film->shift = lr_arena_take(arena, n, sizeof *film->shift);
    film->sampled = lr_arena_take(arena, n, sizeof *film->sampled);
    film->settled = lr_arena_take(arena, n, sizeof *film->settled);
    film->filter = lr_arena_take_doubles(arena, LR_FILTER_TABLE + 1);
}

/* The values of a pixel without surface. */
static void clear_passes(const lr_passes *passes, uint64_t pixel)
{
    static const double zero[3] = {0, 0, 0};
    lr_pass_put(passes->depth, pixel, FAR_AWAY);
    lr_pass_put(passes->object_index, pixel, 0);
    lr_pass_put(passes->material_index, pixel, 0);
    lr_pass_put(passes->error, pixel, 0);
    lr_pass_put(passes->volume, pixel, 0);
    lr_pass_put_triple(passes->normal, pixel, zero, 1);
    lr_pass_put_triple(passes->position, pixel, zero, 1);
}

void lr_film_begin(lr_film *film, uint64_t first, uint32_t n)
{
    film->first = first;
    film->n_pixels = n;
    memset(film->pixels, 0, n * sizeof *film->pixels);
    for (uint32_t i = 0; i < n; i++) {
        const uint64_t at = first + i, width = (uint64_t)film->tile->width;
        film->place[i][0] = film->tile->x + (int32_t)(at % width);
        film->place[i][1] = film->tile->y + (int32_t)(at / width);
        film->hash[i] = lr_pixel_hash(film->place[i][0], film->place[i][1], film->tile->seed);
        lr_film_shift(film->hash[i], film->shift[i]);
        film->sampled[i] = 0;
        film->settled[i] = false;
        clear_passes(film->passes, first + i);
    }
}

bool lr_film_next(lr_film *film, uint32_t pixel, double *x, double *y)
{
    double u, v;
    if (film->settled[pixel])
        return false;
    lr_film_sample(film->hash[pixel], film->shift[pixel], film->sample, &u, &v);
    *x = film->place[pixel][0] + 0.5 + lr_filter_offset(film->filter, u);
    *y = film->place[pixel][1] + 0.5 + lr_filter_offset(film->filter, v);
    film->sampled[pixel]++;
    return true;
}

/* The noise of a pixel's mean after n samples, relative to the root of its
 * brightness, as Cycles weighs it. */
static double noise(const lr_pixel_sums *pixel, uint32_t n)
{
    double sum = 0, error = 0;
    for (int a = 0; a < 3; a++) {
        double mean = 0, spread = 0;
        for (int k = 0; k < LR_PARTS; k++)
            mean += pixel->part[k][a];
        for (int k = 0; k < LR_PARTS; k++) {
            const double off = LR_PARTS * pixel->part[k][a] - mean;
            spread += off * off;
        }
        sum += mean / n;
        error += sqrt(spread / (LR_PARTS * (LR_PARTS - 1))) / n;
    }
    return error / (1e-4 + sqrt(fabs(sum))); /* Cycles' guard against black */
}

/* The default, as in Cycles. */
static uint32_t least_samples(const lr_tile *tile)
{
    if (tile->min_samples > 0)
        return (uint32_t)tile->min_samples;
    return (uint32_t)ceil(16 / fmin(pow(tile->noise_threshold, 0.3), 4));
}

/* Tested after 4, 8, 12, 16, 32, ... samples. */
bool lr_film_settle(lr_film *film)
{
    const lr_tile *tile = film->tile;
    const uint32_t n = film->sample + 1;
    const uint32_t every = n < 16 ? LR_PARTS : 16;
    if (!(tile->noise_threshold > 0) || n % every != 0 || n < least_samples(tile))
        return false;
    bool all = true;
    for (uint32_t i = 0; i < film->n_pixels; i++) {
        if (!film->settled[i])
            film->settled[i] = noise(&film->pixels[i], n) < tile->noise_threshold;
        all = all && film->settled[i];
    }
    return all;
}

void lr_film_write(const lr_film *film)
{
    const lr_passes *passes = film->passes;
    for (uint32_t i = 0; i < film->n_pixels; i++) {
        const lr_pixel_sums *pixel = &film->pixels[i];
        const uint64_t p = film->first + i;
        const double samples = film->sampled[i];
        for (uint64_t a = 0; a < 3; a++) {
            double sum = 0;
            for (int part = 0; part < LR_PARTS; part++)
                sum += pixel->part[part][a];
            passes->combined[4 * p + a] = (float)(sum / samples);
        }
        passes->combined[4 * p + 3] = (float)(1 + pixel->alpha / samples);
        lr_pass_put(passes->mist, p, 1 - pixel->mist / samples);
        lr_pass_put(passes->ao, p, pixel->ao / samples);
        lr_pass_put_triple(passes->emission, p, pixel->emission, 1 / samples);
        lr_pass_put_triple(passes->environment, p, pixel->environment, 1 / samples);
    }
}
