/* Signed distances from nearest triangles.
 *
 * Samples in the band take the signed distance to their nearest triangle, those of a sheet
 * the height over it, which continues beyond its border. The closest point of most samples
 * lies in the triangle's face: they take the height from the search. The others, a few per
 * cent at edges and corners, are measured in f64.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/brick_distances.h"

#include "mesh/signed_distance.h"

#define LR_VECTORS 0 /* compiled once, for all processors */
#include "base/vectors.h"

/* The nearest triangle is chosen in f32; its exact distance can exceed the band by this. */
#define BAND_SLACK 1e-3

/* The sign of an f32 height above this is right; below, f64 decides. */
#define SURE 1e-3f

/* Signed distances of the samples whose closest point lies in a face, infinity for the
 * others; those to be measured in f64 are grouped. */
static void take_heights(const lr_voxel_job *job, lr_scratch *scratch, float *distance)
{
    const lr_nearest *nearest = &scratch->nearest;
    const float turn = (float)-job->mesh->side;
    for (int tile = 0; tile < LR_TILES; tile++) {
        const lr_floats h = lr_load_floats(nearest->height[tile]), size = lr_absolute(h);
        const lr_ints sure = (size > SURE) & (size < INFINITY);
        float s[LR_TILE];
        lr_store_floats(s, lr_pick(sure, h * turn, lr_all_floats(INFINITY)));
        for (int lane = 0; lane < LR_TILE; lane += 4)
            memcpy(&distance[lr_tile_sample(tile, lane)], s + lane, 4 * sizeof *s);
        for (uint32_t left = ~lr_bits_of(sure) & LR_ALL_LANES; left != 0; left &= left - 1) {
            const int lane = __builtin_ctz(left);
            const int32_t who = nearest->winner[tile][lane], sample = lr_tile_sample(tile, lane);
            if (who < 0)
                continue;
            scratch->next[sample] = scratch->first[who];
            scratch->first[who] = sample;
        }
    }
}

void lr_brick_frame(const lr_topology *mesh, const int32_t first[3], uint32_t t, lr_frame *frame)
{
    lr_triangle(mesh, t, frame->p);
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++)
            frame->p[c][a] -= first[a];
}

/* Measure the grouped samples in f64. */
static void measure(const lr_voxel_job *job, const int32_t first[3], const uint32_t *list,
                    uint32_t n, lr_scratch *scratch, float *distance, uint8_t *loose)
{
    const lr_topology *mesh = job->mesh;
    for (uint32_t i = 0; i < n; i++) {
        int32_t sample = scratch->first[i];
        if (sample < 0)
            continue;
        scratch->first[i] = -1;
        lr_frame frame;
        lr_brick_frame(mesh, first, list[i], &frame);
        if (!lr_frame_make(&frame)) /* rounding took the area of a sliver */
            continue;
        for (; sample >= 0; sample = scratch->next[sample]) {
            const double p[3] = {lr_along(sample, 0), lr_along(sample, 1), lr_along(sample, 2)};
            bool border;
            double height, s = lr_signed_distance(mesh, list[i], &frame, p, &height, &border);
            if (fabs(s) <= job->band + BAND_SLACK)
                distance[sample] = (float)(mesh->side * (job->sheet ? height : s));
            if (loose != NULL)
                loose[sample] = border;
        }
    }
}

bool lr_brick_distances(const lr_voxel_job *job, uint32_t at, const uint32_t *list, uint32_t n,
                        const lr_watch *watch, lr_scratch *scratch, float *distance, uint8_t *loose)
{
    int32_t first[3];
    double centre[3];
    lr_first_sample(job->table_size, at, first);
    for (int a = 0; a < 3; a++)
        centre[a] = first[a] + 0.5 * (LR_SIDE - 1);
    if (!job->search(job->mesh, centre, list, n, job->band, watch, &scratch->nearest))
        return false;
    take_heights(job, scratch, distance);
    measure(job, first, list, n, scratch, distance, loose);
    return true;
}
