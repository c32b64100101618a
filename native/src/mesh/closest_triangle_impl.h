/* The search of closest_triangle.h, compiled once per instruction set.
 *
 * The forms of triangle_distance.h are set up for sixteen triangles at a time; then each
 * triangle is tested against the tiles that its box may be nearest to, sixteen samples at a
 * time. Two bounds precede the distance: that of the box, against the largest distance in
 * half a tile, and that of height and largest excess, which is the distance but at corners,
 * against each sample. A bound is tested for the whole batch before the next one, so that
 * few branches are mispredicted.
 *
 * All is f32 around the brick's centre; edges are differences in f64, so the error of a fat
 * triangle is some 1e-6 voxel. Slivers and long triangles are set up in f64, and their edges
 * measured from their point closest to the centre.
 *
 * The includer defines LR_LANES_SIMD and LR_SEARCH, the function's name.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/simd.h"

enum {
    EDGES = 3,
    FIRST = 1 + EDGES, /* forms that are evaluated first: height, excess of each edge */
    POLL = 1 << 6      /* batches between checks of the stop word */
};

/* Rounding of the f32 forms, in voxels: a triangle that is within it of being
 * the nearest must not be culled. Coordinates up to 3.5 + band in sums of three
 * products lose a few 2^-24 of that. */
#define SLACK 1e-4f

/* A triangle is fat where its height is above this fraction of its longest side,
 * and that side below so many voxels: then rounding to f32 tilts it by less than
 * 1e-6. */
#define FAT   0.1f
#define SHORT 8.0f

/* Sixteen triangles: gradient x, y, z, and value at the brick's centre, of height
 * and each edge's excess, and of the place along each edge; the range of place on
 * the edge; bounding boxes. */
typedef struct batch {
    _Alignas(64) float first[4][FIRST][LR_LANES];
    _Alignas(64) float of[4][LR_LANES][FIRST]; /* the same, triangle by triangle */
    _Alignas(64) float place[EDGES][4][LR_LANES];
    _Alignas(64) float lo[EDGES][LR_LANES], hi[EDGES][LR_LANES];
    _Alignas(64) float middle[3][LR_LANES], half[3][LR_LANES];
    _Alignas(64) float gap[3][LR_LANES][LR_LAYERS]; /* squared, to the layers of cubes */
} batch;

typedef struct corners {
    _Alignas(64) float p[3][3][LR_LANES]; /* relative to the brick's centre */
    _Alignas(64) float edge[EDGES][3][LR_LANES];
} corners;

typedef struct vec {
    lanes x, y, z;
} vec;

LR_INLINE vec load3(const float (*from)[LR_LANES])
{
    return (vec){lanes_load(from[0]), lanes_load(from[1]), lanes_load(from[2])};
}

LR_INLINE lanes dot3(vec a, vec b)
{
    lanes xy = lanes_add(lanes_mul(a.x, b.x), lanes_mul(a.y, b.y));
    return lanes_add(xy, lanes_mul(a.z, b.z));
}

LR_INLINE vec cross3(vec a, vec b)
{
    return (vec){lanes_sub(lanes_mul(a.y, b.z), lanes_mul(a.z, b.y)),
                 lanes_sub(lanes_mul(a.z, b.x), lanes_mul(a.x, b.z)),
                 lanes_sub(lanes_mul(a.x, b.y), lanes_mul(a.y, b.x))};
}

LR_INLINE vec scale3(vec a, lanes s)
{
    return (vec){lanes_mul(a.x, s), lanes_mul(a.y, s), lanes_mul(a.z, s)};
}

LR_INLINE lanes minus_dot3(vec g, vec on)
{
    return lanes_sub(lanes_all(0.0f), dot3(g, on));
}

/* The form g.(x - on) of all triangles. */
LR_INLINE void store_first(batch *b, int form, vec g, vec on)
{
    lanes_store(b->first[0][form], g.x);
    lanes_store(b->first[1][form], g.y);
    lanes_store(b->first[2][form], g.z);
    lanes_store(b->first[3][form], minus_dot3(g, on));
}

LR_INLINE void store_place(batch *b, int edge, vec g, vec on)
{
    lanes_store(b->place[edge][0], g.x);
    lanes_store(b->place[edge][1], g.y);
    lanes_store(b->place[edge][2], g.z);
    lanes_store(b->place[edge][3], minus_dot3(g, on));
}

