/* Fills large holes of a mesh voxelized as a solid, by the 0.5 level set of its generalized
 * winding number.
 *
 * The number falls from 1 to 0 through a hole; a point is inside where it is above 1/2. Its
 * difference from 1/2, over its slope, is the distance to the level set, to first order:
 * exact on it, with a relative error beside it that falls with the hole's width in voxels.
 * Samples of a brick that no surface separates are decided together, from every other
 * sample, and one by one only where the number comes near 1/2.
 *
 * The level set ends at borders of the mesh and nowhere else (the number is harmonic, so it
 * has no bounded level set of its own), so the bricks that it crosses are found by a flood
 * fill from those of the mesh.
 *
 * Source: Jacobson, Kavan, Sorkine-Hornung 2013, Robust inside-outside segmentation using
 * generalized winding numbers.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/hole_fill.h"

#include "voxelize/link_samples.h"

/* Where the number differs more from 1/2, the mesh is nearer than the level set: at a straight
 * border the difference is the angle from the level set, over 2 pi, and this a right angle. */
#define NEAR_HALF 0.25

/* Largest error of an approximate winding number (lr_winding_slope without `fine`). */
#define DOUBT 0.02

/* Largest distance of a sample from one that is probed: the diagonal of a cell. */
#define APART 1.7321

/* Samples of a brick lie within HALF_DIAGONAL of its centre; BEND is for the curvature of the
 * level set. */
#define HALF_DIAGONAL 6.0622
#define BEND          1.25

/* ---- samples ----------------------------------------------------------- */

typedef struct brick_samples {
    const lr_winding *winding;
    const int32_t *first;
    double band;
    float *distance;
} brick_samples;

static void place_of(const brick_samples *c, int sample, double p[3])
{
    for (int a = 0; a < 3; a++)
        p[a] = c->first[a] + lr_along(sample, a);
}

/* The signed distance of one sample. */
static void set_distance(const brick_samples *c, int sample)
{
    double p[3], gradient[3];
    place_of(c, sample, p);
    double beyond = fabs(lr_winding_slope(c->winding, p, false, gradient)) - 0.5;
    double d = fmin(fabs((double)c->distance[sample]), c->band);
    double bound = 2.0 * d * sqrt(lr_dot(gradient, gradient)) + DOUBT;
    if (fabs(beyond) < fmin(bound, NEAR_HALF + DOUBT)) {
        beyond = fabs(lr_winding_slope(c->winding, p, true, gradient)) - 0.5;
        const double slope = sqrt(lr_dot(gradient, gradient));
        if (slope > 0.0 && fabs(beyond) < NEAR_HALF)
            d = fmin(d, fabs(beyond) / slope);
    }
    c->distance[sample] = (float)(beyond > 0.0 ? d : -d);
}

/* What the probed samples of a component found. */
enum { SOME_INSIDE = 1, SOME_OUTSIDE = 2, SURFACE_NEAR = 4 };

/* Probe every other sample along each axis and the components' roots; what[LR_CELLS], by root.
 * No sample is farther than APART from one that is probed. */
static void probe(const brick_samples *c, uint16_t *parent, uint8_t *what)
{
    memset(what, 0, LR_CELLS);
    for (uint16_t i = 0; i < LR_CELLS; i++) {
        const uint16_t root = lr_linked_root(parent, i);
        const bool on_grid = ((lr_along(i, 0) | lr_along(i, 1) | lr_along(i, 2)) & 1) == 0;
        if (what[root] == (SOME_INSIDE | SOME_OUTSIDE | SURFACE_NEAR) || (!on_grid && root != i))
            continue;
        double p[3], gradient[3];
        place_of(c, i, p);
        const double beyond = fabs(lr_winding_slope(c->winding, p, false, gradient)) - 0.5;
        const double bound = 2.0 * (c->band + APART) * sqrt(lr_dot(gradient, gradient)) + DOUBT;
        what[root] |= beyond > 0.0 ? SOME_INSIDE : SOME_OUTSIDE;
        what[root] |= fabs(beyond) < fmin(bound, NEAR_HALF + DOUBT) ? SURFACE_NEAR : 0;
    }
}

