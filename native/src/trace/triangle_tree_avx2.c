/* Rays through trees of triangles, by AVX2.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "trace/triangle_tree.h"

#define LR_VECTORS  1
#define LR_TREE_OPS lr_tree_avx2

LR_TARGET_AVX2
#include "trace/triangle_tree_impl.h"
LR_TARGET_END
