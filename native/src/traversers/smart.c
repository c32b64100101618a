/* An octree of occupied nodes only, walked by horizontal and vertical decisions.
 *
 * A horizontal decision goes from sibling to sibling: through the face of the child's
 * cube that the ray meets first. A vertical one descends: into the child on whose
 * side of each middle plane the ray is at its present t. Where a step would leave the
 * parent, the walk climbs. A node is the mask of its occupied children and the number
 * of the first of them, breadth first; those of the lowest level, 2^3 cells, are the
 * mask alone: 1 byte there and 5 above.
 *
 * Source: Spackman and Willis 1991, as told in Sramek 1994, section 3.2.1; the two
 * vectors are reconstructed. Departures: 1. their components are recomputed from
 * integer planes, so that t has the same bits as elsewhere; 2. the first descent
 * follows the start's cell, which may be given; 3. planes that coincide with the
 * present t count as crossed.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/traverser.h"

enum { BRICK_LEVEL = LR_SIDE_BITS, MAX_LEVELS = 24 };

_Static_assert(BRICK_LEVEL == 3 && LR_WORDS == 8, "a brick's words are its eight children");

/* Nodes of level m cover 2^m cells a side; levels are 1..top. */
typedef struct octree {
    int top;
    uint8_t *mask[MAX_LEVELS];
    uint32_t *first[MAX_LEVELS]; /* from level 2 on: the first child, a node of the level below */
} octree;

typedef struct place {
    int level;                 /* of the parent of the child that the cursor is in */
    uint32_t node[MAX_LEVELS]; /* the path down to it */
    int32_t corner[3];         /* the child's lowest cell */
} place;

/* A brick with surface and its place along the Morton curve, which is the order
 * of its level in a breadth-first list. */
typedef struct brick {
    uint64_t code;
    uint32_t entry;
} brick;

void lr_smart_free(void *data)
{
    octree *t = data;
    if (t == NULL)
        return;
    for (int level = 0; level < MAX_LEVELS; level++) {
        free(t->mask[level]);
        free(t->first[level]);
    }
    free(t);
}

static uint64_t morton(const int32_t c[3])
{
    uint64_t code = 0;
    for (int bit = 0; bit < 21; bit++)
        for (int a = 0; a < 3; a++)
            code |= (uint64_t)(c[a] >> bit & 1) << (3 * bit + a);
    return code;
}

/* Sort by code, a digit at a time from the lowest on, up to what the tree's top level
 * leaves; scratch has room for n too. False where stopped. */
static bool sort_bricks(brick **list, brick **scratch, size_t n, int code_bits,
                        const lr_watch *watch)
{
    enum { DIGIT_BITS = 11, N_DIGITS = 1 << DIGIT_BITS };
    for (int shift = 0; shift < code_bits; shift += DIGIT_BITS) {
        size_t place[N_DIGITS] = {0}, sum = 0;
        for (size_t i = 0; i < n; i++)
            place[(*list)[i].code >> shift & (N_DIGITS - 1)]++;
        for (int digit = 0; digit < N_DIGITS; digit++) {
            const size_t count = place[digit];
            place[digit] = sum;
            sum += count;
        }
        for (size_t i = 0; i < n; i++) {
            if (lr_stopped_now_and_then(watch, i))
                return false;
            (*scratch)[place[(*list)[i].code >> shift & (N_DIGITS - 1)]++] = (*list)[i];
        }
        brick *swap = *list;
        *list = *scratch;
        *scratch = swap;
    }
    return true;
}

/* The bricks with surface, unsorted; false where stopped. */
static bool gather_bricks(const lr_volume *v, brick *next, const lr_watch *watch)
{
    int32_t b[3] = {-1, 0, 0};
    while (lr_next_surface_brick(v, watch, b))
        *next++ = (brick){morton(b), lr_entry_at(v, lr_table_at(v, b[0], b[1], b[2]))};
    return !lr_stopped(watch);
}

static lr_status list_bricks(const lr_volume *v, int code_bits, brick **list, size_t *n,
                             const lr_watch *watch, lr_error *error)
{
    *n = 0;
    for (size_t at = 0; at < lr_table_count(v); at++) {
        *n += lr_entry_words(lr_entry_at(v, at)) != 0;
        if (lr_stopped_now_and_then(watch, at))
            return lr_fail_stopped(error);
    }
    *list = malloc((*n + 1) * sizeof **list);
    brick *scratch = malloc((*n + 1) * sizeof *scratch);
    lr_status status = LR_OK;
    if (*list == NULL || scratch == NULL)
        status = lr_fail_memory(error, 2 * *n * sizeof **list, "a list of bricks");
    else if (!gather_bricks(v, *list, watch) || !sort_bricks(list, &scratch, *n, code_bits, watch))
        status = lr_fail_stopped(error);
    free(scratch);
    return status;
}