static void gather(const lr_topology *mesh, const double centre[3], const uint32_t *who, int n,
                   corners *at)
{
    for (int l = 0; l < n; l++) {
        double p[3][3];
        lr_triangle(mesh, who[l], p);
        for (int e = 0; e < 3; e++)
            for (int a = 0; a < 3; a++) {
                at->p[e][a][l] = (float)(p[e][a] - centre[a]);
                at->edge[e][a][l] = (float)(p[(e + 1) % 3][a] - p[e][a]);
            }
    }
}

LR_INLINE void set_boxes(const corners *at, batch *b)
{
    for (int a = 0; a < 3; a++) {
        lanes p = lanes_load(at->p[0][a]), q = lanes_load(at->p[1][a]);
        lanes r = lanes_load(at->p[2][a]), half = lanes_all(0.5f);
        lanes lo = lanes_min(lanes_min(p, q), r), hi = lanes_max(lanes_max(p, q), r);
        lanes_store(b->middle[a], lanes_mul(half, lanes_add(lo, hi)));
        lanes_store(b->half[a], lanes_mul(half, lanes_sub(hi, lo)));
    }
}

/* Set up all; returns the lanes of fat triangles, which alone are accurate. */
LR_INLINE uint32_t set_fat(const corners *at, batch *b)
{
    const lanes one = lanes_all(1.0f), zero = lanes_all(0.0f);
    lanes longest = zero, length[EDGES];
    for (int e = 0; e < EDGES; e++) {
        vec edge = load3(at->edge[e]);
        lanes square = dot3(edge, edge);
        longest = lanes_max(longest, square);
        length[e] = lanes_sqrt(square);
    }
    vec n = cross3(load3(at->edge[0]), load3(at->edge[1]));
    lanes area = lanes_sqrt(dot3(n, n));
    lane_mask fat = mask_and(lanes_less(lanes_mul(lanes_all(FAT), longest), area),
                             lanes_less(longest, lanes_all(SHORT * SHORT)));
    n = scale3(n, lanes_div(one, area));
    store_first(b, 0, n, load3(at->p[0]));
    for (int e = 0; e < EDGES; e++) {
        vec u = scale3(load3(at->edge[e]), lanes_div(one, length[e])), on = load3(at->p[e]);
        store_place(b, e, u, on);
        store_first(b, 1 + e, cross3(u, n), on);
        lanes_store(b->lo[e], zero);
        lanes_store(b->hi[e], length[e]);
    }
    set_boxes(at, b);
    return mask_bits(fat);
}

LR_INLINE void set_first(batch *b, int l, int form, const double g[3], double c)
{
    for (int a = 0; a < 3; a++)
        b->first[a][form][l] = (float)g[a];
    b->first[3][form][l] = (float)c;
}

/* One triangle in f64; moved to infinity if it has no area. */
static void set_thin(const lr_topology *mesh, const double centre[3], uint32_t t, int l, batch *b)
{
    lr_frame f;
    lr_triangle(mesh, t, f.p);
    for (int c = 0; c < 3; c++)
        lr_sub(f.p[c], centre, f.p[c]);
    if (!lr_frame_make(&f)) {
        b->middle[0][l] = INFINITY;
        return;
    }
    set_first(b, l, 0, f.n, -lr_dot(f.n, f.p[0]));
    for (int e = 0; e < EDGES; e++) {
        double place = -lr_dot(f.u[e], f.p[e]);
        double next = lr_clamp(place, 0.0, f.length[e]);
        set_first(b, l, 1 + e, f.m[e], -lr_dot(f.m[e], f.p[e]));
        for (int a = 0; a < 3; a++)
            b->place[e][a][l] = (float)f.u[e][a];
        b->place[e][3][l] = (float)(place - next);
        b->lo[e][l] = (float)-next;
        b->hi[e][l] = (float)(f.length[e] - next);
    }
}

/* Four values of sixteen triangles, triangle by triangle. */
LR_INLINE void transpose(const float in[4][LR_LANES], float out[LR_LANES][4])
{
    for (int l = 0; l < LR_LANES; l += 4) {
        __m128 row[4];
        for (int i = 0; i < 4; i++)
            row[i] = _mm_load_ps(&in[i][l]);
        _MM_TRANSPOSE4_PS(row[0], row[1], row[2], row[3]);
        for (int i = 0; i < 4; i++)
            _mm_store_ps(out[l + i], row[i]);
    }
}

