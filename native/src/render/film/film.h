/* The film: the sums of a range of a tile's pixels while their samples are taken.
 *
 * Sums are f64, in the order of the samples.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_FILM_FILM_H
#define LR_RENDER_FILM_FILM_H

#include "base/arena.h"

enum { LR_PARTS = 4 }; /* of a pixel's samples, for the estimate of its noise */

/* The sums over a pixel's samples. */
typedef struct lr_pixel_sums {
    double part[LR_PARTS][3]; /* radiance */
    double alpha, mist, ao;
    double emission[3], environment[3];
} lr_pixel_sums;

typedef struct lr_film {
    const lr_tile *tile;
    const lr_passes *passes; /* the caller's buffers of the whole tile */
    uint64_t first;          /* pixel of the tile with which the stretch begins */
    uint32_t n_pixels;       /* of the stretch; arrays below are of these */
    uint32_t sample;         /* number of the present one */
    lr_pixel_sums *pixels;
    int32_t (*place)[2];  /* of each pixel in the image, */
    uint32_t *hash;       /* of that and the seed, */
    uint32_t (*shift)[2]; /* and of its samples: see lr_film_shift */
    uint32_t *sampled;    /* how many samples each has */
    bool *settled;        /* whether it takes no more */
    double *filter;       /* offsets from the pixel's centre by the integral of the filter */
} lr_film;

/* Lay out the arrays of n pixels. */
void lr_film_lay(lr_arena *arena, uint64_t n, lr_film *film);

/* Begin with the n pixels from `first` on: no samples, and passes of no surface. */
void lr_film_begin(lr_film *film, uint64_t first, uint32_t n);

/* Where on the film the present sample of a pixel lies; false where the pixel is settled. */
bool lr_film_next(lr_film *film, uint32_t pixel, double *x, double *y);

/* Which pixels are settled after the present sample; true where all are. */
bool lr_film_settle(lr_film *film);

/* Write the passes that are sums over samples. */
void lr_film_write(const lr_film *film);

/* Add a contribution, which may be negative, to a pixel, limited by the clamps; bounces: of the
 * path behind the surface. */
LR_INLINE void lr_film_add(lr_film *film, uint32_t pixel, int bounces, double contribution[3])
{
    const lr_tile *tile = film->tile;
    double *part = film->pixels[pixel].part[film->sample % LR_PARTS];
    const double limit = 3 * (bounces > 0 ? tile->clamp_indirect : tile->clamp_direct);
    const double sum = fabs(contribution[0]) + fabs(contribution[1]) + fabs(contribution[2]);
    const double scale = limit > 0 && sum > limit ? limit / sum : 1;
    for (int a = 0; a < 3; a++)
        part[a] += contribution[a] *= scale;
}

/* Store a value in a pass of one or three channels, unless that is NULL. pixel: of the tile. */
LR_INLINE void lr_pass_put(float *pass, uint64_t pixel, double value)
{
    if (pass != NULL)
        pass[pixel] = (float)value;
}

LR_INLINE void lr_pass_put_triple(float *pass, uint64_t pixel, const double value[3], double scale)
{
    for (uint64_t a = 0; a < 3 && pass != NULL; a++)
        pass[3 * pixel + a] = (float)(value[a] * scale);
}

#endif