static lr_status add_level(octree *t, int level, size_t n, uint64_t *nbytes, lr_error *error)
{
    const size_t each = level > 1 ? sizeof(uint8_t) + sizeof(uint32_t) : sizeof(uint8_t);
    t->mask[level] = calloc(n + 1, sizeof(uint8_t));
    t->first[level] = level > 1 ? malloc((n + 1) * sizeof(uint32_t)) : NULL;
    if (t->mask[level] == NULL || (level > 1 && t->first[level] == NULL))
        return lr_fail_memory(error, n * each, "a level of the octree");
    *nbytes += n * each;
    return LR_OK;
}

/* Levels 1 to 3, from the store's own masks. */
static lr_status add_bricks(octree *t, const lr_volume *v, const brick *list, size_t n,
                            uint64_t *nbytes, const lr_watch *watch, lr_error *error)
{
    size_t n_words = 0, n_low = 0, word_at = 0, low_at = 0;
    uint8_t masks[8];
    for (size_t i = 0; i < n; i++) {
        if (lr_stopped_now_and_then(watch, i))
            return lr_fail_stopped(error);
        const uint64_t *words = lr_entry_mask(v, list[i].entry);
        for (int s = 0; s < LR_WORDS; s++) {
            n_words += words[s] != 0;
            n_low += (size_t)__builtin_popcount(lr_cubes_of_word(words[s], masks));
        }
    }
    lr_status status = add_level(t, 1, n_low, nbytes, error);
    if (status == LR_OK)
        status = add_level(t, 2, n_words, nbytes, error);
    if (status == LR_OK)
        status = add_level(t, BRICK_LEVEL, n, nbytes, error);
    for (size_t i = 0; status == LR_OK && i < n; i++) {
        if (lr_stopped_now_and_then(watch, i))
            status = lr_fail_stopped(error);
        const uint64_t *words = lr_entry_mask(v, list[i].entry);
        t->mask[BRICK_LEVEL][i] = lr_entry_words(list[i].entry);
        t->first[BRICK_LEVEL][i] = (uint32_t)word_at;
        for (int s = 0; s < LR_WORDS; s++) {
            const uint8_t any = lr_cubes_of_word(words[s], masks);
            if (any == 0)
                continue;
            t->mask[2][word_at] = any;
            t->first[2][word_at++] = (uint32_t)low_at;
            for (int k = 0; k < 8; k++)
                if (masks[k] != 0)
                    t->mask[1][low_at++] = masks[k];
        }
    }
    return status;
}

/* A level above: one node for every run of children with the same code but for
 * its last three bits. list becomes that of the new level. */
static lr_status add_parents(octree *t, int level, brick *list, size_t *n, uint64_t *nbytes,
                             const lr_watch *watch, lr_error *error)
{
    lr_status status = add_level(t, level, *n, nbytes, error); /* from above, then cut */
    if (status != LR_OK)
        return status;
    size_t made = 0;
    for (size_t i = 0; i < *n; i++) {
        const uint64_t code = list[i].code;
        if (lr_stopped_now_and_then(watch, i))
            return lr_fail_stopped(error);
        if (i == 0 || code >> 3 != list[made - 1].code) {
            list[made].code = code >> 3;
            t->first[level][made++] = (uint32_t)i;
        }
        t->mask[level][made - 1] |= (uint8_t)(1 << (code & 7));
    }
    *nbytes -= (*n - made) * (sizeof(uint8_t) + sizeof(uint32_t));
    void *masks = realloc(t->mask[level], made + 1);
    t->mask[level] = masks != NULL ? masks : t->mask[level];
    void *firsts = realloc(t->first[level], (made + 1) * sizeof(uint32_t));
    t->first[level] = firsts != NULL ? firsts : t->first[level];
    *n = made;
    return LR_OK;
}

lr_status lr_smart_build(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                         void **data, uint64_t *nbytes, lr_error *error)
{
    (void)choices;
    brick *list = NULL;
    size_t n = 0;
    octree *t = calloc(1, sizeof *t);
    if (t == NULL)
        return lr_fail_memory(error, sizeof *t, "an octree");
    *nbytes = sizeof *t;
    const int32_t *size = v->table_size;
    const int32_t largest = lr_max_i(size[0], lr_max_i(size[1], size[2]));
    int top = BRICK_LEVEL;
    while (1 << (top - BRICK_LEVEL) < largest)
        top++;
    lr_status status = list_bricks(v, 3 * (top - BRICK_LEVEL), &list, &n, watch, error);
    if (status == LR_OK)
        status = add_bricks(t, v, list, n, nbytes, watch, error);
    for (t->top = BRICK_LEVEL; status == LR_OK && t->top < top;)
        status = add_parents(t, ++t->top, list, &n, nbytes, watch, error);
    free(list);
    if (status != LR_OK) {
        lr_smart_free(t);
        return status;
    }
    *data = t;
    return LR_OK;
}

