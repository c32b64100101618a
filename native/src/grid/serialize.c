/* A finished volume as bytes, and back: for files.
 *
 * The bytes are a head, which counts, and then the volume's own arrays, one after the
 * other, as they lie in memory: so an unpacked volume is the same to the bit. Both ways
 * walk one list of the arrays. Bytes may come from anywhere: what is unpacked has just the
 * length that its head foretells, before anything is allocated, and every number in it
 * that leads to another is checked before the volume may be used.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "grid/attributes/triangle_attributes.h"
#include "grid/objects.h"
#include "grid/triangle_cells.h"

/* Raised whenever the bytes or their meaning change. What is added to one of these
 * structures goes through arrays_of() or the head, too. */
#define FORMAT 5
_Static_assert(sizeof(void *) != 8 ||
                   (sizeof(struct lr_volume) == 688 && sizeof(lr_triangle_cells) == 88 &&
                    sizeof(lr_objects) == 131152 && sizeof(lr_triangle_attributes) == 64),
               "a structure has changed: pack what is new, and raise FORMAT");

enum { MOST_ARRAYS = 32, CHUNK = 1 << 24 };
static const char magic[] = {'L', 'R', 'V', 'O', 'L', 'U', 'M', 'E'};

typedef struct head {
    char magic[8];
    uint32_t format;
    uint32_t n_bricks; /* with the two constant ones */
    lr_volume_desc desc;
    uint32_t has_exact, has_exact_ids;
    uint32_t has_normals, has_sources, has_colors, has_uvs; /* of faces */
    uint32_t n_faces, n_textures;                           /* 0: there are none */
    uint32_t n_blocks;
    uint32_t n_objects; /* 0: not merged */
    uint32_t n_triangle_cells, n_list, n_triangles, n_vertices;
    double voxels_per_value;
    uint64_t n_shared, n_dropped;
    uint32_t n_second_blocks;
    uint32_t flat;
} head;

typedef struct array {
    void *data;
    uint64_t nbytes;
} array;

/* ---- what there is ----------------------------------------------------- */

static head head_of(const lr_volume *v)
{
    head h = {.format = FORMAT, .n_bricks = v->n_bricks, .desc = v->desc, .flat = v->flat};
    memcpy(h.magic, magic, sizeof h.magic);
    if (v->faces != NULL) {
        h.has_normals = v->faces->normal != NULL;
        h.has_sources = v->faces->source != NULL;
        h.has_colors = v->faces->color != NULL;
        h.has_uvs = v->faces->uv != NULL;
        h.n_faces = v->faces->n;
        h.n_textures = v->faces->n_textures;
        h.n_blocks = v->n_blocks;
    }
    if (v->triangle_cells != NULL) {
        h.has_exact = 1;
        h.has_exact_ids = v->triangle_cells->id != NULL;
        h.n_triangle_cells = v->triangle_cells->n_cells;
        h.n_list = v->triangle_cells->start[v->triangle_cells->n_cells];
        h.n_triangles = v->triangle_cells->n_triangles;
        h.n_vertices = v->triangle_cells->n_vertices;
        h.voxels_per_value = v->triangle_cells->voxels_per_value;
    }
    if (v->objects != NULL) {
        h.n_objects = v->objects->n_objects;
        h.n_second_blocks = v->objects->n_blocks;
        h.n_shared = v->objects->n_shared;
        h.n_dropped = v->objects->n_dropped;
    }
    return h;
}

/* The arrays that a head speaks of, in their order; data only where there is a volume.
 * The constant bricks and blocks are left out. */
