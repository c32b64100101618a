/* Computes the samples of a brick from distances in the band.
 *
 * Samples in the band are filtered distances. The others of a solid take the side of their
 * neighbours by a flood fill along the axes, a layer at a time, one bit per sample: the segment
 * between two neighbours of which one is beyond the band (at least sqrt(3) voxels wide) cannot
 * cross the surface. Samples outside the lattice are outside. A brick without any sample in the
 * band stays unknown; flood_fill.c decides it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/brick.h"

#include "mesh/triangle_box.h"
#include "voxelize/component_sides.h"
#include "voxelize/coverage.h"
#include "voxelize/filter_profile.h"
#include "voxelize/hole_fill.h"

#define LR_VECTORS 0 /* compiled once, for all processors */
#include "base/vectors.h"

enum { POLL = 1 << 8 }; /* triangles between checks of the stop word: each may meet all cells */

typedef struct sides {
    lr_layers inside, outside;
} sides;

static void take_ids(const lr_voxel_job *job, const uint32_t *list, const lr_nearest *nearest,
                     const float *distance, lr_brick *brick)
{
    for (int tile = 0; tile < LR_TILES; tile++)
        for (int lane = 0; lane < LR_TILE; lane++) {
            int32_t who = nearest->winner[tile][lane], sample = lr_tile_sample(tile, lane);
            if (who >= 0 && distance[sample] != INFINITY)
                brick->id[sample] = job->mesh->source.ids[list[who]];
        }
}

/* Sides by the winding number of the component. */
static void take_sides(const lr_scratch *scratch, float *distance)
{
    for (int i = 0; i < LR_CELLS; i++)
        if (scratch->component_of[i] != LR_NO_COMPONENT) {
            bool inside = scratch->components[scratch->component_of[i]].inside;
            distance[i] = inside ? fabsf(distance[i]) : -fabsf(distance[i]);
        }
}

/* Distances of neighbours differ by at most one voxel if their signs are right; MOST allows
 * for rounding. */
#define MOST 1.001f

static bool contradicts(const float *distance)
{
    uint32_t found = 0;
    for (int a = 0; a < 3; a++)
        for (int i = 0; i + lr_stride(a) < LR_CELLS; i += LR_SIDE) {
            if (a > 0 && lr_along(i, a) == LR_SIDE - 1)
                continue;
            const lr_eight_floats p = lr_load_eight_floats(&distance[i]),
                                  q = lr_load_eight_floats(&distance[i + lr_stride(a)]),
                                  apart = (lr_eight_floats)((lr_eight_ints)(p - q) & INT32_MAX);
            const uint32_t bits =
                lr_bits_of_eight((p < INFINITY) & (q < INFINITY) & (apart > MOST));
            found |= a == 0 ? bits & 0x7f : bits; /* a row ends with its brick */
        }
    return found != 0;
}

/* Set the values of the ramp filter, and the sides; 0 and neither side beyond the band. */
static void settle(const lr_voxel_job *job, const float *distance, sides *side, lr_brick *brick)
{
    const float slope = (float)(0.5 / job->half_width);
    const lr_eight_floats zero = {0}, one = 1.0f - zero;
    for (int i = 0; i < LR_CELLS; i += LR_SIDE) {
        const lr_eight_floats s = lr_load_eight_floats(&distance[i]), ramp = 0.5f + s * slope;
        const lr_eight_ints known = s < INFINITY;
        const lr_eight_floats least = lr_pick_eight_floats(ramp > zero, ramp, zero),
                              value = lr_pick_eight_floats(least < one, least, one);
        lr_store_eight_floats(&brick->value[i], lr_pick_eight_floats(known, value, zero));
        lr_layers_add(side->inside, i, lr_bits_of_eight(known & (s >= 0)));
        lr_layers_add(side->outside, i, lr_bits_of_eight(s < 0));
    }
}

/* Replace the ramp's values by those of the job's filter. */
static void set_profile(const lr_voxel_job *job, const float *distance, lr_brick *brick)
{
    for (int i = 0; i < LR_CELLS; i++)
        if (job->hole_fill != NULL &&
            job->filter == LR_FILTER_BOX) /* the level set has no triangles */
            brick->value[i] = (float)lr_clamp(0.5 + distance[i], 0.0, 1.0);
        else if (distance[i] != INFINITY)
            brick->value[i] = (float)lr_profile(job->filter, distance[i], job->half_width);
}

