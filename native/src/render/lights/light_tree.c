/* A tree of lights.
 *
 * Every node bounds its lights' places, directions and power, and so what they can
 * contribute at a point. From the root down, a child is chosen with a probability in
 * proportion to its bound. Distant lights, which have no place, and the world stand beside
 * the root.
 *
 * Source: Conty Estevez and Kulla, Importance sampling of many lights with adaptive
 * tree splitting, 2018 (bounds; orientation in the heuristic of the split); the
 * cosines without arc functions are those of Pharr, Jakob, Humphreys, Physically Based
 * Rendering, 4th ed., 2023, section 12.6.
 * Departures: 1. no splitting during traversal; at primary hits a few lights are chosen
 * by stratified numbers instead; 2. leaves are single lights; 3. boxes
 * count by their diagonals, not areas, which are 0 for lights in a row.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/lights/light_tree.h"

#include "render/lights/light.h"

#include "base/error.h"

enum {
    BINS = 12,
    HALVED = 60 /* levels after which lights are halved by number: 32 more suffice */
};

/* ---- angles, by their cosines ----------------------------------------------- */

static double sine_of(double cosine)
{
    return sqrt(fmax(1 - cosine * cosine, 0));
}

/* cos max(a - b, 0) */
static double cos_less(double cos_a, double cos_b)
{
    return cos_a > cos_b ? 1 : cos_a * cos_b + sine_of(cos_a) * sine_of(cos_b);
}

/* ---- nodes ------------------------------------------------------------------ */

static lr_light_node leaf_of(const lr_light *light, uint32_t light_index)
{
    lr_light_node node = {.child = light_index | LR_LIGHT_LEAF, .met = lr_light_has_extent(light)};
    lr_light_bound(light, &node.bounds);
    return node;
}

/* The smallest cone around both: directions within it of *axis. */
static void unite_cones(const lr_light_bounds *a, const lr_light_bounds *b, double axis[3],
                        double *cos_facing)
{
    const double of_a = acos(lr_clamp(a->cos_facing, -1, 1));
    const double of_b = acos(lr_clamp(b->cos_facing, -1, 1));
    const double apart = acos(lr_clamp(lr_dot(a->axis, b->axis), -1, 1));
    const lr_light_bounds *wide = of_a >= of_b ? a : b;
    const double wider = fmax(of_a, of_b), narrower = fmin(of_a, of_b);
    memcpy(axis, wide->axis, 3 * sizeof *axis);
    *cos_facing = wide->cos_facing;
    if (fmin(apart + narrower, LR_PI) <= wider)
        return;
    const double angle = 0.5 * (of_a + apart + of_b);
    const lr_light_bounds *other = wide == a ? b : a;
    double side[3];
    const double along = lr_dot(wide->axis, other->axis);
    for (int k = 0; k < 3; k++)
        side[k] = other->axis[k] - along * wide->axis[k];
    const double length = sqrt(lr_dot(side, side));
    *cos_facing = -1;
    if (angle >= LR_PI || !(length > 0))
        return;
    const double turn = angle - wider;
    *cos_facing = cos(angle);
    for (int k = 0; k < 3; k++)
        axis[k] = cos(turn) * wide->axis[k] + sin(turn) / length * side[k];
}

static void unite(lr_light_bounds *a, const lr_light_bounds *b)
{
    double axis[3], cos_facing;
    unite_cones(a, b, axis, &cos_facing);
    memcpy(a->axis, axis, sizeof axis);
    a->cos_facing = cos_facing;
    a->cos_emission = fmin(a->cos_emission, b->cos_emission);
    a->power += b->power;
    for (int k = 0; k < 3; k++) {
        a->lo[k] = fmin(a->lo[k], b->lo[k]);
        a->hi[k] = fmax(a->hi[k], b->hi[k]);
    }
}

/* ---- building --------------------------------------------------------------- */

static double centre(const lr_light_bounds *bounds, int axis)
{
    return 0.5 * (bounds->lo[axis] + bounds->hi[axis]);
}

/* Power by the square of the box's diagonal and by the directions into which it goes. */
static double cost_of(const lr_light_bounds *bounds)
{
    const double x = bounds->hi[0] - bounds->lo[0], y = bounds->hi[1] - bounds->lo[1];
    const double z = bounds->hi[2] - bounds->lo[2];
    const double facing = acos(lr_clamp(bounds->cos_facing, -1, 1));
    /* from the mean direction to the last one that is lit */
    const double widest = fmin(facing + acos(bounds->cos_emission), LR_PI);
    const double s = sin(facing);
    const double directions =
        2 * LR_PI * (1 - cos(facing)) +
        0.5 * LR_PI * (2 * widest * s - cos(facing - 2 * widest) - 2 * facing * s + cos(facing));
    return bounds->power * directions * (x * x + y * y + z * z);
}