static int arrays_of(const head *h, const lr_volume *v, array arrays[MOST_ARRAYS])
{
    const int32_t n[3] = {h->desc.nx, h->desc.ny, h->desc.nz};
    const uint64_t n_table = lr_volume_table_nbytes(n) / sizeof(uint32_t);
    const uint64_t n_bricks = h->n_bricks, stored = n_bricks - LR_FIRST_STORED;
    const uint64_t skip = (uint64_t)LR_FIRST_STORED * LR_CELLS;
    const uint64_t sample = lr_sample_nbytes(h->desc.sample_type);
    const uint64_t faces = h->n_faces, blocks = faces > 0 ? h->n_blocks - 1ull : 0;
    const uint64_t seconds = h->n_objects > 0 ? h->n_second_blocks - 1ull : 0;
    const uint64_t exact = h->has_exact != 0, objects = h->n_objects > 0;
    const lr_triangle_cells *e = v != NULL ? v->triangle_cells : NULL;
    const lr_objects *o = v != NULL ? v->objects : NULL;
    const lr_triangle_attributes *f = v != NULL ? v->faces : NULL;
    int count = 0;
#define ARRAY(owner, member, skipped, n_items, item_nbytes)                                        \
    arrays[count++] = (array){(owner) != NULL && (owner)->member != NULL                           \
                                  ? (unsigned char *)(owner)->member + (skipped) * (item_nbytes)   \
                                  : NULL,                                                          \
                              (n_items) * (item_nbytes)}
    ARRAY(v, table, 0, n_table, sizeof(uint32_t));
    ARRAY(v, samples, skip, stored * LR_CELLS, sample);
    ARRAY(v, ids, skip, h->desc.has_ids ? stored * LR_CELLS : 0, sizeof(uint16_t));
    ARRAY(v, cells, LR_FIRST_STORED, stored, sizeof(lr_mask));
    ARRAY(v, block_of, LR_WORDS * LR_FIRST_STORED, faces > 0 ? LR_WORDS * stored : 0,
          sizeof(uint32_t));
    ARRAY(v, nearest_triangle, LR_WORD_CELLS, blocks * LR_WORD_CELLS, sizeof(uint32_t));
    ARRAY(f, corner, 0, faces, sizeof *f->corner);
    ARRAY(f, normal, 0, h->has_normals ? faces : 0, sizeof *f->normal);
    ARRAY(f, source, 0, h->has_sources ? faces : 0, sizeof *f->source);
    ARRAY(f, color, 0, h->has_colors ? faces : 0, sizeof *f->color);
    ARRAY(f, uv, 0, h->has_uvs ? faces : 0, sizeof *f->uv);
    ARRAY(e, doubt, 0, exact * n_bricks, sizeof(lr_mask));
    ARRAY(e, first, 0, exact * n_bricks, sizeof(uint32_t));
    ARRAY(e, start, 0, exact * (h->n_triangle_cells + 1ull), sizeof(uint32_t));
    ARRAY(e, list, 0, exact * h->n_list, sizeof(uint32_t));
    ARRAY(e, triangle, 0, exact * h->n_triangles, 3 * sizeof(uint32_t));
    ARRAY(e, vertex, 0, exact * h->n_vertices, 3 * sizeof(double));
    ARRAY(e, id, 0, h->has_exact_ids ? exact * h->n_triangles : 0, sizeof(uint16_t));
    ARRAY(e, face, 0, faces > 0 ? exact * h->n_triangles : 0, sizeof(uint32_t));
    ARRAY(o, object_of, 0, objects * 65536, sizeof(uint16_t));
    ARRAY(o, id_of, 0, objects * h->n_objects, sizeof(uint16_t));
    ARRAY(o, owner, 0, objects * n_table, sizeof(uint16_t));
    ARRAY(o, block_of, 0, objects * LR_WORDS * n_bricks, sizeof(uint32_t));
    ARRAY(o, samples, LR_WORD_CELLS, seconds * LR_WORD_CELLS, sample);
    ARRAY(o, ids, LR_WORD_CELLS, seconds * LR_WORD_CELLS, sizeof(uint16_t));
    ARRAY(o, lost, 1, seconds, sizeof(uint64_t));
#undef ARRAY
    assert(count <= MOST_ARRAYS);
    return count;
}

static uint64_t nbytes_of(const head *h)
{
    array arrays[MOST_ARRAYS];
    uint64_t nbytes = sizeof *h;
    for (int i = 0, n = arrays_of(h, NULL, arrays); i < n; i++)
        nbytes += arrays[i].nbytes;
    return nbytes;
}

