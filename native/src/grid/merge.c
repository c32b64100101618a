/* One volume of several solids, on one lattice and with ids.
 *
 * Every part has made up its mind about its own surface: the surface cells of the
 * whole are those of the parts, wherever another one covers them. A sample keeps the
 * two parts of largest occupancy, the lower object first where they are equal.
 *
 * Source: Sramek 1994 (objects of a scene in one volume); the second sample is what
 * keeps two solids that touch from losing the samples of their contact to each other.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/affine.h"
#include "base/error.h"
#include "grid/attributes/triangle_attributes.h"
#include "grid/objects.h"

/* How far two lattices may be apart, in voxels, and still count as one. */
#define ASIDE 1e-4

typedef struct part {
    const lr_volume *v;
    int32_t shift[3];    /* its storage coordinates are those of the whole less this */
    uint16_t id;         /* of its samples far from the surface, which have none of their own */
    uint8_t *own;        /* [65536]: is the id one of the part's? */
    uint32_t first_face; /* its face f is first_face + f of the whole */
} part;

typedef struct merger {
    part *parts;
    uint32_t n;
    lr_volume *whole;
    uint32_t *start; /* [n_table + 1]: where a brick's list of parts starts */
    uint32_t *list;
    uint32_t capacity; /* blocks of second samples there is room for */
} merger;

/* A brick on its way. */
typedef struct brick {
    double value[2][LR_CELLS];
    uint16_t id[2][LR_CELLS];
    int32_t from[2][LR_CELLS]; /* part; -1: none */
    lr_mask cells;
    bool at_surface; /* a surface cell has a corner here */
    lr_mask lost;    /* as cells: samples that a third part had */
    uint32_t nearest_triangle[LR_CELLS];
} brick;

/* ---- the parts --------------------------------------------------------- */

static lr_status check_part(const lr_volume *v, const lr_volume *first, uint32_t i, lr_error *error)
{
    if (!v->finished || v->desc.kind != LR_KIND_SOLID || v->ids == NULL ||
        v->triangle_cells != NULL || v->objects != NULL || v->planes[0] != NULL ||
        !lr_holds_occupancies(v))
        return lr_fail(error, LR_E_ARGUMENT,
                       "part %u must be a finished solid with ids, without triangle cells, not "
                       "rectilinear, no isosurface and not merged before",
                       i);
    if (v->desc.sample_type != first->desc.sample_type || v->threshold != first->threshold)
        return lr_fail(error, LR_E_ARGUMENT,
                       "part %u differs from the first one in sample type or threshold", i);
    for (int a = 0; a < 12; a++)
        if (a % 4 != 3 && v->desc.object_from_index[a] != first->desc.object_from_index[a])
            return lr_fail(error, LR_E_ARGUMENT, "part %u has other voxels than the first one", i);
    return LR_OK;
}

/* Where the part's lattice starts on that of the first part. */
static lr_status offset_of(const lr_volume *v, const lr_volume *first, uint32_t i,
                           int32_t offset[3], lr_error *error)
{
    double origin[3], at[3];
    for (int a = 0; a < 3; a++)
        origin[a] = v->desc.object_from_index[4 * a + 3];
    lr_map_point(first->storage_from_object, origin, at);
    for (int a = 0; a < 3; a++) {
        const double n = at[a] - LR_PAD;
        if (!(fabs(n - round(n)) <= ASIDE && fabs(n) < 1 << 20))
            return lr_fail(error, LR_E_ARGUMENT,
                           "part %u lies off the lattice of the first one, by %g voxels along %c",
                           i, n - round(n), "xyz"[a]);
        offset[a] = (int32_t)lrint(n);
    }
    return LR_OK;
}

static lr_status take_ids(part *p, uint32_t i, lr_objects *objects, uint8_t *taken, lr_error *error)
{
    const lr_volume *v = p->v;
    bool any = false;
    p->own = calloc(65536, 1);
    if (p->own == NULL)
        return lr_fail_memory(error, 65536, "the ids of a volume");
    for (size_t at = (size_t)LR_FIRST_STORED * LR_CELLS; at < (size_t)v->n_bricks * LR_CELLS;
         at++) {
        /* samples far from the surface have the id 0, whoever owns it */
        const double value = lr_load(v, at);
        if (value > 0.0 && (value < v->one || v->ids[at] != 0))
            p->own[v->ids[at]] = 1;
    }
    for (uint32_t id = 65536; id-- > 0;) {
        if (!p->own[id])
            continue;
        if (taken[id])
            return lr_fail(error, LR_E_ARGUMENT, "id %u is in two parts, %u and %u", id,
                           objects->object_of[id], i);
        taken[id] = 1;
        objects->object_of[id] = (uint16_t)i;
        objects->id_of[i] = p->id = (uint16_t)id;
        any = true;
    }
    return any ? LR_OK : lr_fail(error, LR_E_ARGUMENT, "part %u holds nothing", i);
}

