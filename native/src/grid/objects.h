/* Several objects in one volume: the second sample where two objects meet.
 *
 * A sample belongs to the object whose occupancy is largest; where another one has
 * some, too, its occupancy and id are kept beside, in blocks of 4^3 samples, and only
 * where there are such samples. So every object's own field can be had: its sample
 * where it is one of the two, else 0. What a third object had is lost, and counted;
 * there the second sample stands for it, which is no smaller, so that solids which lose
 * samples to each other overlap a little and do not part. Objects are told by ids: each
 * has its own.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_OBJECTS_H
#define LR_GRID_OBJECTS_H

#include "grid/access.h"

#define LR_NO_OBJECT (-1) /* also: of a volume that does not tell objects apart */

/* What is added here goes through serialize.c, too. */
typedef struct lr_objects {
    uint16_t object_of[65536]; /* of an id */
    uint16_t *id_of;           /* [n_objects]: one of the object's ids */
    uint16_t *owner;           /* [table]: object of a brick of ones */
    uint32_t n_objects;
    uint32_t *block_of;     /* [n_bricks][LR_WORDS]: of words, 0: no second samples */
    uint32_t n_blocks;      /* with block 0, which is never read */
    unsigned char *samples; /* [n_blocks][LR_WORD_CELLS] of the volume's type, as attributes lie */
    uint16_t *ids;          /* likewise */
    uint64_t *lost;         /* [n_blocks]: a bit where a third sample was lost */
    uint64_t n_shared;      /* samples of two objects */
    uint64_t n_dropped;     /* thirds that were lost */
} lr_objects;

/* The two that a sample may hold; value 0: none. */
typedef struct lr_pair_of_samples {
    double value[2];
    uint16_t id[2];
    int32_t object[2]; /* LR_NO_OBJECT where the value is 0 */
    bool lost;         /* others had samples here, no larger than the second */
} lr_pair_of_samples;

/* In a volume that tells objects apart. */
LR_INLINE lr_pair_of_samples lr_sample_pair(const lr_volume *v, int32_t x, int32_t y, int32_t z)
{
    const lr_objects *o = v->objects;
    const size_t table = lr_table_of(v, x, y, z), brick = v->table[table] >> 8;
    const size_t at = lr_sample_at(v, x, y, z);
    const uint32_t block = o->block_of[LR_WORDS * brick + lr_word_of(x, y, z)],
                   bit = lr_bit_of(x, y, z);
    lr_pair_of_samples p = {.value = {lr_load(v, at), 0.0},
                            .id = {v->ids[at], 0},
                            .object = {LR_NO_OBJECT, LR_NO_OBJECT}};
    if (brick == LR_BRICK_ONE)
        p.id[0] = o->id_of[o->owner[table]];
    if (p.value[0] > 0.0)
        p.object[0] = o->object_of[p.id[0]];
    if (block != 0) {
        const size_t other = (size_t)block * LR_WORD_CELLS + bit;
        p.value[1] = lr_load_from(o->samples, v->desc.sample_type, other);
        p.id[1] = o->ids[other];
        p.lost = o->lost[block] >> bit & 1;
        if (p.value[1] > 0.0)
            p.object[1] = o->object_of[p.id[1]];
    }
    return p;
}

/* What an object that is present nearby has of a sample. */
LR_INLINE double lr_value_of(const lr_pair_of_samples *p, int32_t object)
{
    return p->object[0] == object              ? p->value[0]
           : p->object[1] == object || p->lost ? p->value[1]
                                               : 0.0;
}

LR_INLINE double lr_sample_of(const lr_volume *v, int32_t object, int32_t x, int32_t y, int32_t z)
{
    const lr_pair_of_samples p = lr_sample_pair(v, x, y, z);
    return lr_value_of(&p, object);
}

/* lr_block of one object's samples; LR_NO_OBJECT: of all. */
LR_INLINE void lr_block_of(const lr_volume *v, int32_t object, int32_t x, int32_t y, int32_t z,
                           int n, double *out)
{
    if (object == LR_NO_OBJECT) {
        lr_block(v, x, y, z, n, out);
        return;
    }
    for (int k = 0; k < n; k++)
        for (int j = 0; j < n; j++)
            for (int i = 0; i < n; i++)
                *out++ = lr_sample_of(v, object, x + i, y + j, z + k);
}

/* The object of a hit's id. */
LR_INLINE int32_t lr_object_of(const lr_volume *v, int32_t id)
{
    return v->objects != NULL ? v->objects->object_of[id & 0xffff] : LR_NO_OBJECT;
}

void lr_objects_free(lr_objects *objects);
uint64_t lr_objects_nbytes(const lr_volume *volume);

#endif
