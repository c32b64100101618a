/* Chessboard distance for packets of rays, by whatever the processor.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#define LR_VECTORS   0
#define LR_CD_PACKET lr_cd_packet_portable

#include "traversers/cd_packet_impl.h"