/* Is anything of the part in the brick of the whole at that place? */
static bool reaches(const part *p, const int32_t b[3])
{
    int32_t lo[3], hi[3];
    for (int a = 0; a < 3; a++) {
        const int32_t first = LR_SIDE * b[a] - p->shift[a], last = first + LR_SIDE - 1;
        lo[a] = lr_brick_of(lr_max_i(first - 1, 0));
        hi[a] = lr_min_i(lr_brick_of(last), p->v->table_size[a] - 1);
    }
    for (int32_t z = lo[2]; z <= hi[2]; z++)
        for (int32_t y = lo[1]; y <= hi[1]; y++)
            for (int32_t x = lo[0]; x <= hi[0]; x++)
                if (p->v->table[lr_table_at(p->v, x, y, z)] != 0)
                    return true;
    return false;
}

/* Run through the bricks that a part reaches: count them, or list the part there. */
static void list_part(merger *m, uint32_t i, bool count)
{
    const part *p = &m->parts[i];
    const int32_t *size = m->whole->table_size;
    int32_t lo[3], hi[3];
    for (int a = 0; a < 3; a++) {
        lo[a] = lr_max_i(lr_brick_of(p->shift[a]), 0);
        hi[a] = lr_min_i(lr_brick_of(p->shift[a]) + p->v->table_size[a], size[a] - 1);
    }
    for (int32_t z = lo[2]; z <= hi[2]; z++)
        for (int32_t y = lo[1]; y <= hi[1]; y++)
            for (int32_t x = lo[0]; x <= hi[0]; x++) {
                const size_t at = lr_table_at(m->whole, x, y, z);
                if (!reaches(p, (const int32_t[3]){x, y, z}))
                    continue;
                if (count)
                    m->start[at + 1]++;
                else
                    m->list[m->start[at]++] = i;
            }
}

static lr_status list_parts(merger *m, const lr_watch *watch, lr_error *error)
{
    const size_t n = lr_table_count(m->whole);
    m->start = calloc(n + 2, sizeof *m->start);
    if (m->start == NULL)
        return lr_fail_memory(error, n * sizeof *m->start, "the bricks of a merged volume");
    for (uint32_t i = 0; i < m->n; i++) {
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        list_part(m, i, true);
    }
    for (size_t at = 0; at < n; at++)
        m->start[at + 1] += m->start[at];
    m->list = malloc(((size_t)m->start[n] + 1) * sizeof *m->list);
    if (m->list == NULL)
        return lr_fail_memory(error, m->start[n] * sizeof *m->list, "the bricks of a volume");
    for (uint32_t i = 0; i < m->n; i++) {
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        list_part(m, i, false);
    }
    memmove(m->start + 1, m->start, n * sizeof *m->start); /* each had moved to its end */
    m->start[0] = 0;
    return LR_OK;
}

/* ---- a brick ----------------------------------------------------------- */

/* Let a sample of part i compete for the two places. */
static void compete(const part *p, int32_t i, int s, double value, uint16_t id, lr_objects *o,
                    brick *b)
{
    if (!(value > 0.0))
        return;
    const uint16_t known = p->own[id] ? id : p->id;
    const int place = value > b->value[0][s] ? 0 : value > b->value[1][s] ? 1 : 2;
    if (b->from[1][s] >= 0) {
        o->n_dropped++;
        lr_mask_add(b->lost, lr_along(s, 0), lr_along(s, 1), lr_along(s, 2));
    }
    o->n_shared += place < 2 && b->from[0][s] >= 0 && b->from[1][s] < 0;
    if (place == 0) {
        b->value[1][s] = b->value[0][s];
        b->id[1][s] = b->id[0][s];
        b->from[1][s] = b->from[0][s];
    }
    if (place < 2) {
        b->value[place][s] = value;
        b->id[place][s] = known;
        b->from[place][s] = i;
    }
}

