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
 * The includer defines LR_VECTORS and LR_SEARCH, the function's name.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/vectors.h"

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

typedef float four __attribute__((vector_size(16)));

LR_INLINE four load4(const float *from)
{
    four x;
    memcpy(&x, from, sizeof x);
    return x;
}

typedef struct vec {
    lr_floats x, y, z;
} vec;

LR_INLINE vec load3(const float (*from)[LR_LANES])
{
    return (vec){lr_load_floats(from[0]), lr_load_floats(from[1]), lr_load_floats(from[2])};
}

LR_INLINE lr_floats dot3(vec a, vec b)
{
    lr_floats xy = a.x * b.x + a.y * b.y;
    return xy + a.z * b.z;
}

LR_INLINE vec cross3(vec a, vec b)
{
    return (vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

LR_INLINE vec scale3(vec a, lr_floats s)
{
    return (vec){a.x * s, a.y * s, a.z * s};
}

LR_INLINE lr_floats minus_dot3(vec g, vec on)
{
    return 0.0f - dot3(g, on);
}

/* The form g.(x - on) of all triangles. */
LR_INLINE void store_first(batch *b, int form, vec g, vec on)
{
    lr_store_floats(b->first[0][form], g.x);
    lr_store_floats(b->first[1][form], g.y);
    lr_store_floats(b->first[2][form], g.z);
    lr_store_floats(b->first[3][form], minus_dot3(g, on));
}

LR_INLINE void store_place(batch *b, int edge, vec g, vec on)
{
    lr_store_floats(b->place[edge][0], g.x);
    lr_store_floats(b->place[edge][1], g.y);
    lr_store_floats(b->place[edge][2], g.z);
    lr_store_floats(b->place[edge][3], minus_dot3(g, on));
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
        lr_floats p = lr_load_floats(at->p[0][a]), q = lr_load_floats(at->p[1][a]);
        lr_floats r = lr_load_floats(at->p[2][a]), half = lr_all_floats(0.5f);
        lr_floats lo = lr_least(lr_least(p, q), r), hi = lr_greatest(lr_greatest(p, q), r);
        lr_store_floats(b->middle[a], half * (lo + hi));
        lr_store_floats(b->half[a], half * (hi - lo));
    }
}

/* Set up all; returns the lanes of fat triangles, which alone are accurate. */
LR_INLINE uint32_t set_fat(const corners *at, batch *b)
{
    const lr_floats one = lr_all_floats(1.0f), zero = lr_all_floats(0.0f);
    lr_floats longest = zero, length[EDGES];
    for (int e = 0; e < EDGES; e++) {
        vec edge = load3(at->edge[e]);
        lr_floats square = dot3(edge, edge);
        longest = lr_greatest(longest, square);
        length[e] = lr_root_floats(square);
    }
    vec n = cross3(load3(at->edge[0]), load3(at->edge[1]));
    lr_floats area = lr_root_floats(dot3(n, n));
    lr_ints fat = (FAT * longest < area) & (longest < (SHORT * SHORT));
    n = scale3(n, one / area);
    store_first(b, 0, n, load3(at->p[0]));
    for (int e = 0; e < EDGES; e++) {
        vec u = scale3(load3(at->edge[e]), one / length[e]), on = load3(at->p[e]);
        store_place(b, e, u, on);
        store_first(b, 1 + e, cross3(u, n), on);
        lr_store_floats(b->lo[e], zero);
        lr_store_floats(b->hi[e], length[e]);
    }
    set_boxes(at, b);
    return lr_bits_of(fat);
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
        four row[4];
        for (int i = 0; i < 4; i++)
            row[i] = load4(&in[i][l]);
        const four low[2] = {__builtin_shufflevector(row[0], row[1], 0, 4, 1, 5),
                             __builtin_shufflevector(row[2], row[3], 0, 4, 1, 5)};
        const four high[2] = {__builtin_shufflevector(row[0], row[1], 2, 6, 3, 7),
                              __builtin_shufflevector(row[2], row[3], 2, 6, 3, 7)};
        row[0] = __builtin_shufflevector(low[0], low[1], 0, 1, 4, 5);
        row[1] = __builtin_shufflevector(low[0], low[1], 2, 3, 6, 7);
        row[2] = __builtin_shufflevector(high[0], high[1], 0, 1, 4, 5);
        row[3] = __builtin_shufflevector(high[0], high[1], 2, 3, 6, 7);
        memcpy(out[l], row, sizeof row);
    }
}

/* Four numbers, four times; each of four numbers four times. */
LR_INLINE lr_floats repeat(const float numbers[4])
{
    const four x = load4(numbers);
    return __builtin_shufflevector(x, x, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3);
}

