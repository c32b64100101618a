/* Several objects in one volume: their memory.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/objects.h"

void lr_objects_free(lr_objects *o)
{
    if (o == NULL)
        return;
    free(o->block_of);
    free(o->samples);
    free(o->ids);
    free(o->lost);
    free(o->owner);
    free(o->id_of);
    free(o);
}

uint64_t lr_objects_nbytes(const lr_volume *v)
{
    const lr_objects *o = v->objects;
    if (o == NULL)
        return 0;
    const uint64_t sample = lr_sample_nbytes(v->desc.sample_type) + sizeof *o->ids;
    return sizeof *o + o->n_objects * sizeof *o->id_of + lr_table_count(v) * sizeof *o->owner +
           o->n_blocks * sizeof *o->lost + (uint64_t)v->n_bricks * LR_WORDS * sizeof *o->block_of +
           (uint64_t)o->n_blocks * LR_WORD_CELLS * sample;
}
