/* Cells side by side, by whatever the processor.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/cell_lanes.h"

#define LR_LANES_NAME(name) name##_portable

#include "trace/cell_lanes_impl.h"