LR_INLINE lr_floats each(const float numbers[4])
{
    const four x = load4(numbers);
    return __builtin_shufflevector(x, x, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
}

/* The largest of lanes 0, 1, 4, 5, 8 ... and of the others. */
LR_INLINE void halves(lr_floats x, float *low, float *high)
{
    x = lr_greatest(
        x, __builtin_shufflevector(x, x, 8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7));
    x = lr_greatest(x,
                    __builtin_shufflevector(x, x, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3));
    *low = x[0] > x[1] ? x[0] : x[1];
    *high = x[2] > x[3] ? x[2] : x[3];
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
    const lr_floats zero = lr_all_floats(0.0f), more = lr_all_floats(HALF_OF_TILE + SLACK);
    for (int a = 0; a < 3; a++) {
        const lr_floats middle = lr_load_floats(b->middle[a]);
        const lr_floats half = lr_load_floats(b->half[a]) + more;
        for (int i = 0; i < LR_LAYERS; i++) {
            lr_floats apart = LAYER[i] - middle;
            lr_floats gap = lr_greatest(lr_absolute(apart) - half, zero);
            lr_store_floats(square[i], gap * gap);
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
    const lr_floats yz = repeat(b->gap[1][l]) + each(b->gap[2][l]);
    for (int i = 0; i < LR_LAYERS; i++) {
        lr_floats all = yz + b->gap[0][l][i];
        bits |= lr_bits_of(all < lr_load_floats(worst[i])) << (i / 2 * LR_LANES);
    }
    return bits;
}

/* Change of a form with gradient (x, y, z) over a tile. */
LR_INLINE lr_floats over_tile(float x, float y, float z)
{
    lr_floats sum = x * lr_load_floats(LANE[0]) + y * lr_load_floats(LANE[1]);
    return sum + z * lr_load_floats(LANE[2]);
}

/* Squared distance in the plane from those lanes that lie beyond an edge. */
LR_INLINE lr_floats beyond_edges(const batch *b, int l, int tile, const lr_floats excess[EDGES])
{
    lr_floats nearest = lr_all_floats(INFINITY);
    const lr_floats zero = lr_all_floats(0.0f);
    for (int e = 0; e < EDGES; e++) {
        float gx = b->place[e][0][l], gy = b->place[e][1][l], gz = b->place[e][2][l];
        float centre = gx * TILE[0][tile] + gy * TILE[1][tile] + gz * TILE[2][tile];
        lr_floats place = over_tile(gx, gy, gz) + (b->place[e][3][l] + centre);
        lr_floats below = lr_least(place - b->lo[e][l], zero);
        lr_floats above = lr_greatest(place - b->hi[e][l], zero);
        lr_floats outside = below + above;
        lr_floats square = excess[e] * excess[e] + outside * outside;
        nearest = lr_least(square, nearest);
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
            lr_store_floats(t->difference[l][i],
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
    const four x = load4(b->of[0][l]) * TILE[0][tile], y = load4(b->of[1][l]) * TILE[1][tile];
    const four sum = x + y + load4(b->of[2][l]) * TILE[2][tile] + load4(b->of[3][l]);
    memcpy(value, &sum, sizeof sum);
}

/* The first forms of the samples of a tile. */
typedef struct forms {
    lr_floats height2, height, excess[EDGES], most;
} forms;

LR_INLINE forms forms_of(const trials *t, int l, const float centre[FIRST])
{
    forms f;
    f.height = lr_load_floats(t->difference[l][0]) + centre[0];
    f.height2 = f.height * f.height;
    for (int e = 0; e < EDGES; e++)
        f.excess[e] = lr_load_floats(t->difference[l][1 + e]) + (centre[1 + e]);
    f.most = lr_greatest(lr_greatest(f.excess[0], f.excess[1]), f.excess[2]);
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
        lr_floats out = lr_greatest(f.most, lr_all_floats(0.0f));
        lr_floats least = f.height2 + out * out;
        t->what[kept] = what;
        kept += lr_bits_of(least < lr_load_floats(nearest->d2[tile])) != 0;
    }
    t->n = kept;
}

/* Store the samples to which the triangle is nearest so far. */
LR_INLINE void win(lr_nearest *nearest, int tile, lr_ints wins, lr_floats square, lr_floats height,
                   lr_floats d2, int32_t who)
{
    int32_t *winner = nearest->winner[tile];
    d2 = lr_pick(wins, square, d2);
    lr_store_floats(nearest->d2[tile], d2);
    lr_store_ints(winner, lr_pick_ints(wins, lr_all_ints(who), lr_load_ints(winner)));
    height = lr_pick(wins, height, lr_load_floats(nearest->height[tile]));
    lr_store_floats(nearest->height[tile], height);
    float *worst = &nearest->worst[tile / LR_LANES * 2][tile % LR_LANES];
    halves(d2, worst, worst + LR_LANES);
}

/* Test the triangles at these places of the list. */
LR_INLINE void compete(const batch *b, const trials *t, const int32_t *place, lr_nearest *nearest)
{
    const lr_floats zero = lr_all_floats(0.0f);
    for (int i = 0; i < t->n; i++) {
        const int l = t->what[i] / LR_TILES, tile = t->what[i] % LR_TILES;
        const forms f = forms_of(t, l, t->centre[i]);
        const lr_floats d2 = lr_load_floats(nearest->d2[tile]);
        const lr_ints beyond = zero < f.most;
        const lr_floats edge = beyond_edges(b, l, tile, f.excess);
        const lr_floats square = f.height2 + lr_pick(beyond, edge, zero);
        const lr_ints wins = square < d2;
        if (lr_bits_of(wins) == 0)
            continue;
        const lr_floats height = lr_pick(beyond, lr_all_floats(INFINITY), f.height);
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