/* Copy so that a stop is heard. */
static bool copy(unsigned char *to, const unsigned char *from, uint64_t nbytes,
                 const lr_watch *watch)
{
    for (uint64_t at = 0; at < nbytes; at += CHUNK) {
        if (lr_stopped(watch))
            return false;
        memcpy(to + at, from + at, nbytes - at < CHUNK ? nbytes - at : CHUNK);
    }
    return true;
}

/* ---- to bytes ---------------------------------------------------------- */

uint64_t lr_volume_packed_nbytes(const lr_volume *v)
{
    const head h = head_of(v);
    return v->finished && v->planes[0] == NULL && v->transfer == NULL ? nbytes_of(&h) : 0;
}

lr_status lr_volume_pack(const lr_volume *v, uint8_t *bytes, uint64_t nbytes, const lr_watch *watch,
                         lr_error *error)
{
    if (!v->finished || v->planes[0] != NULL || v->transfer != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "only finished volumes are packed, and none that are rectilinear or have a "
                       "transfer function");
    const head h = head_of(v);
    if (nbytes != nbytes_of(&h))
        return lr_fail(error, LR_E_SIZE, "the volume takes %llu bytes, there is room for %llu",
                       (unsigned long long)nbytes_of(&h), (unsigned long long)nbytes);
    array arrays[MOST_ARRAYS];
    memcpy(bytes, &h, sizeof h);
    bytes += sizeof h;
    for (int i = 0, n = arrays_of(&h, v, arrays); i < n; i++) {
        if (!copy(bytes, arrays[i].data, arrays[i].nbytes, watch))
            return lr_fail_stopped(error);
        bytes += arrays[i].nbytes;
    }
    return LR_OK;
}

/* ---- what is wrong with bytes ------------------------------------------ */

/* Before anything is allocated; NULL: nothing. */
static const char *wrong_head(const head *h)
{
    if (memcmp(h->magic, magic, sizeof magic) != 0)
        return "they are none of a volume";
    if (h->format != FORMAT)
        return "they are of another version";
    if (h->n_bricks < LR_FIRST_STORED || h->n_bricks > LR_MAX_BRICKS)
        return "the number of bricks";
    if (h->n_faces > 0 ? !(h->n_blocks >= 1 && h->n_textures <= UINT16_MAX)
                       : (h->n_blocks | h->n_textures | h->has_normals | h->has_sources |
                          h->has_colors | h->has_uvs) != 0)
        return "the head of the attributes";
    if (h->desc.interpolation != LR_VOLUME_LINEAR && (h->n_faces > 0 || h->has_exact != 0))
        return "the head of a cubic volume";
    if (h->has_exact != 0 && !(isfinite(h->voxels_per_value) && h->n_triangle_cells < UINT32_MAX))
        return "the head of the triangles";
    if (h->n_objects > 0 &&
        !(h->n_objects <= 65536 && h->n_second_blocks >= 1 && h->desc.has_ids != 0 &&
          h->has_exact == 0 && h->desc.kind == LR_KIND_SOLID))
        return "the head of the objects";
    return NULL;
}

static bool all_below(const uint32_t *numbers, uint64_t n, uint32_t limit)
{
    bool below = true;
    for (uint64_t i = 0; i < n; i++)
        below = below && numbers[i] < limit;
    return below;
}

static bool floats_finite(const void *floats, uint64_t n)
{
    const float *x = floats;
    bool finite = true;
    for (uint64_t i = 0; i < n; i++)
        finite = finite && isfinite(x[i]);
    return finite;
}

static bool samples_finite(const lr_volume *v, const unsigned char *samples, size_t n)
{
    return lr_first_not_finite(samples, v->desc.sample_type, n) == n;
}

/* Bounds and number of the surface cells, and that every brick has one place; found, zeros, is
 * one byte a brick. */
