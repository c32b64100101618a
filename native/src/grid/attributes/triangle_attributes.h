/* Triangles of a mesh that a volume keeps for what their corners carry.
 *
 * Samples near the surface name the face that is nearest to them, in blocks of 4^3
 * samples, one for each word of a mask that holds corners of surface cells, in the order of its
 * bits: block_of[LR_WORDS brick + word] names it, 0 where there is none. Face 0 is none.
 *
 * A normal takes 2 x 16 bits of the octahedron's map: 0.003 degrees at most.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_ATTRIBUTES_TRIANGLE_ATTRIBUTES_H
#define LR_GRID_ATTRIBUTES_TRIANGLE_ATTRIBUTES_H

#include "base/octahedron.h"
#include "grid/brick_grid.h"

#define LR_OCTA_STEPS 65534.0 /* codes 1..65535 of a coordinate, so that 0 is free */

/* Every array is NULL where no face needs it. */
typedef struct lr_triangle_attributes {
    uint32_t n;                 /* with face 0 */
    float (*corner)[3][3];      /* [n]: storage space */
    uint32_t (*normal)[3];      /* [n]: octahedral codes, outward as the mesh is wound */
    int32_t *source;            /* [n]: lr_color_source or number of a texture */
    float (*color)[3][3];       /* [n]: linear RGB */
    float (*uv)[3][2];          /* [n] */
    const lr_texture **texture; /* NULL: white, until it is bound */
    uint32_t n_textures;
} lr_triangle_attributes;

void lr_triangle_attributes_free(lr_triangle_attributes *faces);
uint64_t lr_triangle_attributes_nbytes(const lr_triangle_attributes *faces); /* NULL: 0 */
/* Of one face. */
uint64_t lr_face_nbytes(bool normals, bool sources, bool colors, bool uvs);

/* Make room for n faces, the first of which is none, and so many textures. */
lr_status lr_triangle_attributes_new(uint32_t n, bool normals, bool sources, bool colors, bool uvs,
                                     uint32_t n_textures, lr_triangle_attributes **faces,
                                     lr_error *error);

/* The faces of a volume to be merged, or NULL, and where its storage starts in the whole's;
 * its face f becomes first_face + f. */
typedef struct lr_triangle_attributes_part {
    const lr_triangle_attributes *faces;
    int32_t shift[3];
    uint32_t first_face;
} lr_triangle_attributes_part;

/* All of them; what a part lacks and another has is white, or no normal. */
lr_status lr_triangle_attributes_join(lr_triangle_attributes_part *parts, uint32_t n_parts,
                                      lr_triangle_attributes **faces, lr_error *error);

/* Blocks of names: after lr_volume_reserve make room for those of so many bricks, once; give a
 * brick the numbers of its samples' faces, or NULL for none, in blocks from *next_block on; move
 * a brick's blocks down to n_blocks; drop the blocks that no hit can read. */
lr_status lr_volume_carry(lr_volume *volume, uint64_t n_bricks, lr_error *error);
void lr_volume_set_nearest(lr_volume *volume, uint32_t brick, const uint32_t *nearest_triangle,
                           uint32_t *next_block);
void lr_volume_move_names(lr_volume *volume, uint32_t brick);
lr_status lr_volume_trim_blocks(lr_volume *volume, const lr_watch *watch, lr_error *error);
uint64_t lr_volume_block_nbytes(void);

/* The block from which on there is room for those of stored brick i and all that follow. */
LR_INLINE uint32_t lr_first_block(uint32_t i)
{
    return 1 + LR_WORDS * i;
}

/* Where samples name a triangle by its number plus one: set named[] of it; name its face
 * face_of[] instead. */
void lr_volume_mark_named(const lr_volume *volume, uint32_t *named);
void lr_volume_rename(lr_volume *volume, const uint32_t *face_of);

/* n need not be unit; 0 of nothing. */
LR_INLINE uint32_t lr_normal_encode(const double n[3])
{
    double uv[2];
    if (!lr_octahedron_map(n, uv))
        return 0;
    return ((uint32_t)(0.5 * (uv[0] + 1.0) * LR_OCTA_STEPS + 0.5) + 1) |
           ((uint32_t)(0.5 * (uv[1] + 1.0) * LR_OCTA_STEPS + 0.5) + 1) << 16;
}

/* The code must not be 0. */
LR_INLINE void lr_normal_decode(uint32_t code, double n[3])
{
    const double uv[2] = {((code & 0xffff) - 1) / (0.5 * LR_OCTA_STEPS) - 1.0,
                          ((code >> 16) - 1) / (0.5 * LR_OCTA_STEPS) - 1.0};
    lr_octahedron_direction(uv, n);
}

#endif
