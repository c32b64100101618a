/* Chessboard distance for packets of rays, by AVX-512.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "traversers/cd_packet.h"

#define LR_VECTORS   2
#define LR_CD_PACKET lr_cd_packet_avx512

LR_TARGET_AVX512
#include "traversers/cd_packet_impl.h"
LR_TARGET_END
