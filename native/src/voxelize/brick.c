/* From nearest triangles to the samples of a brick.
 *
 * Samples in the band take the signed distance to their nearest triangle, those of
 * a sheet the height over it, which runs on beyond its rim. Most meet the triangle in
 * its face and take the height that the search found; f64 measures those at edges
 * and corners, a few per cent. The others of a solid
 * take the side of their neighbours: a link between two neighbours of which one is
 * beyond the band (at least sqrt(3) voxels wide) cannot cross the surface, so sides
 * spread along the axes; that is done 64 samples at a time, one bit each. What lies
 * outside the lattice is outside.
 * A brick without any sample in the band stays unknown and is decided among
 * bricks (voxelize.c).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/brick.h"

#include <immintrin.h>

#include "mesh/triangle_distance.h"
#include "voxelize/component_sides.h"
#include "voxelize/coverage.h"
#include "voxelize/filter_profile.h"
#include "voxelize/hole_fill.h"

/* The nearest triangle is chosen in f32; its exact distance can exceed the band by this. */
#define BAND_SLACK 1e-3

/* A height of f32 above this has its sign; below, f64 decides. */
#define SURE 1e-3f

enum { POLL = 1 << 8 }; /* triangles between looks at the stop word: each may meet 512 cells */

/* A layer of a brick, one bit per sample: x + 8 y. */
typedef struct sides {
    uint64_t inside[8], outside[8];
} sides;

static void place_of(const lr_voxel_job *job, uint32_t at, int32_t first[3])
{
    uint32_t nx = (uint32_t)job->table_size[0], ny = (uint32_t)job->table_size[1];
    first[0] = 8 * (int32_t)(at % nx);
    first[1] = 8 * (int32_t)(at / nx % ny);
    first[2] = 8 * (int32_t)(at / nx / ny);
}

LR_INLINE int32_t sample_of(int tile, int lane)
{
    return lr_sample_x(tile, lane) + 8 * lr_sample_y(tile, lane) + 64 * lr_sample_z(tile, lane);
}

/* Samples of squared distances up to `most` as linked lists of the triangles that won them. */
static void group(const lr_nearest *nearest, float most, lr_scratch *scratch)
{
    for (int tile = 0; tile < LR_TILES; tile++)
        for (int lane = 0; lane < LR_LANES; lane++) {
            int32_t who = nearest->winner[tile][lane];
            if (who < 0 || nearest->d2[tile][lane] > most)
                continue;
            int32_t sample = sample_of(tile, lane);
            scratch->next[sample] = scratch->first[who];
            scratch->first[who] = sample;
        }
}

/* Signed distances of the samples whose nearest triangle is met in its face, and
 * infinity for the others; those that f64 has to measure are grouped. */
static void take_heights(const lr_voxel_job *job, lr_scratch *scratch, float *distance)
{
    const lr_nearest *nearest = &scratch->nearest;
    const __m128 turn = _mm_set1_ps((float)-job->mesh->side), sign = _mm_set1_ps(-0.0f);
    for (int tile = 0; tile < LR_TILES; tile++)
        for (int lane = 0; lane < LR_LANES; lane += 4) {
            int32_t sample = sample_of(tile, lane);
            __m128 h = _mm_load_ps(&nearest->height[tile][lane]), size = _mm_andnot_ps(sign, h);
            __m128 sure = _mm_and_ps(_mm_cmpgt_ps(size, _mm_set1_ps(SURE)),
                                     _mm_cmplt_ps(size, _mm_set1_ps(INFINITY)));
            __m128 s = _mm_and_ps(sure, _mm_mul_ps(h, turn));
            s = _mm_or_ps(s, _mm_andnot_ps(sure, _mm_set1_ps(INFINITY)));
            _mm_store_ps(&distance[sample], s);
            for (int left = ~_mm_movemask_ps(sure) & 15; left != 0; left &= left - 1) {
                int i = __builtin_ctz((unsigned)left);
                int32_t who = nearest->winner[tile][lane + i];
                if (who < 0)
                    continue;
                scratch->next[sample + i] = scratch->first[who];
                scratch->first[who] = sample + i;
            }
        }
}

