/* Samples along rays side by side, by AVX-512.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "trace/ray_samples.h"

#define LR_VECTORS     2
#define LR_SAMPLE_RAYS lr_sample_rays_avx512

LR_TARGET_AVX512
#include "trace/ray_samples_impl.h"
LR_TARGET_END