/* Centres of the tiles relative to the brick's, and of lanes to their tile's. */
#define TWICE(...) __VA_ARGS__, __VA_ARGS__
#define FOUR(...)  TWICE(TWICE(__VA_ARGS__))
_Alignas(64) static const float TILE[3][LR_TILES] = {
    {FOUR(FOUR(-2)), FOUR(FOUR(2))},
    {TWICE(FOUR(-3, -1, 1, 3))},
    {TWICE(FOUR(-3), FOUR(-1), FOUR(1), FOUR(3))},
};
_Alignas(64) static const float LANE[3][LR_LANES] = {
    {FOUR(-1.5f, -0.5f, 0.5f, 1.5f)},
    {TWICE(FOUR(-0.5f), FOUR(0.5f))},
    {TWICE(FOUR(-0.5f)), TWICE(FOUR(0.5f))},
};
#undef TWICE
#undef FOUR

/* Halves of tiles are cubes of 2^3 samples; the centres of their layers on each axis. */
#define HALF_OF_TILE 0.5f
static const float LAYER[LR_LAYERS] = {-3, -1, 1, 3};

/* Squared gaps between all boxes and the layers, triangle by triangle. */
LR_INLINE void set_gaps(batch *b)
{
    _Alignas(64) float square[LR_LAYERS][LR_LANES];
    const lanes zero = lanes_all(0.0f), more = lanes_all(HALF_OF_TILE + SLACK);
    for (int a = 0; a < 3; a++) {
        const lanes middle = lanes_load(b->middle[a]);
        const lanes half = lanes_add(lanes_load(b->half[a]), more);
        for (int i = 0; i < LR_LAYERS; i++) {
            lanes apart = lanes_sub(lanes_all(LAYER[i]), middle);
            lanes gap = lanes_max(lanes_sub(lanes_abs(apart), half), zero);
            lanes_store(square[i], lanes_mul(gap, gap));
        }
        transpose((const float (*)[LR_LANES])square, b->gap[a]);
    }
}

/* Set up n triangles. */
LR_INLINE void set_up(const lr_topology *mesh, const double centre[3], const uint32_t *who, int n,
                      batch *b)
{
    corners at;
    gather(mesh, centre, who, n, &at);
    uint32_t fat = set_fat(&at, b);
    for (int l = 0; l < n; l++)
        if (!(fat >> l & 1))
            set_thin(mesh, centre, who[l], l, b);
    for (int a = 0; a < 4; a++)
        transpose((const float (*)[LR_LANES])b->first[a], b->of[a]);
    set_gaps(b);
}

static void begin(double band, lr_nearest *nearest)
{
    const float limit = (float)(band * band);
    for (int i = 0; i < LR_LAYERS; i++)
        for (int tile = 0; tile < LR_LANES; tile++)
            nearest->worst[i][tile] = limit;
    for (int tile = 0; tile < LR_TILES; tile++) {
        for (int lane = 0; lane < LR_LANES; lane++) {
            nearest->d2[tile][lane] = limit;
            nearest->height[tile][lane] = INFINITY;
            nearest->winner[tile][lane] = -1;
        }
    }
}

/* A step through n places that visits all of them, near n / golden ratio: triangles from all
 * parts of the list come early, so that the tiles' distances shrink early. */
static uint32_t golden_step(uint32_t n)
{
    uint32_t step = (uint32_t)(0.6180339887 * n);
    for (;; step++) {
        uint32_t a = n, b = step;
        while (b != 0) {
            uint32_t rest = a % b;
            a = b;
            b = rest;
        }
        if (a == 1)
            return step;
    }
}

/* A bit per tile of which a half has a largest distance that the box may be nearer than. */
LR_INLINE uint32_t near_box(const batch *b, int l, float worst[LR_LAYERS][LR_LANES])
{
    uint32_t bits = 0;
    const lanes yz = lanes_add(lanes_repeat(b->gap[1][l]), lanes_each(b->gap[2][l]));
    for (int i = 0; i < LR_LAYERS; i++) {
        lanes all = lanes_add(yz, lanes_all(b->gap[0][l][i]));
        bits |= mask_bits(lanes_less(all, lanes_load(worst[i]))) << (i / 2 * LR_LANES);
    }
    return bits;
}