static void add_part(merger *m, uint32_t i, const int32_t first[3], brick *b)
{
    const part *p = &m->parts[i];
    for (int z = -1; z < LR_SIDE; z++)
        for (int y = -1; y < LR_SIDE; y++)
            for (int x = -1; x < LR_SIDE; x++) {
                const int32_t c[3] = {first[0] + x - p->shift[0], first[1] + y - p->shift[1],
                                      first[2] + z - p->shift[2]};
                if (!lr_has_sample(p->v, c))
                    continue;
                const bool wanted = lr_is_surface_cell(p->v, c), here = x >= 0 && y >= 0 && z >= 0;
                b->at_surface = b->at_surface || wanted;
                if (!here)
                    continue;
                if (wanted)
                    lr_mask_add(b->cells, x, y, z);
                const size_t at = lr_sample_at(p->v, c[0], c[1], c[2]);
                compete(p, (int32_t)i, lr_in_brick(x, y, z), lr_load(p->v, at), p->v->ids[at],
                        m->whole->objects, b);
            }
}

/* The face that a sample of its first object names. */
static void name_nearest(const merger *m, const int32_t first[3], int s, brick *b)
{
    const part *p = &m->parts[b->from[0][s]];
    const int32_t x = first[0] + lr_along(s, 0) - p->shift[0],
                  y = first[1] + lr_along(s, 1) - p->shift[1],
                  z = first[2] + lr_along(s, 2) - p->shift[2];
    if (p->v->block_of == NULL)
        return;
    const size_t own = lr_entry(p->v, x, y, z) >> 8;
    const size_t block = p->v->block_of[LR_WORDS * own + lr_word_of(x, y, z)];
    const size_t at = block * LR_WORD_CELLS + lr_bit_of(x, y, z);
    if (block != 0 && p->v->nearest_triangle[at] != 0)
        b->nearest_triangle[s] = p->first_face + p->v->nearest_triangle[at];
}

static lr_status more_blocks(merger *m, lr_error *error)
{
    lr_objects *o = m->whole->objects;
    if (o->n_blocks + LR_WORDS <= m->capacity)
        return LR_OK;
    const size_t n = (size_t)m->capacity * 2 + 64;
    const size_t nbytes = lr_sample_nbytes(m->whole->desc.sample_type);
    unsigned char *samples = realloc(o->samples, n * LR_WORD_CELLS * nbytes);
    if (samples != NULL)
        o->samples = samples;
    uint16_t *ids = realloc(o->ids, n * LR_WORD_CELLS * sizeof *ids);
    if (ids != NULL)
        o->ids = ids;
    uint64_t *lost = realloc(o->lost, n * sizeof *lost);
    if (lost != NULL)
        o->lost = lost;
    if (samples == NULL || ids == NULL || lost == NULL)
        return lr_fail_memory(error, n * LR_WORD_CELLS * (nbytes + 2), "second samples");
    m->capacity = (uint32_t)n;
    return LR_OK;
}

static void put_seconds(lr_volume *v, uint32_t where, const brick *b)
{
    lr_objects *o = v->objects;
    for (int word = 0; word < LR_WORDS; word++) {
        bool any = false;
        for (int i = 0; i < LR_WORD_CELLS; i++) {
            const int s = lr_cell_of_bit(word, i);
            const size_t at = (size_t)o->n_blocks * LR_WORD_CELLS + (size_t)i;
            any = any || b->from[1][s] >= 0;
            o->ids[at] = b->id[1][s];
            lr_store_to(o->samples, v->desc.sample_type, at, b->value[1][s]);
        }
        o->lost[o->n_blocks] = b->lost[word];
        o->block_of[LR_WORDS * (size_t)where + (size_t)word] = any ? o->n_blocks++ : 0;
    }
}

static lr_status put_brick(merger *m, size_t at, const int32_t first[3], brick *b, lr_error *error)
{
    lr_volume *v = m->whole;
    uint32_t where, sub = 0;
    lr_status status = more_blocks(m, error);
    if (status == LR_OK)
        status = lr_volume_open_brick(v, at, &where, error);
    if (status != LR_OK)
        return status;
    for (int s = 0; s < LR_CELLS; s++) {
        const size_t to = (size_t)where * LR_CELLS + (size_t)s;
        lr_store_to(v->samples, v->desc.sample_type, to, b->value[0][s]);
        v->ids[to] = b->id[0][s];
        if (v->block_of != NULL && b->from[0][s] >= 0)
            name_nearest(m, first, s, b);
    }
    memcpy(v->cells[where], b->cells, sizeof b->cells);
    for (int s = 0; s < LR_WORDS; s++) {
        sub |= (uint32_t)(b->cells[s] != 0) << s;
        v->n_surface_cells += (uint64_t)__builtin_popcountll(b->cells[s]);
        lr_bound_word(v, first, s, b->cells[s]);
    }
    v->table[at] = where << 8 | sub;
    put_seconds(v, where, b);
    if (v->block_of != NULL)
        lr_volume_set_nearest(v, where, b->nearest_triangle, &v->n_blocks);
    return LR_OK;
}