static void frame_of(const lr_topology *mesh, const int32_t first[3], uint32_t t, lr_frame *frame)
{
    lr_triangle(mesh, t, frame->p);
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++)
            frame->p[c][a] -= first[a];
}

/* Measure what is grouped in f64. */
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
        frame_of(mesh, first, list[i], &frame);
        if (!lr_frame_make(&frame)) /* rounding took the area of a sliver */
            continue;
        for (; sample >= 0; sample = scratch->next[sample]) {
            const double p[3] = {sample & 7, sample >> 3 & 7, sample >> 6};
            bool border;
            double height, s = lr_signed_distance(mesh, list[i], &frame, p, &height, &border);
            if (fabs(s) <= job->band + BAND_SLACK)
                distance[sample] = (float)(mesh->side * (job->sheet ? height : s));
            if (loose != NULL)
                loose[sample] = border;
        }
    }
}

static void take_ids(const lr_voxel_job *job, const uint32_t *list, const lr_nearest *nearest,
                     const float *distance, lr_brick *brick)
{
    for (int tile = 0; tile < LR_TILES; tile++)
        for (int lane = 0; lane < LR_LANES; lane++) {
            int32_t who = nearest->winner[tile][lane], sample = sample_of(tile, lane);
            if (who >= 0 && distance[sample] != INFINITY)
                brick->id[sample] = job->mesh->source.ids[list[who]];
        }
}

/* Sides by the winding number of the component. */
static void take_sides(const lr_scratch *scratch, float *distance)
{
    for (int i = 0; i < LR_BRICK_SAMPLES; i++)
        if (scratch->labels[i] != LR_UNLABELLED) {
            bool inside = scratch->components[scratch->labels[i]].inside;
            distance[i] = inside ? fabsf(distance[i]) : -fabsf(distance[i]);
        }
}

/* Distances of neighbours differ by the voxel between them at most, if their signs are
 * right; MOST leaves room for rounding. */
#define MOST 1.001f

static bool contradicts(const float *distance)
{
    static const int STEP[3] = {1, 8, 64};
    const __m128 infinity = _mm_set1_ps(INFINITY), sign = _mm_set1_ps(-0.0f);
    int found = 0;
    for (int a = 0; a < 3; a++)
        for (int i = 0; i + STEP[a] < LR_BRICK_SAMPLES; i += 4) {
            if (a > 0 && (i >> (3 * a) & 7) == 7)
                continue;
            __m128 p = _mm_load_ps(&distance[i]), q = _mm_loadu_ps(&distance[i + STEP[a]]);
            __m128 known = _mm_and_ps(_mm_cmplt_ps(p, infinity), _mm_cmplt_ps(q, infinity));
            __m128 apart = _mm_cmpgt_ps(_mm_andnot_ps(sign, _mm_sub_ps(p, q)), _mm_set1_ps(MOST));
            int bits = _mm_movemask_ps(_mm_and_ps(known, apart));
            found |= a == 0 && (i & 4) != 0 ? bits & 7 : bits; /* the row ends */
        }
    return found != 0;
}

/* Values of the ramp, and sides; 0 and neither side where there is no distance. */
static void settle(const lr_voxel_job *job, const float *distance, sides *side, lr_brick *brick)
{
    const __m128 slope = _mm_set1_ps((float)(0.5 / job->half_width)), one = _mm_set1_ps(1.0f);
    const __m128 half = _mm_set1_ps(0.5f), zero = _mm_setzero_ps();
    for (int i = 0; i < LR_BRICK_SAMPLES; i += 4) {
        __m128 s = _mm_load_ps(&distance[i]), known = _mm_cmplt_ps(s, _mm_set1_ps(INFINITY));
        __m128 value = _mm_add_ps(half, _mm_mul_ps(s, slope));
        value = _mm_min_ps(_mm_max_ps(value, zero), one);
        _mm_store_ps(&brick->value[i], _mm_and_ps(known, value));
        uint64_t inside = (uint64_t)_mm_movemask_ps(_mm_and_ps(known, _mm_cmpge_ps(s, zero)));
        uint64_t outside = (uint64_t)_mm_movemask_ps(_mm_cmplt_ps(s, zero));
        side->inside[i >> 6] |= inside << (i & 63);
        side->outside[i >> 6] |= outside << (i & 63);
    }
}

