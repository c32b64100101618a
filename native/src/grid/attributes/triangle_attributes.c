/* Faces and the blocks that name them: made while a volume is filled, trimmed when it is
 * finished.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/attributes/triangle_attributes.h"

#include "base/error.h"
#include "grid/access.h"

/* ---- faces ------------------------------------------------------------- */

uint64_t lr_face_nbytes(bool normals, bool sources, bool colors, bool uvs)
{
    const lr_triangle_attributes *f = NULL;
    return sizeof *f->corner + normals * sizeof *f->normal + sources * sizeof *f->source +
           colors * sizeof *f->color + uvs * sizeof *f->uv;
}

uint64_t lr_triangle_attributes_nbytes(const lr_triangle_attributes *f)
{
    if (f == NULL)
        return 0;
    return sizeof *f + f->n_textures * sizeof *f->texture +
           f->n * lr_face_nbytes(f->normal != NULL, f->source != NULL, f->color != NULL,
                                 f->uv != NULL);
}

void lr_triangle_attributes_free(lr_triangle_attributes *f)
{
    if (f == NULL)
        return;
    free(f->corner);
    free(f->normal);
    free(f->source);
    free(f->color);
    free(f->uv);
    free((void *)f->texture);
    free(f);
}

lr_status lr_triangle_attributes_new(uint32_t n, bool normals, bool sources, bool colors, bool uvs,
                                     uint32_t n_textures, lr_triangle_attributes **faces,
                                     lr_error *error)
{
    lr_triangle_attributes *f = calloc(1, sizeof *f);
    if (f == NULL)
        return lr_fail_memory(error, sizeof *f, "the faces of a volume");
    f->n = n;
    f->n_textures = n_textures;
    f->corner = calloc(n, sizeof *f->corner);
    f->normal = normals ? calloc(n, sizeof *f->normal) : NULL;
    f->source = sources ? calloc(n, sizeof *f->source) : NULL;
    f->color = colors ? calloc(n, sizeof *f->color) : NULL;
    f->uv = uvs ? calloc(n, sizeof *f->uv) : NULL;
    f->texture = calloc((size_t)n_textures + 1, sizeof *f->texture);
    if (f->corner == NULL || (normals && f->normal == NULL) || (sources && f->source == NULL) ||
        (colors && f->color == NULL) || (uvs && f->uv == NULL) || f->texture == NULL) {
        lr_triangle_attributes_free(f);
        return lr_fail_memory(error, n * lr_face_nbytes(normals, sources, colors, uvs),
                              "the faces of a volume");
    }
    *faces = f;
    return LR_OK;
}

/* A part's faces among those of the whole. */
static void take(const lr_triangle_attributes_part *p, const int32_t *texture_of,
                 lr_triangle_attributes *whole)
{
    const lr_triangle_attributes *own = p->faces;
    for (uint32_t f = 1; f < own->n; f++) {
        const uint32_t to = p->first_face + f;
        for (int c = 0; c < 3; c++)
            for (int a = 0; a < 3; a++)
                whole->corner[to][c][a] = own->corner[f][c][a] + (float)p->shift[a];
        if (own->normal != NULL)
            memcpy(whole->normal[to], own->normal[f], sizeof *own->normal);
        if (own->color != NULL)
            memcpy(whole->color[to], own->color[f], sizeof *own->color);
        if (own->uv != NULL)
            memcpy(whole->uv[to], own->uv[f], sizeof *own->uv);
        if (whole->source == NULL)
            continue;
        whole->source[to] = own->source != NULL ? own->source[f] : LR_COLOR_NONE;
        if (whole->source[to] >= 0)
            whole->source[to] = texture_of[whole->source[to]];
    }
}

/* The textures of a part among those of the whole, whose number grows by new ones. */
static void take_textures(const lr_triangle_attributes *own, lr_triangle_attributes *whole,
                          int32_t *texture_of)
{
    for (uint32_t i = 0; i < own->n_textures; i++) {
        uint32_t at = 0;
        while (at < whole->n_textures && whole->texture[at] != own->texture[i])
            at++;
        texture_of[i] = (int32_t)at;
        if (at == whole->n_textures)
            whole->texture[whole->n_textures++] = own->texture[i];
    }
}