/* Which bin of the centres' range lo..hi. */
static int bin_of(const lr_light_bounds *bounds, int axis, double lo, double hi)
{
    return (int32_t)lr_clamp((centre(bounds, axis) - lo) / (hi - lo) * BINS, 0, BINS - 1);
}

typedef struct lr_cut {
    double cost, lo, hi;
    int axis, bin; /* the first of the upper part */
} lr_cut;

/* The best cut of the leaves along one axis, if it is better. */
static void try_axis(const lr_light_node *leaves, uint32_t n, int axis, lr_cut *best)
{
    double lo = INFINITY, hi = -INFINITY, above[BINS];
    lr_light_bounds bins[BINS];
    bool used[BINS] = {false};
    for (uint32_t i = 0; i < n; i++) {
        lo = fmin(lo, centre(&leaves[i].bounds, axis));
        hi = fmax(hi, centre(&leaves[i].bounds, axis));
    }
    if (!(hi > lo && hi - lo < INFINITY))
        return;
    for (uint32_t i = 0; i < n; i++) {
        const int b = bin_of(&leaves[i].bounds, axis, lo, hi);
        if (used[b])
            unite(&bins[b], &leaves[i].bounds);
        else
            bins[b] = leaves[i].bounds;
        used[b] = true;
    }
    lr_light_bounds part = bins[BINS - 1]; /* holds the highest centre */
    for (int b = BINS - 1; b > 0; b--) {
        if (b < BINS - 1 && used[b])
            unite(&part, &bins[b]);
        above[b] = cost_of(&part);
    }
    part = bins[0];
    for (int b = 1; b < BINS; b++) {
        const double cost = cost_of(&part) + above[b];
        if (cost < best->cost)
            *best = (lr_cut){cost, lo, hi, axis, b};
        if (used[b])
            unite(&part, &bins[b]);
    }
}

/* Put the leaves of the lower part first; returns how many. */
static uint32_t part(lr_light_node *leaves, uint32_t n, uint32_t depth)
{
    lr_cut best = {.cost = INFINITY};
    for (int axis = 0; axis < 3 && depth < HALVED; axis++)
        try_axis(leaves, n, axis, &best);
    if (!(best.cost < INFINITY))
        return n / 2;
    uint32_t low = 0;
    for (uint32_t i = 0; i < n; i++)
        if (bin_of(&leaves[i].bounds, best.axis, best.lo, best.hi) < best.bin) {
            const lr_light_node swap = leaves[low];
            leaves[low++] = leaves[i];
            leaves[i] = swap;
        }
    return low;
}

/* The node at `at` becomes the tree over the n leaves. */
static void grow(lr_light_tree *light_tree, lr_light_node *leaves, uint32_t n, uint32_t at,
                 uint32_t parent, uint32_t depth)
{
    lr_light_node *node = &light_tree->nodes[at];
    if (n == 1) {
        *node = leaves[0];
        node->parent = parent;
        light_tree->leaf[node->child & ~LR_LIGHT_LEAF] = at;
        return;
    }
    const uint32_t low = part(leaves, n, depth), child = light_tree->n_nodes;
    light_tree->n_nodes += 2;
    grow(light_tree, leaves, low, child, at, depth + 1);
    grow(light_tree, leaves + low, n - low, child + 1, at, depth + 1);
    *node = light_tree->nodes[child];
    unite(&node->bounds, &light_tree->nodes[child + 1].bounds);
    node->met = node->met || light_tree->nodes[child + 1].met;
    node->child = child;
    node->parent = parent;
}

