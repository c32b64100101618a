/* Chessboard distance for packets of rays, sixteen side by side.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRAVERSERS_CD_PACKET_H
#define LR_TRAVERSERS_CD_PACKET_H

#include "trace/traverser.h"
#include "traversers/cd_distances.h"

/* Rays first..end-1 of the batch; counters may be NULL where no one counts. */
typedef void lr_cd_trace_packet(const lr_volume *v, const lr_cd_distances *f, const lr_rays *rays,
                                uint64_t first, uint64_t end, const lr_trace_options *options,
                                const lr_hits *hits, lr_counters *counters);

typedef struct lr_cd_packet {
    lr_cd_trace_packet *trace;
} lr_cd_packet;

/* By the instructions of an lr_simd that the processor has. */
extern const lr_cd_packet lr_cd_packet_portable, lr_cd_packet_avx2, lr_cd_packet_avx512;

/* Can packets do it? */
LR_INLINE bool lr_cd_fits_packet(const lr_volume *v, const lr_cd_distances *f,
                                 const lr_trace_options *options)
{
    return f->packet != NULL && v->planes[0] == NULL && options->hit_test != LR_HIT_UNIFORM;
}

#endif
