/* Light along rays side by side, by AVX-512.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "trace/ray_light.h"

#define LR_VECTORS    2
#define LR_LIGHT_RAYS lr_light_rays_avx512

LR_TARGET_AVX512
#include "trace/ray_light_impl.h"
LR_TARGET_END
