/* The corners of surface cells in a byte each: see cd_corners.c.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRAVERSERS_CD_CORNERS_H
#define LR_TRAVERSERS_CD_CORNERS_H

#include "base/error.h"
#include "traversers/cd_distances.h"

/* Number the surface cells in near, and find first and corners. */
lr_status lr_cd_find_corners(const lr_volume *v, lr_cd_distances *f, uint32_t n_near,
                             const lr_watch *watch, lr_error *error);

#endif