lr_status lr_triangle_attributes_join(lr_triangle_attributes_part *parts, uint32_t n_parts,
                                      lr_triangle_attributes **faces, lr_error *error)
{
    bool normals = false, sources = false, colors = false, uvs = false;
    uint64_t n = 1, n_textures = 0;
    for (uint32_t i = 0; i < n_parts; i++) {
        const lr_triangle_attributes *f = parts[i].faces;
        if (f == NULL)
            continue;
        parts[i].first_face = (uint32_t)(n - 1);
        n += f->n - 1;
        n_textures += f->n_textures;
        normals = normals || f->normal != NULL;
        sources = sources || f->source != NULL;
        colors = colors || f->color != NULL;
        uvs = uvs || f->uv != NULL;
    }
    if (n > UINT32_MAX || n_textures > INT32_MAX)
        return lr_fail(error, LR_E_SIZE, "the volumes keep %llu faces, more than fit (2^32)",
                       (unsigned long long)n);
    lr_status status = lr_triangle_attributes_new((uint32_t)n, normals, sources, colors, uvs,
                                                  (uint32_t)n_textures, faces, error);
    int32_t *texture_of = malloc((n_textures + 1) * sizeof *texture_of);
    if (status == LR_OK && texture_of == NULL)
        status = lr_fail_memory(error, n_textures * sizeof *texture_of, "a list of textures");
    if (status == LR_OK)
        (*faces)->n_textures = 0;
    for (uint32_t i = 0; i < n_parts && status == LR_OK; i++)
        if (parts[i].faces != NULL) {
            take_textures(parts[i].faces, *faces, texture_of);
            take(&parts[i], texture_of, *faces);
        }
    free(texture_of);
    return status;
}

lr_status lr_volume_bind(lr_volume *v, const lr_texture *const *textures, uint64_t n,
                         lr_error *error)
{
    const uint64_t wanted = v->faces != NULL ? v->faces->n_textures : 0;
    if (n != wanted)
        return lr_fail(error, LR_E_ARGUMENT, "the volume has %llu textures; these are %llu",
                       (unsigned long long)wanted, (unsigned long long)n);
    for (uint64_t i = 0; i < n; i++)
        v->faces->texture[i] = textures[i];
    return LR_OK;
}

/* ---- blocks ------------------------------------------------------------ */

uint64_t lr_volume_block_nbytes(void)
{
    return LR_WORD_CELLS * sizeof(uint32_t);
}

lr_status lr_volume_carry(lr_volume *v, uint64_t n_bricks, lr_error *error)
{
    const size_t n = LR_WORDS * (size_t)n_bricks + 1;
    if (v->block_of != NULL)
        return LR_OK;
    if (n_bricks > LR_MAX_BRICKS)
        return lr_fail(error, LR_E_SIZE, "a volume holds the attributes of at most %d bricks",
                       LR_MAX_BRICKS);
    v->n_blocks = 1;
    v->block_of = calloc(v->capacity, LR_WORDS * sizeof *v->block_of);
    v->nearest_triangle = malloc(n * lr_volume_block_nbytes());
    if (v->block_of == NULL || v->nearest_triangle == NULL)
        return lr_fail_memory(error, n * lr_volume_block_nbytes(), "the attributes of a volume");
    return LR_OK;
}

/* A word's numbers out of a brick's; whether there are any but 0. */
static bool put_sub(uint32_t *to, const uint32_t *nearest_triangle, int s)
{
    uint32_t any = 0;
    for (int i = 0; i < LR_WORD_CELLS; i++)
        any |= to[i] = nearest_triangle[lr_cell_of_bit(s, i)];
    return any != 0;
}

void lr_volume_set_nearest(lr_volume *v, uint32_t brick, const uint32_t *nearest_triangle,
                           uint32_t *next_block)
{
    for (int s = 0; s < LR_WORDS; s++) {
        uint32_t *block = &v->block_of[LR_WORDS * (size_t)brick + (size_t)s];
        *block = 0;
        if (nearest_triangle != NULL &&
            put_sub(v->nearest_triangle + (size_t)*next_block * LR_WORD_CELLS, nearest_triangle, s))
            *block = (*next_block)++;
    }
}

void lr_volume_move_names(lr_volume *v, uint32_t brick)
{
    for (size_t s = 0; s < LR_WORDS && v->block_of != NULL; s++) {
        uint32_t *block = &v->block_of[LR_WORDS * (size_t)brick + s];
        if (*block == 0)
            continue;
        memmove(v->nearest_triangle + (size_t)v->n_blocks * LR_WORD_CELLS,
                v->nearest_triangle + (size_t)*block * LR_WORD_CELLS, lr_volume_block_nbytes());
        *block = v->n_blocks++;
    }
}

