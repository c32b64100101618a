/* Tests of triangles against cells, with what every processor has.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/triangle_cells.h"
#include "grid/trilinear.h"
#include "mesh/link_edges.h"
#include "mesh/triangle_box.h"
#include "voxelize/cell_tests.h"
#include "voxelize/filter_profile.h"

#define LR_TEST_CELLS lr_test_cells_portable

#include "voxelize/cell_tests_impl.h"