/* Instead of the ramp's. */
static void set_profile(const lr_voxel_job *job, const float *distance, lr_brick *brick)
{
    for (int i = 0; i < LR_BRICK_SAMPLES; i++)
        if (job->closing != NULL && job->filter == LR_FILTER_BOX) /* no triangle to be cut by */
            brick->value[i] = (float)lr_clamp(0.5 + distance[i], 0.0, 1.0);
        else if (distance[i] != INFINITY)
            brick->value[i] = (float)lr_profile(job->filter, distance[i], job->half_width);
}

/* Let the samples that can be corners of surface cells name their triangles. */
static void name_nearest(const lr_voxel_job *job, const int32_t first[3], const uint32_t *list,
                         uint32_t n, lr_scratch *scratch, lr_brick *brick)
{
    const float reach = (float)(LR_BAKE_REACH * LR_BAKE_REACH);
    float nearest = INFINITY;
    for (int tile = 0; tile < LR_TILES; tile++)
        for (int lane = 0; lane < LR_LANES; lane++)
            if (scratch->nearest.winner[tile][lane] >= 0)
                nearest = fminf(nearest, scratch->nearest.d2[tile][lane]);
    if (!(nearest <= reach))
        return;
    memset(scratch->nearest_triangle, 0, LR_BRICK_SAMPLES * sizeof *scratch->nearest_triangle);
    brick->has_nearest = true;
    group(&scratch->nearest, reach, scratch);
    for (uint32_t i = 0; i < n; i++) {
        int32_t sample = scratch->first[i];
        scratch->first[i] = -1;
        lr_frame frame;
        frame_of(job->mesh, first, list[i], &frame);
        for (; sample >= 0 && lr_frame_make(&frame); sample = scratch->next[sample])
            scratch->nearest_triangle[sample] = list[i] + 1;
    }
}

/* Bits of a layer along y and x that lie in the lattice. */
static uint64_t lattice_layer(const lr_voxel_job *job, const int32_t first[3], int z)
{
    if (first[2] + z < LR_PAD || first[2] + z >= LR_PAD + job->size[2])
        return 0;
    uint64_t layer = 0;
    for (int y = 0; y < 8; y++) {
        if (first[1] + y < LR_PAD || first[1] + y >= LR_PAD + job->size[1])
            continue;
        for (int x = 0; x < 8; x++)
            if (first[0] + x >= LR_PAD && first[0] + x < LR_PAD + job->size[0])
                layer |= (uint64_t)1 << (x + 8 * y);
    }
    return layer;
}

static void clear_outside(const lr_voxel_job *job, const int32_t first[3], sides *side,
                          lr_brick *brick)
{
    for (int z = 0; z < 8; z++) {
        uint64_t beyond = ~lattice_layer(job, first, z);
        side->inside[z] &= ~beyond;
        side->outside[z] |= beyond;
        for (; beyond != 0; beyond &= beyond - 1) {
            int sample = 64 * z + __builtin_ctzll(beyond);
            brick->value[sample] = 0.0f;
            if (job->mesh->source.ids != NULL)
                brick->id[sample] = 0;
        }
    }
}

#define COLUMN_0 0x0101010101010101u
#define COLUMN_7 0x8080808080808080u

static uint64_t neighbours(const uint64_t layer[8], int z)
{
    uint64_t w = layer[z];
    uint64_t spread = (w << 1 & ~COLUMN_0) | (w >> 1 & ~COLUMN_7) | w << 8 | w >> 8;
    return spread | (z > 0 ? layer[z - 1] : 0) | (z < 7 ? layer[z + 1] : 0);
}

/* Let known sides spread until all are known; false where none is. */
static bool flood(sides *side)
{
    uint64_t known = 0;
    for (int z = 0; z < 8; z++)
        known |= side->inside[z] | side->outside[z];
    if (known == 0)
        return false;
    for (uint64_t missing = 1; missing != 0;) {
        missing = 0;
        for (int z = 0; z < 8; z++) {
            uint64_t open = ~(side->inside[z] | side->outside[z]);
            if (open == 0)
                continue;
            uint64_t outside = open & neighbours(side->outside, z);
            uint64_t inside = open & ~outside & neighbours(side->inside, z);
            side->outside[z] |= outside;
            side->inside[z] |= inside;
            missing |= open & ~outside & ~inside;
        }
    }
    return true;
}