static const char *wrong_bricks(lr_volume *v, uint8_t *found, const lr_watch *watch)
{
    uint32_t n_found = LR_FIRST_STORED;
    const char *wrong = NULL;
    lr_bound_nothing(v);
    v->n_surface_cells = 0;
    size_t at = 0;
    for (int32_t z = 0; z < v->table_size[2] && wrong == NULL; z++)
        for (int32_t y = 0; y < v->table_size[1] && !lr_stopped(watch); y++)
            for (int32_t x = 0; x < v->table_size[0] && wrong == NULL; x++, at++) {
                const uint32_t brick = v->table[at] >> 8;
                uint32_t sub = 0;
                if (brick >= v->n_bricks || (brick >= LR_FIRST_STORED && found[brick]))
                    wrong = "the table of bricks";
                for (int s = 0; wrong == NULL && brick >= LR_FIRST_STORED && s < LR_WORDS; s++) {
                    const uint64_t word = v->cells[brick][s];
                    sub |= (uint32_t)(word != 0) << s;
                    v->n_surface_cells += (uint64_t)__builtin_popcountll(word);
                    lr_bound_word(v, (const int32_t[3]){LR_SIDE * x, LR_SIDE * y, LR_SIDE * z}, s,
                                  word);
                }
                if (wrong == NULL && (v->table[at] & 0xff) != sub)
                    wrong = "the table of bricks";
                if (wrong == NULL && brick >= LR_FIRST_STORED) {
                    found[brick] = 1;
                    n_found++;
                }
            }
    if (wrong == NULL && !lr_stopped(watch) && n_found != v->n_bricks)
        wrong = "the table of bricks";
    for (int a = 0; a < 3 && wrong == NULL && v->n_surface_cells > 0; a++)
        if (v->surface_lo[a] < lr_first_cell(v) || v->surface_hi[a] > lr_last_cell(v, a))
            wrong = "surface cells beyond the lattice";
    return wrong;
}

static const char *wrong_faces(const lr_volume *v)
{
    const lr_triangle_attributes *f = v->faces;
    bool right = all_below(v->block_of, LR_WORDS * (uint64_t)v->n_bricks, v->n_blocks);
    right = right && all_below(v->nearest_triangle + LR_WORD_CELLS,
                               (v->n_blocks - 1ull) * LR_WORD_CELLS, f->n);
    for (uint32_t i = 1; i < f->n && f->source != NULL; i++)
        right = right && f->source[i] >= LR_COLOR_NONE && f->source[i] < (int32_t)f->n_textures &&
                (f->source[i] != LR_COLOR_VERTEX || f->color != NULL) &&
                (f->source[i] < 0 || f->uv != NULL || f->color != NULL);
    right = right && floats_finite(&f->corner[0][0][0], 9 * (uint64_t)f->n);
    right = right && (f->color == NULL || floats_finite(&f->color[0][0][0], 9 * (uint64_t)f->n));
    right = right && (f->uv == NULL || floats_finite(&f->uv[0][0][0], 6 * (uint64_t)f->n));
    return right ? NULL : "the attributes";
}

static const char *wrong_exact(const lr_volume *v, const lr_watch *watch)
{
    const lr_triangle_cells *e = v->triangle_cells;
    uint64_t n_cells = 0;
    bool right = e->start[0] == 0;
    for (uint32_t b = 0; b < e->n_bricks && right; b++) {
        uint32_t own = 0;
        for (uint32_t s = 0; s < LR_WORDS; s++)
            own += (uint32_t)__builtin_popcountll(lr_triangle_cell_word(v, b, s));
        right = own == 0 || (uint64_t)e->first[b] + own <= e->n_cells;
        n_cells += own;
    }
    for (uint32_t c = 0; c < e->n_cells && right; c++)
        right = e->start[c] <= e->start[c + 1];
    right = right && n_cells == e->n_cells && !lr_stopped(watch);
    right = right && all_below(e->list, e->start[e->n_cells], e->n_triangles);
    right = right && all_below(&e->triangle[0][0], 3 * (uint64_t)e->n_triangles, e->n_vertices);
    right = right && (e->face == NULL || all_below(e->face, e->n_triangles, v->faces->n));
    right = right && !lr_stopped(watch);
    right = right && lr_all_finite(&e->vertex[0][0], 3 * (size_t)e->n_vertices);
    return right ? NULL : "the triangles of cells";
}