/* Which child of its parent the cube at corner is, one bit per axis. */
LR_INLINE int child_of(const int32_t corner[3], int level)
{
    const int bit = level - 1;
    return (corner[0] >> bit & 1) | (corner[1] >> bit & 1) << 1 | (corner[2] >> bit & 1) << 2;
}

/* Stand in the child that holds the first cell, below the root. */
LR_INLINE void begin_walk(const octree *t, const int32_t c[3], place *at)
{
    at->level = t->top;
    at->node[t->top] = 0;
    for (int a = 0; a < 3; a++)
        at->corner[a] = c[a] >> (t->top - 1) << (t->top - 1);
}

LR_INLINE bool occupied(const octree *t, const place *at)
{
    return t->mask[at->level][at->node[at->level]] >> child_of(at->corner, at->level) & 1;
}

/* Make the occupied child that the cursor is in the parent. Which of its children the
 * ray is in: by the start's cell, or by the middle planes that lie behind. */
LR_INLINE void descend(const octree *t, const lr_ray *r, lr_lattice lattice, const lr_cursor *u,
                       bool started, place *at)
{
    const int level = at->level;
    const uint32_t node = at->node[level], child = (uint32_t)child_of(at->corner, level);
    const uint32_t before = t->mask[level][node] & ((1u << child) - 1);
    at->node[level - 1] = t->first[level][node] + (uint32_t)__builtin_popcount(before);
    at->level = level - 1;
    const int32_t half = 1 << (level - 2);
    for (int a = 0; a < 3; a++) {
        const int32_t middle = at->corner[a] + half;
        bool upper = u->c[a] >= middle;
        if (started && r->s[a] != 0)
            upper = (lr_plane_t(r, lattice, a, middle) <= u->t) == (r->s[a] > 0);
        at->corner[a] += upper ? half : 0;
    }
}

/* Leave the child by the face that the ray reaches first, climbing where that is
 * its parent's too; false: the ray has ended. */
LR_INLINE bool advance(const octree *t, const lr_ray *r, lr_lattice lattice, lr_cursor *u,
                       place *at, lr_tally *tally)
{
    const int32_t size = 1 << (at->level - 1);
    int32_t hi[3];
    int axis;
    for (int a = 0; a < 3; a++)
        hi[a] = at->corner[a] + size - 1;
    const double out = lr_exit_t(r, lattice, at->corner, hi, &axis);
    u->t = out > u->t ? out : u->t;
    u->axis = axis;
    if (!(out <= r->t_max) || r->s[axis] == 0) /* as in lr_cross */
        return false;
    const int32_t from = at->corner[axis], to = from + r->s[axis] * size;
    at->corner[axis] = to;
    while ((from ^ to) >> at->level != 0) { /* in another parent */
        if (at->level == t->top)
            return false;
        at->level++;
        lr_count_node(tally);
    }
    for (int a = 0; a < 3; a++) /* the child of that parent */
        at->corner[a] = at->corner[a] >> (at->level - 1) << (at->level - 1);
    return true;
}

LR_INLINE bool walk(const void *data, const lr_volume *v, const lr_ray *r, lr_lattice lattice,
                    lr_cursor *u, place *at, bool first, lr_tally *tally)
{
    (void)v;
    const octree *t = data;
    bool started = !first;
    if (!first && !advance(t, r, lattice, u, at, tally))
        return false;
    lr_count_cell(tally);
    for (;;) {
        if (!occupied(t, at)) {
            lr_count_jump(tally, at->level > 1);
            if (!advance(t, r, lattice, u, at, tally))
                return false;
            lr_count_cell(tally);
            started = true;
        } else if (at->level > 1) {
            descend(t, r, lattice, u, started, at);
            lr_count_node(tally);
        } else {
            memcpy(u->c, at->corner, sizeof u->c);
            return true;
        }
    }
}

#define LR_NAME                                             smart
#define LR_STATE                                            place
#define LR_START(data, volume, ray, lattice, cursor, state) begin_walk(data, (cursor)->c, state)
#define LR_WALK                                             walk
#include "trace/walk_template.h"