/* Change of a form with gradient (x, y, z) over a tile. */
LR_INLINE lanes over_tile(float x, float y, float z)
{
    lanes sum = lanes_add(lanes_mul(lanes_all(x), lanes_load(LANE[0])),
                          lanes_mul(lanes_all(y), lanes_load(LANE[1])));
    return lanes_add(sum, lanes_mul(lanes_all(z), lanes_load(LANE[2])));
}

/* Squared distance in the plane from those lanes that lie beyond an edge. */
LR_INLINE lanes beyond_edges(const batch *b, int l, int tile, const lanes excess[EDGES])
{
    lanes nearest = lanes_all(INFINITY);
    const lanes zero = lanes_all(0.0f);
    for (int e = 0; e < EDGES; e++) {
        float gx = b->place[e][0][l], gy = b->place[e][1][l], gz = b->place[e][2][l];
        float centre = gx * TILE[0][tile] + gy * TILE[1][tile] + gz * TILE[2][tile];
        lanes place = lanes_add(over_tile(gx, gy, gz), lanes_all(b->place[e][3][l] + centre));
        lanes below = lanes_min(lanes_sub(place, lanes_all(b->lo[e][l])), zero);
        lanes above = lanes_max(lanes_sub(place, lanes_all(b->hi[e][l])), zero);
        lanes outside = lanes_add(below, above);
        lanes square = lanes_add(lanes_mul(excess[e], excess[e]), lanes_mul(outside, outside));
        nearest = lanes_min(square, nearest);
    }
    return nearest;
}

/* Triangles of a batch against tiles. */
enum { AT_ONCE = 4, MOST_TRIALS = LR_LANES * LR_TILES + AT_ONCE };
typedef struct trials {
    _Alignas(64) float difference[LR_LANES][FIRST][LR_LANES]; /* of the first forms over a tile */
    _Alignas(16) float centre[MOST_TRIALS][FIRST];            /* their values at its centre */
    uint16_t what[MOST_TRIALS];                               /* triangle * LR_TILES + tile */
    int n;
} trials;

/* List the tiles whose boxes are near enough. AT_ONCE are written and then counted, to avoid
 * branches. */
LR_INLINE void list_trials(const batch *b, int n, lr_nearest *nearest, trials *t)
{
    t->n = 0;
    for (int l = 0; l < n; l++) {
        uint32_t left = near_box(b, l, nearest->worst);
        for (int i = 0; i < FIRST; i++)
            lanes_store(t->difference[l][i],
                        over_tile(b->of[0][l][i], b->of[1][l][i], b->of[2][l][i]));
        while (left != 0) {
            int count = __builtin_popcount(left);
            for (int i = 0; i < AT_ONCE; i++) {
                int tile = __builtin_ctz(left | 1u << (LR_TILES - 1));
                t->what[t->n + i] = (uint16_t)(l * LR_TILES + tile);
                left &= left - 1;
            }
            t->n += count < AT_ONCE ? count : AT_ONCE;
        }
    }
}

/* Values of height and excesses at the centre of a tile. */
LR_INLINE void at_centre(const batch *b, int l, int tile, float value[FIRST])
{
    __m128 x = _mm_mul_ps(_mm_load_ps(b->of[0][l]), _mm_set1_ps(TILE[0][tile]));
    __m128 y = _mm_mul_ps(_mm_load_ps(b->of[1][l]), _mm_set1_ps(TILE[1][tile]));
    __m128 z = _mm_mul_ps(_mm_load_ps(b->of[2][l]), _mm_set1_ps(TILE[2][tile]));
    __m128 sum = _mm_add_ps(_mm_add_ps(x, y), z);
    _mm_store_ps(value, _mm_add_ps(sum, _mm_load_ps(b->of[3][l])));
}

/* The first forms of the samples of a tile. */
typedef struct forms {
    lanes height2, height, excess[EDGES], most;
} forms;

LR_INLINE forms forms_of(const trials *t, int l, const float centre[FIRST])
{
    forms f;
    f.height = lanes_add(lanes_load(t->difference[l][0]), lanes_all(centre[0]));
    f.height2 = lanes_mul(f.height, f.height);
    for (int e = 0; e < EDGES; e++)
        f.excess[e] = lanes_add(lanes_load(t->difference[l][1 + e]), lanes_all(centre[1 + e]));
    f.most = lanes_max(lanes_max(f.excess[0], f.excess[1]), f.excess[2]);
    return f;
}