static const char *wrong_objects(const lr_volume *v)
{
    const lr_objects *o = v->objects;
    const size_t n_table = lr_table_count(v);
    bool right = all_below(o->block_of, LR_WORDS * (uint64_t)v->n_bricks, o->n_blocks);
    for (uint32_t i = 0; i < 65536; i++)
        right = right && o->object_of[i] < o->n_objects;
    for (size_t at = 0; at < n_table; at++)
        right = right && o->owner[at] < o->n_objects;
    right = right && samples_finite(v, o->samples, (size_t)o->n_blocks * LR_WORD_CELLS);
    return right ? NULL : "the objects";
}

static const char *wrong_with(lr_volume *v, uint8_t *found, const lr_watch *watch)
{
    const char *wrong = wrong_bricks(v, found, watch);
    if (wrong == NULL && !samples_finite(v, v->samples, (size_t)v->n_bricks * LR_CELLS))
        wrong = "samples that are not finite";
    if (wrong == NULL && v->faces != NULL && !lr_stopped(watch))
        wrong = wrong_faces(v);
    if (wrong == NULL && v->triangle_cells != NULL && !lr_stopped(watch))
        wrong = wrong_exact(v, watch);
    if (wrong == NULL && v->objects != NULL && !lr_stopped(watch))
        wrong = wrong_objects(v);
    return wrong;
}

/* ---- from bytes -------------------------------------------------------- */

static lr_status allocate_triangle_cells(lr_volume *v, const head *h, lr_error *error)
{
    lr_triangle_cells *e = v->triangle_cells = calloc(1, sizeof *e);
    if (e == NULL)
        return lr_fail_memory(error, sizeof *e, "triangle cells");
    e->n_bricks = h->n_bricks;
    e->n_cells = h->n_triangle_cells;
    e->n_triangles = h->n_triangles;
    e->n_vertices = h->n_vertices;
    e->voxels_per_value = h->voxels_per_value;
    e->doubt = malloc(h->n_bricks * sizeof *e->doubt);
    e->first = malloc(h->n_bricks * sizeof *e->first);
    e->start = malloc(((size_t)h->n_triangle_cells + 1) * sizeof *e->start);
    e->list = malloc(((size_t)h->n_list + 1) * sizeof *e->list);
    e->triangle = malloc(((size_t)h->n_triangles + 1) * sizeof *e->triangle);
    e->vertex = malloc(((size_t)h->n_vertices + 1) * sizeof *e->vertex);
    if (h->has_exact_ids)
        e->id = malloc(((size_t)h->n_triangles + 1) * sizeof *e->id);
    if (h->n_faces > 0)
        e->face = malloc(((size_t)h->n_triangles + 1) * sizeof *e->face);
    const bool all = e->doubt != NULL && e->first != NULL && e->start != NULL && e->list != NULL &&
                     e->triangle != NULL && e->vertex != NULL;
    if (!all || (h->has_exact_ids && e->id == NULL) || (h->n_faces > 0 && e->face == NULL))
        return lr_fail_memory(error, nbytes_of(h), "triangle cells");
    return LR_OK;
}

static lr_status allocate_objects(lr_volume *v, const head *h, lr_error *error)
{
    lr_objects *o = v->objects = calloc(1, sizeof *o);
    if (o == NULL)
        return lr_fail_memory(error, sizeof *o, "objects");
    const size_t sample = lr_sample_nbytes(h->desc.sample_type);
    const size_t n_samples = (size_t)h->n_second_blocks * LR_WORD_CELLS;
    o->n_objects = h->n_objects;
    o->n_blocks = h->n_second_blocks;
    o->n_shared = h->n_shared;
    o->n_dropped = h->n_dropped;
    o->id_of = calloc(h->n_objects, sizeof *o->id_of);
    o->owner = calloc(lr_table_count(v), sizeof *o->owner);
    o->block_of = calloc(h->n_bricks, LR_WORDS * sizeof *o->block_of);
    o->samples = calloc(n_samples, sample);
    o->ids = calloc(n_samples, sizeof *o->ids);
    o->lost = calloc(h->n_second_blocks, sizeof *o->lost);
    if (o->id_of == NULL || o->owner == NULL || o->block_of == NULL || o->samples == NULL ||
        o->ids == NULL || o->lost == NULL)
        return lr_fail_memory(error, nbytes_of(h), "second samples");
    return LR_OK;
}

