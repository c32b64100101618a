/* Rays through trees of triangles, by AVX-512.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "trace/triangle_tree.h"

#define LR_VECTORS  2
#define LR_TREE_OPS lr_tree_avx512

LR_TARGET_AVX512
#include "trace/triangle_tree_impl.h"
LR_TARGET_END