/* Keep the trials in which the bound is below the distance of some sample. */
LR_INLINE void sift_trials(const batch *b, const lr_nearest *nearest, trials *t)
{
    int kept = 0;
    for (int i = 0; i < t->n; i++) {
        const uint16_t what = t->what[i];
        const int l = what / LR_TILES, tile = what % LR_TILES;
        at_centre(b, l, tile, t->centre[kept]);
        const forms f = forms_of(t, l, t->centre[kept]);
        lanes out = lanes_max(f.most, lanes_all(0.0f));
        lanes least = lanes_add(f.height2, lanes_mul(out, out));
        t->what[kept] = what;
        kept += mask_bits(lanes_less(least, lanes_load(nearest->d2[tile]))) != 0;
    }
    t->n = kept;
}

/* Store the samples to which the triangle is nearest so far. */
LR_INLINE void win(lr_nearest *nearest, int tile, lane_mask wins, lanes square, lanes height,
                   lanes d2, int32_t who)
{
    float number;
    memcpy(&number, &who, sizeof number);
    lanes winner = lanes_load(nearest->winner[tile]);
    d2 = lanes_pick(wins, square, d2);
    lanes_store(nearest->d2[tile], d2);
    lanes_store(nearest->winner[tile], lanes_pick(wins, lanes_all(number), winner));
    height = lanes_pick(wins, height, lanes_load(nearest->height[tile]));
    lanes_store(nearest->height[tile], height);
    float *worst = &nearest->worst[tile / LR_LANES * 2][tile % LR_LANES];
    lanes_halves(d2, worst, worst + LR_LANES);
}

/* Test the triangles at these places of the list. */
LR_INLINE void compete(const batch *b, const trials *t, const int32_t *place, lr_nearest *nearest)
{
    const lanes zero = lanes_all(0.0f);
    for (int i = 0; i < t->n; i++) {
        const int l = t->what[i] / LR_TILES, tile = t->what[i] % LR_TILES;
        const forms f = forms_of(t, l, t->centre[i]);
        const lanes d2 = lanes_load(nearest->d2[tile]);
        const lane_mask beyond = lanes_less(zero, f.most);
        const lanes edge = beyond_edges(b, l, tile, f.excess);
        const lanes square = lanes_add(f.height2, lanes_pick(beyond, edge, zero));
        const lane_mask wins = lanes_less(square, d2);
        if (mask_bits(wins) == 0)
            continue;
        const lanes height = lanes_pick(beyond, lanes_all(INFINITY), f.height);
        win(nearest, tile, wins, square, height, d2, place[l]);
    }
}

/* The next sixteen of a list, by steps: places in it, and triangles, which are fetched. */
typedef struct turn {
    int32_t place[LR_LANES];
    uint32_t who[LR_LANES];
    int n;
} turn;

LR_INLINE void take_turn(const lr_topology *mesh, const uint32_t *list, uint32_t n, uint32_t left,
                         uint32_t step, uint32_t *next, turn *t)
{
    t->n = left < LR_LANES ? (int)left : LR_LANES;
    for (int l = 0; l < t->n; l++) {
        t->place[l] = (int32_t)*next;
        t->who[l] = list[*next];
        __builtin_prefetch(mesh->source.triangles + 3 * (size_t)t->who[l]);
        *next = *next >= n - step ? *next - (n - step) : *next + step;
    }
}

bool LR_SEARCH(const lr_topology *mesh, const double centre[3], const uint32_t *list, uint32_t n,
               double band, const lr_watch *watch, lr_nearest *nearest)
{
    batch b;
    trials t;
    turn now, then;
    uint32_t step = golden_step(n), next = 0;
    begin(band, nearest);
    take_turn(mesh, list, n, n, step, &next, &then);
    for (uint32_t done = 0; done < n; done += LR_LANES) {
        if (done / LR_LANES % POLL == POLL - 1 && lr_stopped(watch))
            return false;
        now = then;
        if (n - done > LR_LANES)
            take_turn(mesh, list, n, n - done - LR_LANES, step, &next, &then);
        set_up(mesh, centre, now.who, now.n, &b);
        list_trials(&b, now.n, nearest, &t);
        sift_trials(&b, nearest, &t);
        compete(&b, &t, now.place, nearest);
    }
    return true;
}