static lr_status allocate(const head *h, lr_volume **volume, lr_error *error)
{
    lr_volume_desc desc = h->desc;
    desc.has_ids = desc.has_ids != 0;
    lr_status status = lr_volume_begin(&desc, volume, error);
    if (status == LR_OK)
        status = lr_volume_reserve(*volume, h->n_bricks - LR_FIRST_STORED, error);
    if (status != LR_OK)
        return status;
    (*volume)->n_bricks = h->n_bricks;
    (*volume)->flat = h->flat != 0;
    if (h->n_faces > 0) {
        /* room for whole bricks: of blocks there may be fewer */
        status = lr_volume_carry(*volume, (h->n_blocks + LR_WORDS - 2ull) / LR_WORDS, error);
        (*volume)->n_blocks = h->n_blocks;
    }
    if (status == LR_OK && h->n_faces > 0)
        status = lr_triangle_attributes_new(h->n_faces, h->has_normals != 0, h->has_sources != 0,
                                            h->has_colors != 0, h->has_uvs != 0, h->n_textures,
                                            &(*volume)->faces, error);
    if (status == LR_OK && h->has_exact)
        status = allocate_triangle_cells(*volume, h, error);
    if (status == LR_OK && h->n_objects > 0)
        status = allocate_objects(*volume, h, error);
    return status;
}

static lr_status fill(lr_volume *v, const head *h, const uint8_t *bytes, const lr_watch *watch,
                      lr_error *error)
{
    array arrays[MOST_ARRAYS];
    for (int i = 0, n = arrays_of(h, v, arrays); i < n; i++) {
        if (!copy(arrays[i].data, bytes, arrays[i].nbytes, watch))
            return lr_fail_stopped(error);
        bytes += arrays[i].nbytes;
    }
    if (v->triangle_cells != NULL && v->triangle_cells->start[h->n_triangle_cells] != h->n_list)
        return lr_fail(error, LR_E_ARGUMENT, "bytes of a volume are wrong: the lists of cells");
    uint8_t *found = calloc(v->n_bricks, 1);
    if (found == NULL)
        return lr_fail_memory(error, v->n_bricks, "the check of a volume");
    const char *wrong = wrong_with(v, found, watch);
    free(found);
    if (lr_stopped(watch))
        return lr_fail_stopped(error);
    v->finished = wrong == NULL;
    return wrong == NULL ? LR_OK
                         : lr_fail(error, LR_E_ARGUMENT, "bytes of a volume are wrong: %s", wrong);
}

lr_status lr_volume_unpack(const uint8_t *bytes, uint64_t nbytes, const lr_watch *watch,
                           lr_volume **volume, lr_error *error)
{
    head h;
    if (nbytes < sizeof h)
        return lr_fail(error, LR_E_SIZE, "bytes of a volume are at least %zu; these are %llu",
                       sizeof h, (unsigned long long)nbytes);
    memcpy(&h, bytes, sizeof h);
    const char *wrong = wrong_head(&h);
    if (wrong != NULL)
        return lr_fail(error, LR_E_ARGUMENT, "bytes of a volume are wrong: %s", wrong);
    lr_status status = lr_volume_check(&h.desc, error);
    if (status != LR_OK)
        return status;
    if (nbytes != nbytes_of(&h))
        return lr_fail(error, LR_E_SIZE, "bytes of this volume are %llu; these are %llu",
                       (unsigned long long)nbytes_of(&h), (unsigned long long)nbytes);
    lr_volume *v = NULL;
    status = allocate(&h, &v, error);
    if (status == LR_OK)
        status = fill(v, &h, bytes + sizeof h, watch, error);
    if (status == LR_OK)
        *volume = v;
    else
        lr_volume_free(v);
    return status;
}
