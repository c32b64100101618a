/* Rays through trees of triangles, by whatever the processor.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#define LR_VECTORS  0
#define LR_TREE_OPS lr_tree_portable

#include "trace/triangle_tree_impl.h"
