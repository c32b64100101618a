/* Light along rays side by side, by AVX2.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "trace/ray_light.h"

#define LR_VECTORS    1
#define LR_LIGHT_RAYS lr_light_rays_avx2

LR_TARGET_AVX2
#include "trace/ray_light_impl.h"
LR_TARGET_END
