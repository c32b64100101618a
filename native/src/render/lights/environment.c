/* The world's radiance: one colour, or an image by longitude and latitude.
 *
 * Radiance is interpolated between the centres of texels. So the probability of a texel
 * counts its neighbours' radiance too, and every direction with radiance has a density.
 *
 * Source: Pharr, Jakob, Humphreys, Physically Based Rendering, 4th ed., 2023,
 * sections 12.5 and A.5.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/lights/environment.h"

#include "base/error.h"
#include "grid/attributes/texture.h"

/* Where a program may make light between looks, a texel is chosen at least so often, in
 * parts of the mean. */
static const double LEAST = 0x1p-4;

/* The texels of smaller images are cut into parts, each of which is chosen by its own light. */
static const int32_t SIDE = 128;

lr_status lr_environment_check(const lr_world *world, lr_error *error)
{
    const double *c = world->color, *m = world->image_from_world;
    if (!lr_all_finite(c, 3))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the world must have a finite color, it has (%g, %g, %g)", c[0], c[1], c[2]);
    if (world->max_bounces < 0)
        return lr_fail(error, LR_E_ARGUMENT,
                       "the world must have a limit of bounces of 0 or more, it has %d",
                       world->max_bounces);
    if (world->image == NULL)
        return LR_OK;
    if (lr_texture_is_of_corners(world->image))
        return lr_fail(error, LR_E_ARGUMENT, "the world's image needs pixels");
    for (int i = 0; i < 3; i++)
        for (int k = 0; k <= i; k++)
            if (!(fabs(lr_dot(m + 3 * i, m + 3 * k) - (i == k)) < 1e-3))
                return lr_fail(error, LR_E_ARGUMENT,
                               "the world's image must be placed by a rotation");
    return LR_OK;
}

/* ---- lookup --------------------------------------------------------------- */

/* Where in the table, in texels from its lower left corner. */
static void texel_of(const lr_environment *e, const double d[3], double *x, double *y)
{
    const double *m = e->image_from_world;
    const double q[3] = {lr_dot(m, d), lr_dot(m + 3, d), lr_dot(m + 6, d)};
    *x = (0.5 - atan2(q[1], q[0]) / (2 * LR_PI)) * e->width;
    *y = (0.5 + atan2(q[2], hypot(q[0], q[1])) / LR_PI) * e->height;
}

static void look(const lr_environment *e, double x, double y, double rgb[3])
{
    lr_texture_look(e->image, (const double[2]){x / e->width, y / e->height}, rgb);
    for (int k = 0; k < 3; k++)
        rgb[k] *= e->color[k];
}

void lr_environment_radiance(const lr_environment *e, const double d[3], double rgb[3])
{
    if (e->image == NULL) {
        memcpy(rgb, e->color, 3 * sizeof *rgb);
        return;
    }
    double x, y;
    texel_of(e, d, &x, &y);
    look(e, x, y, rgb);
}

/* ---- densities ------------------------------------------------------------ */

/* Of a texel of the table in the mean over it, by looks at its quarters' middles, which is
 * exact for linear interpolation; with a program at its ninths', one of which is its own middle. */
static double inside_texel(const lr_environment *e, int32_t x, int32_t y)
{
    const int n = e->image->program != NULL ? 3 : 2;
    double sum = 0, rgb[3];
    for (int q = 0; q < n * n; q++) {
        look(e, x + (q % n + 0.5) / n, y + ((double)(q / n) + 0.5) / n, rgb);
        sum += lr_brightness(rgb) / (n * n);
    }
    return sum;
}

/* Solid angle of a texel in that row over the step of its longitude. */
static double height_of(const lr_environment *e, int32_t y)
{
    return sin(LR_PI * ((y + 1.0) / e->height - 0.5)) - sin(LR_PI * ((double)y / e->height - 0.5));
}

/* Turn sums[0..n] into fractions of the last; equal steps if that is 0. Returns it. */
static double normalize(double *sums, float *fractions, int32_t n)
{
    const double all = sums[n];
    for (int32_t i = 0; i <= n; i++)
        fractions[i] = (float)(all > 0 ? sums[i] / all : (double)i / n);
    return all;
}

