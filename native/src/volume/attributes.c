/* Blocks of attributes: made while a volume is filled, trimmed when it is
 * finished, read at points.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "volume/attributes.h"

#include "error.h"
#include "volume/affine.h"

uint64_t lr_volume_block_nbytes(bool colors, bool normals)
{
    return (uint64_t)LR_BLOCK_SAMPLES * sizeof(uint32_t) * ((uint64_t)colors + (uint64_t)normals);
}

lr_status lr_volume_carry(lr_volume *v, bool colors, bool normals, double color_scale,
                          uint64_t n_bricks, lr_error *error)
{
    const size_t n = 8 * (size_t)n_bricks + 1, nbytes = n * LR_BLOCK_SAMPLES * sizeof(uint32_t);
    if (n_bricks > LR_MAX_BRICKS)
        return lr_fail(error, LR_E_SIZE, "a volume holds the attributes of at most %d bricks",
                       LR_MAX_BRICKS);
    v->color_scale = color_scale;
    v->n_blocks = 1;
    v->block_of = calloc(v->capacity, 8 * sizeof *v->block_of);
    if (colors)
        v->colors = malloc(nbytes);
    if (normals)
        v->normals = malloc(nbytes);
    if (v->block_of == NULL || (colors && v->colors == NULL) || (normals && v->normals == NULL))
        return lr_fail_memory(error, n * lr_volume_block_nbytes(colors, normals),
                              "the attributes of a volume");
    return LR_OK;
}

/* A sub-brick's codes out of a brick's; whether there are any but 0. */
static bool put_sub(uint32_t *to, const uint32_t *codes, int s)
{
    uint32_t any = 0;
    codes += 4 * (s & 1) + 32 * (s >> 1 & 1) + 256 * (s >> 2);
    for (int i = 0; i < LR_BLOCK_SAMPLES; i++)
        any |= to[i] = codes[(i & 3) + 8 * (i >> 2 & 3) + 64 * (i >> 4)];
    return any != 0;
}

void lr_volume_put_codes(lr_volume *v, uint32_t brick, const uint32_t *colors,
                         const uint32_t *normals)
{
    for (int s = 0; s < 8; s++) {
        const size_t at = (size_t)v->n_blocks * LR_BLOCK_SAMPLES;
        const bool color = v->colors != NULL && put_sub(v->colors + at, colors, s);
        const bool normal = v->normals != NULL && put_sub(v->normals + at, normals, s);
        if (color || normal)
            v->block_of[8 * (size_t)brick + (size_t)s] = v->n_blocks++;
    }
}

/* Does a surface cell have a corner among the samples of a sub-brick? Its cells that
 * lie below are in the last layers of other sub-bricks. */
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
            v->cells[lr_entry(v, p[0], p[1], p[2]) >> 8][lr_sub_of(p[0], p[1], p[2])] & mask)
            return true;
    }
    return false;
}

static void shrink(uint32_t **codes, uint32_t n_blocks)
{
    if (*codes == NULL)
        return;
    uint32_t *less = realloc(*codes, (size_t)n_blocks * LR_BLOCK_SAMPLES * sizeof **codes);
    if (less != NULL)
        *codes = less;
}

static bool mark_needed(const lr_volume *v, const lr_watch *watch, uint8_t *needed)
{
    for (int32_t z = 0; z < v->table_size[2]; z++) {
        if (lr_stopped(watch))
            return false;
        for (int32_t y = 0; y < v->table_size[1]; y++)
            for (int32_t x = 0; x < v->table_size[0]; x++) {
                const size_t brick = v->table[lr_table_at(v, x, y, z)] >> 8;
                for (int32_t s = 0; brick >= LR_FIRST_STORED && s < 8; s++) {
                    const uint32_t block = v->block_of[8 * brick + (size_t)s];
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
        uint32_t *const both[2] = {v->colors, v->normals};
        for (int i = 0; i < 2; i++)
            if (both[i] != NULL && needed[from] && moved[from] != from)
                memcpy(both[i] + (size_t)moved[from] * LR_BLOCK_SAMPLES,
                       both[i] + (size_t)from * LR_BLOCK_SAMPLES,
                       LR_BLOCK_SAMPLES * sizeof *both[i]);
    }
    for (size_t i = 0; i < 8 * (size_t)v->n_bricks; i++)
        v->block_of[i] = moved[v->block_of[i]];
    v->n_blocks = next;
    shrink(&v->colors, next);
    shrink(&v->normals, next);
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

lr_status lr_volume_attributes(const lr_volume *v, const double *points, const uint16_t *ids,
                               uint64_t n, double *colors, double *normals, lr_error *error)
{
    if (!v->finished)
        return lr_fail(error, LR_E_ARGUMENT, "the volume is not finished");
    const int32_t last[3] = {v->desc.nx + 1, v->desc.ny + 1, v->desc.nz + 1}; /* storage cells */
    for (uint64_t i = 0; i < n; i++) {
        double q[3], p[3], color[3] = {NAN, NAN, NAN}, normal[3] = {NAN, NAN, NAN};
        int32_t c[3];
        lr_map_point(v->storage_from_object, points + 3 * i, q);
        for (int a = 0; a < 3; a++) {
            c[a] = (int32_t)lr_clamp(floor(q[a]), 1.0, last[a]);
            p[a] = lr_clamp(q[a] - c[a], 0.0, 1.0);
        }
        const int32_t id = ids != NULL ? ids[i] : 0;
        if (colors != NULL) {
            lr_volume_color(v, c, p, id, color);
            memcpy(colors + 3 * i, color, sizeof color);
        }
        if (normals != NULL) {
            lr_volume_shading_normal(v, c, p, id, NULL, normal);
            memcpy(normals + 3 * i, normal, sizeof normal);
        }
    }
    return LR_OK;
}