lr_status lr_light_tree_make(const lr_light *lights, uint64_t n_lights,
                             const lr_environment *environment, lr_light_tree *light_tree,
                             lr_error *error)
{
    *light_tree = (lr_light_tree){.n_lights = n_lights};
    light_tree->n = n_lights + (environment->width > 0);
    light_tree->world = LR_PI * environment->brightness;
    if (n_lights >= LR_LIGHT_LEAF / 2)
        return lr_fail(error, LR_E_SIZE, "a scene holds up to %u lights, there are %llu",
                       LR_LIGHT_LEAF / 2 - 1, (unsigned long long)n_lights);
    const size_t n = (size_t)n_lights + 1;
    lr_light_node *leaves = malloc(n * sizeof *leaves);
    light_tree->nodes = malloc(2 * n * sizeof *light_tree->nodes);
    light_tree->leaf = malloc(n * sizeof *light_tree->leaf);
    const bool got = leaves && light_tree->nodes && light_tree->leaf;
    uint32_t n_leaves = 0;
    for (uint32_t i = 0; i < n_lights && got; i++) {
        const lr_light_node leaf = leaf_of(&lights[i], i);
        if (leaf.bounds.distant) {
            light_tree->leaf[i] = light_tree->n_distant;
            light_tree->nodes[light_tree->n_distant++] = leaf;
        } else {
            leaves[n_leaves++] = leaf;
        }
    }
    const uint32_t root = light_tree->n_distant;
    light_tree->n_nodes = root + (n_leaves > 0);
    if (n_leaves > 0)
        grow(light_tree, leaves, n_leaves, root, root, 0);
    free(leaves);
    if (got)
        return LR_OK;
    lr_light_tree_free(light_tree);
    return lr_fail_memory(error, 4 * n * sizeof *leaves, "the lights");
}

void lr_light_tree_free(lr_light_tree *light_tree)
{
    free(light_tree->nodes);
    free(light_tree->leaf);
    *light_tree = (lr_light_tree){.n = 0};
}

/* ---- choosing --------------------------------------------------------------- */

/* The largest cosine to n of directions within an angle (its cosine) of d; 1 without n. */
static double facing(const double n[3], const double d[3], double cos_around)
{
    if (n[0] == 0 && n[1] == 0 && n[2] == 0)
        return 1;
    return fmax(cos_less(lr_clamp(lr_dot(n, d), -1, 1), cos_around), 0);
}

/* A bound of the irradiance of the lights, but for the distance, for which that of the box's
 * centre is taken, or its radius if that is longer. */
static double bound(const lr_light_bounds *bounds, const double p[3], const double n[3])
{
    double to[3], radius2 = 0;
    for (int a = 0; a < 3; a++) {
        const double half = 0.5 * (bounds->hi[a] - bounds->lo[a]);
        to[a] = centre(bounds, a) - p[a];
        radius2 += half * half;
    }
    const double square = lr_dot(to, to);
    if (!(square > radius2)) /* within: all is possible */
        return radius2 > 0 ? bounds->power / radius2 : 0;
    const double distance = sqrt(square);
    const double cos_seen = sqrt(1 - radius2 / square); /* of the box's half width */
    for (int a = 0; a < 3; a++)
        to[a] /= distance;
    const double cos_axis = lr_clamp(-lr_dot(to, bounds->axis), -1, 1);
    const double cos_least = cos_less(cos_less(cos_axis, bounds->cos_facing), cos_seen);
    if (cos_least < bounds->cos_emission)
        return 0;
    return bounds->power * cos_least * facing(n, to, cos_seen) / square;
}

static double bound_distant(const lr_light_bounds *bounds, const double n[3])
{
    return bounds->power * facing(n, bounds->axis, bounds->cos_facing);
}

/* Of the lights of the tree alone. */
static double bound_root(const lr_light_tree *light_tree, const double p[3], const double n[3])
{
    const uint32_t root = light_tree->n_distant;
    return light_tree->n_nodes > root ? bound(&light_tree->nodes[root].bounds, p, n) : 0;
}

/* Of all lights beside each other: the tree, the distant lights, the world. */
static double bound_all(const lr_light_tree *light_tree, const double p[3], const double n[3])
{
    double all = light_tree->world;
    for (uint32_t i = 0; i < light_tree->n_distant; i++)
        all += bound_distant(&light_tree->nodes[i].bounds, n);
    return all + bound_root(light_tree, p, n);
}

/* The first one's fraction of what two neighbours can contribute; -1 where that is 0. */
static double first_fraction(const lr_light_node *child, const double p[3], const double n[3])
{
    const double first = bound(&child[0].bounds, p, n), second = bound(&child[1].bounds, p, n);
    return first + second > 0 ? first / (first + second) : -1;
}

