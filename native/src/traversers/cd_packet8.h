/* Chessboard distance, eight rays side by side.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRAVERSERS_CD_PACKET8_H
#define LR_TRAVERSERS_CD_PACKET8_H

#include "trace/traverser.h"
#include "traversers/cd_distances.h"

/* Can lr_cd_trace_packet8 do it? */
LR_INLINE bool lr_cd_fits_packet8(const lr_volume *v, const lr_cd_distances *f,
                                  const lr_trace_options *options)
{
    return f->packet8 && v->planes[0] == NULL && v->objects == NULL &&
           options->mode == LR_MODE_SURFACE && options->hit_test != LR_HIT_UNIFORM;
}

/* Rays first..end-1 of the batch, by AVX-512; counters may be NULL where no one counts. */
void lr_cd_trace_packet8(const lr_volume *v, const lr_cd_distances *f, const lr_rays *rays,
                         uint64_t first, uint64_t end, const lr_trace_options *options,
                         const lr_hits *hits, lr_counters *counters);

#endif