/* Two neighbours of which one is beyond the band lie on one side. */
static bool sides_meet(const sides *side, const uint64_t in_band[8])
{
    uint64_t far_outside[8], found = 0;
    for (int z = 0; z < 8; z++)
        far_outside[z] = side->outside[z] & ~in_band[z];
    for (int z = 0; z < 8; z++)
        found |= (side->inside[z] & neighbours(far_outside, z)) |
                 (side->inside[z] & ~in_band[z] & neighbours(side->outside, z));
    return found != 0;
}

/* The first column of a layer, side by side. */
static uint64_t column(uint64_t layer)
{
    return (layer & COLUMN_0) * 0x0102040810204080u >> 56;
}

static void take_faces(const uint64_t layer[8], uint64_t face[6])
{
    memset(face, 0, 6 * sizeof *face);
    for (int z = 0; z < 8; z++) {
        face[0] |= column(layer[z]) << (8 * z);
        face[1] |= column(layer[z] >> 7) << (8 * z);
        face[2] |= (layer[z] & 0xff) << (8 * z);
        face[3] |= (layer[z] >> 56) << (8 * z);
    }
    face[4] = layer[0];
    face[5] = layer[7];
}

static void fill_rest(const sides *side, const uint64_t in_band[8], lr_brick *brick)
{
    for (int z = 0; z < 8; z++)
        for (uint64_t left = side->inside[z] & ~in_band[z]; left != 0; left &= left - 1)
            brick->value[64 * z + __builtin_ctzll(left)] = 1.0f;
}

static lr_brick_state state_of(const lr_brick *brick)
{
    uint64_t touched = 0;
    for (int i = 0; i < 8; i++)
        touched |= brick->touched[i];
    for (int i = 0; i < LR_BRICK_SAMPLES; i++)
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

bool lr_brick_distances(const lr_voxel_job *job, uint32_t at, const uint32_t *list, uint32_t n,
                        const lr_watch *watch, lr_scratch *scratch, float *distance, uint8_t *loose)
{
    int32_t first[3];
    double centre[3];
    place_of(job, at, first);
    for (int a = 0; a < 3; a++)
        centre[a] = first[a] + 3.5;
    if (!job->search(job->mesh, centre, list, n, job->band, watch, &scratch->nearest))
        return false;
    take_heights(job, scratch, distance);
    measure(job, first, list, n, scratch, distance, loose);
    return true;
}

bool lr_brick_make(const lr_voxel_job *job, uint32_t at, const uint32_t *list, uint32_t n,
                   const lr_watch *watch, lr_scratch *scratch, lr_brick *brick)
{
    int32_t first[3];
    place_of(job, at, first);
    sides side = {0};
    _Alignas(16) float distance[LR_BRICK_SAMPLES + 4]; /* a neighbour beyond the end is read */
    brick->state = LR_STATE_UNKNOWN;
    brick->has_nearest = false;
    memset(brick->touched, 0, sizeof brick->touched);
    uint8_t loose[LR_BRICK_SAMPLES] = {0};
    if (!lr_brick_distances(job, at, list, n, watch, scratch, distance,
                            job->closing != NULL ? loose : NULL))
        return false;
    if (job->closing != NULL &&
        !lr_closing_brick(job->closing, first, job->band, loose, watch, distance))
        return false;
    if (scratch->labels != NULL)
        take_sides(scratch, distance);
    brick->contradicts =
        !job->sheet && scratch->labels == NULL && job->closing == NULL && contradicts(distance);
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
    uint64_t in_band[8];
    for (int z = 0; z < 8; z++)
        in_band[z] = side.inside[z] | side.outside[z];
    if (!flood(&side))
        return true; /* unknown */
    fill_rest(&side, in_band, brick);
    brick->contradicts = brick->contradicts || sides_meet(&side, in_band);
    if (job->filter == LR_FILTER_BOX &&
        !lr_box_brick(job->mesh, first, list, n, side.inside, watch, scratch->crossed, brick->value,
                      &brick->contradicts))
        return false;
    take_faces(side.inside, brick->faces.inside);
    take_faces(in_band, brick->faces.in_band);
    brick->state = state_of(brick);
    return true;
}