/* Link the samples of squared distances up to `most` into a list per nearest triangle. */
static void group(const lr_nearest *nearest, float most, lr_scratch *scratch)
{
    for (int tile = 0; tile < LR_TILES; tile++)
        for (int lane = 0; lane < LR_TILE; lane++) {
            int32_t who = nearest->winner[tile][lane];
            if (who < 0 || nearest->d2[tile][lane] > most)
                continue;
            int32_t sample = lr_tile_sample(tile, lane);
            scratch->next[sample] = scratch->first[who];
            scratch->first[who] = sample;
        }
}

/* Store the nearest triangles of the samples that can be corners of surface cells. */
static void name_nearest(const lr_voxel_job *job, const int32_t first[3], const uint32_t *list,
                         uint32_t n, lr_scratch *scratch, lr_brick *brick)
{
    const float most = (float)(LR_ATTRIBUTE_RADIUS * LR_ATTRIBUTE_RADIUS);
    float nearest = INFINITY;
    for (int tile = 0; tile < LR_TILES; tile++)
        for (int lane = 0; lane < LR_TILE; lane++)
            if (scratch->nearest.winner[tile][lane] >= 0)
                nearest = fminf(nearest, scratch->nearest.d2[tile][lane]);
    if (!(nearest <= most))
        return;
    memset(scratch->nearest_triangle, 0, LR_CELLS * sizeof *scratch->nearest_triangle);
    brick->has_nearest = true;
    group(&scratch->nearest, most, scratch);
    for (uint32_t i = 0; i < n; i++) {
        int32_t sample = scratch->first[i];
        scratch->first[i] = -1;
        lr_frame frame;
        lr_brick_frame(job->mesh, first, list[i], &frame);
        for (; sample >= 0 && lr_frame_make(&frame); sample = scratch->next[sample])
            scratch->nearest_triangle[sample] = list[i] + 1;
    }
}

/* Set samples beyond the lattice to outside. */
static void clear_outside(const lr_voxel_job *job, const int32_t first[3], sides *side,
                          lr_brick *brick)
{
    int32_t lo[3], hi[3];
    for (int a = 0; a < 3; a++) {
        lo[a] = LR_PAD - first[a];
        hi[a] = lo[a] + job->size[a];
    }
    for (int z = 0; z < LR_SIDE; z++) {
        uint64_t beyond = ~lr_layer_in_box(lo, hi, z);
        side->inside[z] &= ~beyond;
        side->outside[z] |= beyond;
        for (; beyond != 0; beyond &= beyond - 1) {
            const int sample = LR_LAYER_SAMPLES * z + __builtin_ctzll(beyond);
            brick->value[sample] = 0.0f;
            if (job->mesh->source.ids != NULL)
                brick->id[sample] = 0;
        }
    }
}

/* Spread known sides until all are known; false where none is. */
static bool flood(sides *side)
{
    uint64_t known = 0;
    for (int z = 0; z < LR_SIDE; z++)
        known |= side->inside[z] | side->outside[z];
    if (known == 0)
        return false;
    for (uint64_t missing = 1; missing != 0;) {
        missing = 0;
        for (int z = 0; z < LR_SIDE; z++) {
            uint64_t open = ~(side->inside[z] | side->outside[z]);
            if (open == 0)
                continue;
            uint64_t outside = open & lr_layers_neighbours(side->outside, z);
            uint64_t inside = open & ~outside & lr_layers_neighbours(side->inside, z);
            side->outside[z] |= outside;
            side->inside[z] |= inside;
            missing |= open & ~outside & ~inside;
        }
    }
    return true;
}

/* Do neighbours, one of them beyond the band, lie on different sides? */
static bool sides_meet(const sides *side, const lr_layers in_band)
{
    lr_layers far_outside;
    uint64_t found = 0;
    for (int z = 0; z < LR_SIDE; z++)
        far_outside[z] = side->outside[z] & ~in_band[z];
    for (int z = 0; z < LR_SIDE; z++)
        found |= (side->inside[z] & lr_layers_neighbours(far_outside, z)) |
                 (side->inside[z] & ~in_band[z] & lr_layers_neighbours(side->outside, z));
    return found != 0;
}