/* Does a surface cell have a corner among the samples of a word? Its cells that lie
 * below are in the last layers of other words. */
static bool at_surface(const lr_volume *v, const int32_t sub[3])
{
    static const uint64_t last[3] = {0x8888888888888888u, 0xf000f000f000f000u, 0xffff000000000000u};
    for (int n = 0; n < 8; n++) {
        int32_t p[3];
        uint64_t mask = ~(uint64_t)0;
        bool inside = true;
        for (int a = 0; a < 3; a++) {
            const int below = n >> a & 1;
            p[a] = 4 * (sub[a] - below);
            inside = inside && p[a] >= 0;
            mask &= below ? last[a] : mask;
        }
        if (inside &&
            v->cells[lr_entry(v, p[0], p[1], p[2]) >> 8][lr_word_of(p[0], p[1], p[2])] & mask)
            return true;
    }
    return false;
}

static bool mark_needed(const lr_volume *v, const lr_watch *watch, uint8_t *needed)
{
    for (int32_t z = 0; z < v->table_size[2]; z++) {
        if (lr_stopped(watch))
            return false;
        for (int32_t y = 0; y < v->table_size[1]; y++)
            for (int32_t x = 0; x < v->table_size[0]; x++) {
                const size_t brick = v->table[lr_table_at(v, x, y, z)] >> 8;
                for (int32_t s = 0; brick >= LR_FIRST_STORED && s < LR_WORDS; s++) {
                    const uint32_t block = v->block_of[LR_WORDS * brick + (size_t)s];
                    const int32_t sub[3] = {2 * x + (s & 1), 2 * y + (s >> 1 & 1),
                                            2 * z + (s >> 2)};
                    if (block != 0)
                        needed[block] = at_surface(v, sub);
                }
            }
    }
    return true;
}

static void move_blocks(lr_volume *v, const uint8_t *needed, uint32_t *moved)
{
    uint32_t next = 1;
    moved[0] = 0;
    for (uint32_t from = 1; from < v->n_blocks; from++) {
        moved[from] = needed[from] ? next++ : 0;
        if (needed[from] && moved[from] != from)
            memcpy(v->nearest_triangle + (size_t)moved[from] * LR_WORD_CELLS,
                   v->nearest_triangle + (size_t)from * LR_WORD_CELLS, lr_volume_block_nbytes());
    }
    for (size_t i = 0; i < LR_WORDS * (size_t)v->n_bricks; i++)
        v->block_of[i] = moved[v->block_of[i]];
    v->n_blocks = next;
    uint32_t *less = realloc(v->nearest_triangle, (size_t)next * lr_volume_block_nbytes());
    if (less != NULL)
        v->nearest_triangle = less;
}

lr_status lr_volume_trim_blocks(lr_volume *v, const lr_watch *watch, lr_error *error)
{
    if (v->block_of == NULL)
        return LR_OK;
    uint8_t *needed = calloc(v->n_blocks, 1);
    uint32_t *moved = malloc(v->n_blocks * sizeof *moved);
    lr_status status = LR_OK;
    if (needed == NULL || moved == NULL)
        status = lr_fail_memory(error, v->n_blocks * (sizeof *moved + 1), "a list of blocks");
    else if (!mark_needed(v, watch, needed))
        status = lr_fail_stopped(error);
    else
        move_blocks(v, needed, moved);
    free(needed);
    free(moved);
    return status;
}

/* ---- names ------------------------------------------------------------- */

void lr_volume_mark_named(const lr_volume *v, uint32_t *named)
{
    const size_t n = (size_t)v->n_blocks * LR_WORD_CELLS;
    for (size_t i = LR_WORD_CELLS; i < n; i++)
        if (v->nearest_triangle[i] != 0)
            named[v->nearest_triangle[i] - 1] = 1;
}

void lr_volume_rename(lr_volume *v, const uint32_t *face_of)
{
    const size_t n = (size_t)v->n_blocks * LR_WORD_CELLS;
    for (size_t i = LR_WORD_CELLS; i < n; i++)
        if (v->nearest_triangle[i] != 0)
            v->nearest_triangle[i] = face_of[v->nearest_triangle[i] - 1];
}
