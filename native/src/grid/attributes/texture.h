/* An image with its smaller versions, and averages over a stretch of texels.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_ATTRIBUTES_TEXTURE_H
#define LR_GRID_ATTRIBUTES_TEXTURE_H

#include "base/base.h"

enum {
    LR_LEVELS = 31,
    LR_STEPS = 16 /* between neighbours a line is within 3e-8 of the curve */
};

struct lr_texture {
    int32_t interpolation, extension;
    int32_t channels, n_levels;
    int32_t width[LR_LEVELS], height[LR_LEVELS];
    const lr_program *program;      /* the caller's, of what is looked up in level 0; or NULL */
    const uint8_t *bytes;           /* the caller's level 0, or NULL: then */
    const float *pixels[LR_LEVELS]; /* [height][width][3]; level 0 is the caller's, of `channels` */
    float *own;                     /* what the other levels lie in, */
    float *linear; /* and before them, where bytes are decoded: of i/LR_STEPS of a byte in sRGB */
    uint64_t nbytes;
};

/* Where to average: an ellipse in texels, by the half-open box of its long axis. */
typedef struct lr_footprint {
    double major[2]; /* the long axis, whole */
    double width;    /* across it */
} lr_footprint;

/* A texture of a mesh's corners. */
LR_INLINE bool lr_texture_is_of_corners(const lr_texture *t)
{
    return t->bytes == NULL && t->pixels[0] == NULL;
}

/* rgb at the point (u, v) */
void lr_texture_look(const lr_texture *texture, const double uv[2], double rgb[3]);

/* rgb of a mesh's colour at a hit, for a texture without pixels */
void lr_texture_of_corners(const lr_texture *texture, const double color[3], double rgb[3]);

/* rgb at (u, v), averaged over the footprint. */
void lr_texture_average(const lr_texture *texture, const double uv[2],
                        const lr_footprint *footprint, double rgb[3]);

#endif