bool lr_hole_fill_brick(const lr_winding *winding, const int32_t first[3], double band,
                        const uint8_t *loose, const lr_watch *watch, float *distance)
{
    const brick_samples c = {
        .winding = winding, .first = first, .band = band, .distance = distance};
    float linked[LR_CELLS];
    uint16_t parent[LR_CELLS];
    uint8_t what[LR_CELLS];
    for (int i = 0; i < LR_CELLS; i++)
        linked[i] = loose[i] ? 0.0f : fminf(fabsf(distance[i]), (float)band);
    lr_link_samples(linked, parent);
    probe(&c, parent, what);
    for (uint16_t i = 0; i < LR_CELLS; i++) {
        const uint8_t of_all = what[lr_linked_root(parent, i)];
        const float d = fminf(fabsf(distance[i]), (float)band);
        if (i % LR_SIDE == 0 && lr_stopped(watch))
            return false;
        if (of_all == SOME_INSIDE || of_all == SOME_OUTSIDE)
            distance[i] = of_all == SOME_INSIDE ? d : -d;
        else
            set_distance(&c, i);
    }
    return true;
}

/* ---- bricks ------------------------------------------------------------ */

enum { TESTED = 1 };

typedef struct spread {
    const lr_winding *winding;
    const int32_t *size; /* of the table */
    double radius;       /* of a ball around a brick's centre that holds brick and band */
    uint8_t *state;      /* [table]: 0, TESTED or LR_BIN_ACTIVE */
    uint32_t *queue;     /* bricks whose neighbours are to be tested */
    size_t n, room;
} spread;

/* Can the level set come within the radius of the brick's centre? */
static bool comes_near(const spread *s, size_t at)
{
    int32_t first[3];
    double p[3], gradient[3];
    lr_first_sample(s->size, (uint32_t)at, first);
    for (int a = 0; a < 3; a++)
        p[a] = first[a] + 0.5 * (LR_SIDE - 1);
    const double beyond = fabs(lr_winding_slope(s->winding, p, false, gradient)) - 0.5;
    return fabs(beyond) <= s->radius * sqrt(lr_dot(gradient, gradient)) + DOUBT;
}

static bool push(spread *s, size_t at)
{
    if (s->n == s->room) {
        const size_t room = 2 * s->room + 1024;
        uint32_t *more = realloc(s->queue, room * sizeof *more);
        if (more == NULL)
            return false;
        s->queue = more;
        s->room = room;
    }
    s->state[at] = LR_BIN_ACTIVE;
    s->queue[s->n++] = (uint32_t)at;
    return true;
}

static lr_status spread_out(spread *s, const lr_watch *watch, lr_error *error)
{
    for (size_t i = 0; i < s->n; i++) {
        size_t rest = s->queue[i], step = 1;
        if (i % 16 == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        for (int side = 0; side < 6; side++) {
            const size_t n = (size_t)s->size[side / 2], x = rest % n;
            const size_t next = side % 2 ? s->queue[i] + step : s->queue[i] - step;
            if ((side % 2 ? x + 1 < n : x > 0) && s->state[next] == 0) {
                s->state[next] = TESTED;
                if (comes_near(s, next) && !push(s, next))
                    return lr_fail_memory(error, 2 * s->room * sizeof *s->queue,
                                          "the surfaces that fill holes");
            }
            if (side % 2) {
                rest /= n;
                step *= n;
            }
        }
    }
    return LR_OK;
}

lr_status lr_hole_fill_bricks(const lr_winding *winding, const int32_t table_size[3], double band,
                              const lr_watch *watch, lr_bins *bins, lr_error *error)
{
    const size_t n_table = (size_t)table_size[0] * (size_t)table_size[1] * (size_t)table_size[2];
    spread s = {.winding = winding, .size = table_size, .radius = BEND * (HALF_DIAGONAL + band)};
    s.state = calloc(n_table, 1);
    lr_status status = LR_OK;
    if (s.state == NULL)
        status = lr_fail_memory(error, n_table, "the surfaces that fill holes");
    for (uint32_t i = 0; i < bins->n_active && status == LR_OK; i++)
        if (!push(&s, bins->brick[i]))
            status = lr_fail_memory(error, bins->n_active * sizeof *s.queue,
                                    "the surfaces that fill holes");
    if (status == LR_OK)
        status = spread_out(&s, watch, error);
    if (status == LR_OK)
        status = lr_bins_add(bins, s.state, n_table, (uint32_t)s.n, error);
    free(s.state);
    free(s.queue);
    return status;
}