static lr_status merge_brick(merger *m, const int32_t b[3], brick *work, lr_error *error)
{
    const size_t at = lr_table_at(m->whole, b[0], b[1], b[2]);
    const int32_t first[3] = {LR_SIDE * b[0], LR_SIDE * b[1], LR_SIDE * b[2]};
    if (m->start[at] == m->start[at + 1])
        return LR_OK;
    memset(work, 0, sizeof *work);
    memset(work->from, 0xff, sizeof work->from);
    for (uint32_t k = m->start[at]; k < m->start[at + 1]; k++)
        add_part(m, m->list[k], first, work);
    bool constant = !work->at_surface;
    for (int s = 0; s < LR_CELLS && constant; s++)
        constant = work->value[0][s] == work->value[0][0] && work->from[0][s] == work->from[0][0] &&
                   work->from[1][s] < 0;
    constant = constant && (work->value[0][0] == 0.0 || work->value[0][0] == m->whole->one);
    if (!constant)
        return put_brick(m, at, first, work, error);
    if (work->value[0][0] != 0.0) {
        lr_volume_enter_full(m->whole, at);
        m->whole->objects->owner[at] = (uint16_t)work->from[0][0];
    }
    return LR_OK;
}

/* ---- the whole --------------------------------------------------------- */

static lr_status begin(merger *m, const lr_volume *const *volumes, lr_error *error)
{
    const lr_volume *first = volumes[0];
    int32_t lo[3] = {0}, hi[3] = {first->desc.nx, first->desc.ny, first->desc.nz};
    for (uint32_t i = 0; i < m->n; i++) {
        const lr_volume *v = m->parts[i].v = volumes[i];
        const int32_t n[3] = {v->desc.nx, v->desc.ny, v->desc.nz};
        lr_status status = check_part(v, first, i, error);
        if (status == LR_OK)
            status = offset_of(v, first, i, m->parts[i].shift, error);
        if (status != LR_OK)
            return status;
        for (int a = 0; a < 3; a++) {
            lo[a] = lr_min_i(lo[a], m->parts[i].shift[a]);
            hi[a] = lr_max_i(hi[a], m->parts[i].shift[a] + n[a]);
        }
    }
    lr_volume_desc desc = first->desc;
    desc.nx = hi[0] - lo[0];
    desc.ny = hi[1] - lo[1];
    desc.nz = hi[2] - lo[2];
    for (int i = 0; i < 3; i++)
        for (int a = 0; a < 3; a++)
            desc.object_from_index[4 * i + 3] += first->desc.object_from_index[4 * i + a] * lo[a];
    for (uint32_t i = 0; i < m->n; i++)
        for (int a = 0; a < 3; a++)
            m->parts[i].shift[a] -= lo[a];
    const double n_table = ((double)desc.nx / LR_SIDE + 1) * ((double)desc.ny / LR_SIDE + 1) *
                           ((double)desc.nz / LR_SIDE + 1);
    if (!(n_table <= LR_MOST_TABLE))
        return lr_fail(error, LR_E_SIZE,
                       "the parts span %d x %d x %d samples, more than fit (4096^3)", desc.nx,
                       desc.ny, desc.nz);
    return lr_volume_begin(&desc, &m->whole, error);
}

static lr_status join_faces(merger *m, lr_error *error)
{
    lr_triangle_attributes_part *parts = calloc(m->n, sizeof *parts);
    if (parts == NULL)
        return lr_fail_memory(error, m->n * sizeof *parts, "a list of volumes");
    for (uint32_t i = 0; i < m->n; i++) {
        parts[i].faces = m->parts[i].v->faces;
        memcpy(parts[i].shift, m->parts[i].shift, sizeof parts[i].shift);
    }
    lr_status status = lr_triangle_attributes_join(parts, m->n, &m->whole->faces, error);
    for (uint32_t i = 0; i < m->n; i++)
        m->parts[i].first_face = parts[i].first_face;
    free(parts);
    return status;
}

