/* Chessboard distance for packets of rays, by AVX2.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "traversers/cd_packet.h"

#define LR_VECTORS   1
#define LR_CD_PACKET lr_cd_packet_avx2

LR_TARGET_AVX2
#include "traversers/cd_packet_impl.h"
LR_TARGET_END