/* Down the tree; u in 0..1 is used up. */
static uint64_t descend(const lr_light_tree *light_tree, const double p[3], const double n[3],
                        double u, double *probability)
{
    const lr_light_node *node = &light_tree->nodes[light_tree->n_distant];
    while ((node->child & LR_LIGHT_LEAF) == 0) {
        const lr_light_node *child = &light_tree->nodes[node->child];
        const double fraction = first_fraction(child, p, n);
        if (fraction < 0)
            return LR_LIGHT_NONE;
        const bool first = u < fraction;
        u = fmin(first ? u / fraction : (u - fraction) / (1 - fraction), 1 - 0x1p-53);
        *probability *= first ? fraction : 1 - fraction;
        node = first ? child : child + 1;
    }
    return node->child & ~LR_LIGHT_LEAF;
}

uint64_t lr_light_tree_choose(const lr_light_tree *light_tree, const double p[3], const double n[3],
                              double u, double *probability)
{
    const double all = bound_all(light_tree, p, n);
    if (!(all > 0))
        return LR_LIGHT_NONE;
    double x = u * all;
    for (uint32_t i = 0; i < light_tree->n_distant; i++) {
        const double distant = bound_distant(&light_tree->nodes[i].bounds, n);
        *probability = distant / all;
        if (x < distant)
            return light_tree->nodes[i].child & ~LR_LIGHT_LEAF;
        x -= distant;
    }
    *probability = light_tree->world / all;
    if (x < light_tree->world)
        return light_tree->n_lights;
    x -= light_tree->world;
    const double tree = bound_root(light_tree, p, n);
    *probability = tree / all;
    if (!(tree > 0)) /* by rounding */
        return LR_LIGHT_NONE;
    return descend(light_tree, p, n, lr_clamp(x / tree, 0, 1 - 0x1p-53), probability);
}

double lr_light_tree_probability(const lr_light_tree *light_tree, uint64_t light_index,
                                 const double p[3], const double n[3])
{
    const double all = bound_all(light_tree, p, n);
    if (!(all > 0))
        return 0;
    if (light_index == light_tree->n_lights)
        return light_tree->world / all;
    uint32_t at = light_tree->leaf[light_index];
    if (at < light_tree->n_distant)
        return bound_distant(&light_tree->nodes[at].bounds, n) / all;
    double probability = bound_root(light_tree, p, n) / all;
    while (at != light_tree->n_distant && probability > 0) {
        const lr_light_node *parent = &light_tree->nodes[light_tree->nodes[at].parent];
        const double fraction = first_fraction(&light_tree->nodes[parent->child], p, n);
        if (fraction < 0)
            return 0;
        probability *= at == parent->child ? fraction : 1 - fraction;
        at = light_tree->nodes[at].parent;
    }
    return probability;
}

/* ---- rays ------------------------------------------------------------------- */

void lr_light_tree_start(const lr_light_tree *light_tree, lr_light_walk *walk)
{
    walk->n_distant = 0;
    walk->n = light_tree->n_nodes > light_tree->n_distant;
    walk->node[0] = light_tree->n_distant;
}

/* A fraction by which boxes are grown against rounding. */
static const double MARGIN = 0x1p-40;

static bool meets(const lr_light_bounds *bounds, const double o[3], const double d[3], double t_max)
{
    double enter = 0, leave = t_max;
    for (int a = 0; a < 3; a++) {
        const double slack = MARGIN * (fabs(bounds->lo[a]) + fabs(bounds->hi[a]) + fabs(o[a]));
        const double t0 = (bounds->lo[a] - slack - o[a]) / d[a];
        const double t1 = (bounds->hi[a] + slack - o[a]) / d[a];
        if (d[a] == 0) {
            if (o[a] < bounds->lo[a] - slack || o[a] > bounds->hi[a] + slack)
                return false;
            continue;
        }
        enter = fmax(enter, fmin(t0, t1));
        leave = fmin(leave, fmax(t0, t1));
    }
    return enter <= leave * (1 + MARGIN);
}

uint64_t lr_light_tree_next(const lr_light_tree *light_tree, lr_light_walk *walk, const double o[3],
                            const double d[3], double t_max)
{
    while (walk->n_distant < light_tree->n_distant && !(t_max < INFINITY)) {
        const lr_light_node *node = &light_tree->nodes[walk->n_distant++];
        if (node->met)
            return node->child & ~LR_LIGHT_LEAF;
    }
    while (walk->n > 0) {
        const lr_light_node *node = &light_tree->nodes[walk->node[--walk->n]];
        if (!node->met || !meets(&node->bounds, o, d, t_max))
            continue;
        if ((node->child & LR_LIGHT_LEAF) != 0)
            return node->child & ~LR_LIGHT_LEAF;
        walk->node[walk->n++] = node->child + 1;
        walk->node[walk->n++] = node->child;
    }
    return LR_LIGHT_NONE;
}