static lr_status make_room(merger *m, lr_error *error)
{
    lr_volume *v = m->whole;
    const size_t n = lr_table_count(v);
    uint64_t n_bricks = 0;
    bool nearest_triangle = false;
    for (size_t at = 0; at < n; at++)
        n_bricks += m->start[at] < m->start[at + 1];
    for (uint32_t i = 0; i < m->n; i++)
        nearest_triangle = nearest_triangle || m->parts[i].v->nearest_triangle != NULL;
    lr_status status = lr_volume_reserve(v, n_bricks, error);
    if (status == LR_OK && nearest_triangle)
        status = lr_volume_carry(v, n_bricks, error);
    if (status == LR_OK && nearest_triangle)
        status = join_faces(m, error);
    if (status != LR_OK)
        return status;
    v->objects->n_blocks = 1;
    v->objects->owner = calloc(n, sizeof *v->objects->owner);
    v->objects->block_of =
        calloc(n_bricks + LR_FIRST_STORED, LR_WORDS * sizeof *v->objects->block_of);
    if (v->objects->block_of == NULL || v->objects->owner == NULL)
        return lr_fail_memory(error, n_bricks * 32, "second samples");
    return LR_OK;
}

static lr_status merge_bricks(merger *m, const lr_watch *watch, lr_error *error)
{
    lr_volume *v = m->whole;
    brick *work = malloc(sizeof *work);
    lr_status status = LR_OK;
    if (work == NULL)
        return lr_fail_memory(error, sizeof *work, "a brick");
    lr_bound_nothing(v);
    for (int32_t z = 0; z < v->table_size[2] && status == LR_OK; z++) {
        for (int32_t y = 0; y < v->table_size[1] && status == LR_OK; y++) {
            if (lr_stopped(watch))
                status = lr_fail_stopped(error);
            for (int32_t x = 0; x < v->table_size[0] && status == LR_OK; x++)
                status = merge_brick(m, (const int32_t[3]){x, y, z}, work, error);
        }
        lr_progress(watch, (double)(z + 1) / v->table_size[2]);
    }
    free(work);
    return status;
}

static lr_status finish(merger *m, const lr_watch *watch, lr_error *error)
{
    lr_volume *v = m->whole;
    lr_status status = lr_volume_trim_blocks(v, watch, error);
    if (status != LR_OK)
        return status;
    v->capacity = 0;
    status = lr_volume_reserve(v, v->n_bricks - LR_FIRST_STORED, error);
    v->finished = status == LR_OK;
    return status;
}

static lr_status merge(merger *m, const lr_volume *const *volumes, const lr_watch *watch,
                       lr_error *error)
{
    lr_status status = begin(m, volumes, error);
    if (status != LR_OK)
        return status;
    lr_objects *o = m->whole->objects = calloc(1, sizeof *o);
    uint8_t *taken = calloc(65536, 1);
    if (o != NULL)
        o->id_of = calloc(m->n, sizeof *o->id_of);
    if (o == NULL || taken == NULL || o->id_of == NULL)
        status = lr_fail_memory(error, sizeof *o + 65536, "the ids of a volume");
    for (uint32_t i = 0; i < m->n && status == LR_OK; i++)
        status = take_ids(&m->parts[i], i, o, taken, error);
    free(taken);
    if (status == LR_OK) {
        o->n_objects = m->n;
        status = list_parts(m, watch, error);
    }
    if (status == LR_OK)
        status = make_room(m, error);
    if (status == LR_OK)
        status = merge_bricks(m, watch, error);
    return status == LR_OK ? finish(m, watch, error) : status;
}

lr_status lr_volume_merge(const lr_volume *const *volumes, uint64_t n, const lr_watch *watch,
                          lr_volume **volume, lr_error *error)
{
    if (n < 1 || n > 65536)
        return lr_fail(error, LR_E_ARGUMENT, "1 to 65536 volumes can be merged; there are %llu",
                       (unsigned long long)n);
    merger m = {.n = (uint32_t)n, .parts = calloc(n, sizeof *m.parts)};
    if (m.parts == NULL)
        return lr_fail_memory(error, n * sizeof *m.parts, "a list of volumes");
    lr_status status = merge(&m, volumes, watch, error);
    for (uint32_t i = 0; i < m.n; i++)
        free(m.parts[i].own);
    free(m.parts);
    free(m.start);
    free(m.list);
    if (status == LR_OK)
        *volume = m.whole;
    else
        lr_volume_free(m.whole);
    return status;
}
