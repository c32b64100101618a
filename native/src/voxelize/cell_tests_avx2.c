/* Tests of triangles against cells, by AVX2.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/target.h"
#include "grid/triangle_cells.h"
#include "grid/trilinear.h"
#include "mesh/link_edges.h"
#include "mesh/triangle_box.h"
#include "voxelize/cell_tests.h"
#include "voxelize/filter_profile.h"

#define LR_TEST_CELLS lr_test_cells_avx2

LR_TARGET_AVX2
#include "voxelize/cell_tests_impl.h"
LR_TARGET_END