static void add_up(lr_environment *e, double *of_rows, double *of_row)
{
    of_rows[0] = of_row[0] = 0;
    double mean = 0;
    const size_t w = (size_t)e->width, n = w * (size_t)e->height;
    for (size_t i = 0; i < n; i++) {
        float *texel = e->columns + i + i / w + 1;
        *texel = (float)inside_texel(e, (int32_t)(i % w), (int32_t)(i / w));
        mean += (double)*texel / (double)n;
    }
    const double least = e->image->program != NULL ? LEAST * mean : 0;
    for (int32_t y = 0; y < e->height; y++) {
        float *columns = e->columns + (size_t)y * (w + 1);
        for (int32_t x = 0; x < e->width; x++)
            of_row[x + 1] = of_row[x] + (double)columns[x + 1] + least;
        of_rows[y + 1] = of_rows[y] + height_of(e, y) * normalize(of_row, columns, e->width);
    }
    e->brightness = normalize(of_rows, e->rows, e->height) / (2.0 * e->width);
}

lr_status lr_environment_make(const lr_world *world, lr_environment *e, lr_error *error)
{
    *e = (lr_environment){.width = 0};
    memcpy(e->color, world->color, sizeof e->color);
    memcpy(e->image_from_world, world->image_from_world, sizeof e->image_from_world);
    if (world->image == NULL)
        return LR_OK;
    e->image = world->image;
    const int32_t width = world->image->width[0], height = world->image->height[0];
    const int32_t parts = (SIDE - 1) / lr_max_i(width, height) + 1;
    e->width = width * parts;
    e->height = height * parts;
    const size_t w = (size_t)e->width, h = (size_t)e->height;
    e->rows = malloc((h + 1) * sizeof *e->rows);
    e->columns = malloc(h * (w + 1) * sizeof *e->columns);
    double *sums = malloc((w + h + 2) * sizeof *sums);
    const bool got = e->rows && e->columns && sums;
    if (got)
        add_up(e, sums, sums + h + 1);
    free(sums);
    if (got)
        return LR_OK;
    lr_environment_free(e);
    return lr_fail_memory(error, w * h * sizeof *e->columns, "the world's image");
}

void lr_environment_free(lr_environment *e)
{
    free(e->rows);
    free(e->columns);
    *e = (lr_environment){.width = 0};
}

/* ---- sampling ------------------------------------------------------------- */

/* The step of fractions[0..n] in which u lies; *within is where in it, 0..1. */
static int32_t find(const float *fractions, int32_t n, double u, double *within)
{
    int32_t lo = 0, hi = n;
    while (hi - lo > 1) {
        const int32_t middle = lo + (hi - lo) / 2;
        if (fractions[middle] <= u)
            lo = middle;
        else
            hi = middle;
    }
    const double step = (double)fractions[hi] - fractions[lo];
    *within = step > 0 ? lr_clamp((u - fractions[lo]) / step, 0, 1) : 0.5;
    return lo;
}

/* Of the directions of a texel. */
static double density(const lr_environment *e, int32_t x, int32_t y)
{
    const float *columns = e->columns + (size_t)y * ((size_t)e->width + 1);
    const double p = ((double)e->rows[y + 1] - e->rows[y]) * ((double)columns[x + 1] - columns[x]);
    return p * e->width / (2 * LR_PI * height_of(e, y));
}

bool lr_environment_sample(const lr_environment *e, const double u[2], lr_light_ray *ray)
{
    if (e->image == NULL)
        return false;
    double tx, ty;
    const int32_t y = find(e->rows, e->height, u[1], &ty);
    const int32_t x = find(e->columns + (size_t)y * ((size_t)e->width + 1), e->width, u[0], &tx);
    ray->delta = false;
    ray->distance = INFINITY;
    ray->pdf = density(e, x, y);
    if (!(ray->pdf > 0))
        return false;
    const double longitude = 2 * LR_PI * (0.5 - (x + tx) / e->width);
    const double z =
        lr_clamp(sin(LR_PI * ((double)y / e->height - 0.5)) + ty * height_of(e, y), -1, 1);
    const double r = sqrt(1 - z * z);
    const double q[3] = {r * cos(longitude), r * sin(longitude), z};
    const double *m = e->image_from_world;
    for (int a = 0; a < 3; a++)
        ray->direction[a] = m[a] * q[0] + m[a + 3] * q[1] + m[a + 6] * q[2];
    look(e, x + tx, (0.5 + asin(z) / LR_PI) * e->height, ray->color);
    return true;
}

double lr_environment_pdf(const lr_environment *e, const double d[3])
{
    if (e->image == NULL)
        return 0;
    double x, y;
    texel_of(e, d, &x, &y);
    return density(e, lr_max_i(0, lr_min_i((int32_t)x, e->width - 1)),
                   lr_max_i(0, lr_min_i((int32_t)y, e->height - 1)));
}