static void fill_rest(const sides *side, const lr_layers in_band, lr_brick *brick)
{
    for (int z = 0; z < LR_SIDE; z++)
        for (uint64_t left = side->inside[z] & ~in_band[z]; left != 0; left &= left - 1)
            brick->value[LR_LAYER_SAMPLES * z + __builtin_ctzll(left)] = 1.0f;
}

static lr_brick_state state_of(const lr_brick *brick)
{
    uint64_t touched = 0;
    for (int i = 0; i < LR_WORDS; i++)
        touched |= brick->touched[i];
    for (int i = 0; i < LR_CELLS; i++)
        touched |= brick->value[i] != brick->value[0];
    if (touched != 0 || brick->has_nearest || (brick->value[0] != 0.0f && brick->value[0] != 1.0f))
        return LR_STATE_MIXED;
    return brick->value[0] == 0.0f ? LR_STATE_ZERO : LR_STATE_ONE;
}

static bool touch(const lr_voxel_job *job, const int32_t first[3], const uint32_t *list, uint32_t n,
                  const lr_watch *watch, lr_brick *brick)
{
    for (uint32_t i = 0; i < n; i++) {
        if (i % POLL == POLL - 1 && lr_stopped(watch))
            return false;
        double p[3][3], normal[3];
        lr_triangle(job->mesh, list[i], p);
        for (int c = 0; c < 3; c++)
            for (int a = 0; a < 3; a++)
                p[c][a] -= first[a];
        if (lr_normal_of((const double (*)[3])p, normal))
            lr_touch_cells((const double (*)[3])p, brick->touched);
    }
    return true;
}

bool lr_brick_make(const lr_voxel_job *job, uint32_t at, const uint32_t *list, uint32_t n,
                   const lr_watch *watch, lr_scratch *scratch, lr_brick *brick)
{
    int32_t first[3];
    lr_first_sample(job->table_size, at, first);
    sides side = {0};
    _Alignas(16) float distance[LR_CELLS + 4]; /* a neighbour beyond the end is read */
    brick->state = LR_STATE_UNKNOWN;
    brick->has_nearest = false;
    memset(brick->touched, 0, sizeof brick->touched);
    uint8_t loose[LR_CELLS] = {0};
    if (!lr_brick_distances(job, at, list, n, watch, scratch, distance,
                            job->hole_fill != NULL ? loose : NULL))
        return false;
    if (job->hole_fill != NULL &&
        !lr_hole_fill_brick(job->hole_fill, first, job->band, loose, watch, distance))
        return false;
    if (scratch->component_of != NULL)
        take_sides(scratch, distance);
    brick->contradicts = !job->sheet && scratch->component_of == NULL && job->hole_fill == NULL &&
                         contradicts(distance);
    settle(job, distance, &side, brick);
    if (job->filter != LR_FILTER_RAMP)
        set_profile(job, distance, brick);
    if (job->mesh->source.ids != NULL) {
        memset(brick->id, 0, sizeof brick->id);
        take_ids(job, list, &scratch->nearest, distance, brick);
    }
    if (scratch->nearest_triangle != NULL)
        name_nearest(job, first, list, n, scratch, brick);
    clear_outside(job, first, &side, brick);
    if (job->sheet) {
        if (!job->exact && !touch(job, first, list, n, watch, brick))
            return false;
        brick->state = state_of(brick);
        return true;
    }
    lr_layers in_band;
    for (int z = 0; z < LR_SIDE; z++)
        in_band[z] = side.inside[z] | side.outside[z];
    if (!flood(&side))
        return true; /* unknown */
    fill_rest(&side, in_band, brick);
    brick->contradicts = brick->contradicts || sides_meet(&side, in_band);
    if (job->filter == LR_FILTER_BOX &&
        !lr_box_brick(job->mesh, first, list, n, side.inside, watch, scratch->crossed, brick->value,
                      &brick->contradicts))
        return false;
    lr_layers_faces(side.inside, brick->faces.inside);
    lr_layers_faces(in_band, brick->faces.in_band);
    brick->state = state_of(brick);
    return true;
}
