/* Shader nodes after an image, as a list of operations on registers.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_GRID_ATTRIBUTES_SHADER_PROGRAM_H
#define LR_GRID_ATTRIBUTES_SHADER_PROGRAM_H

#include "base/base.h"

/* Whether every operand names something that is there. */
lr_status lr_program_check(const lr_program *program, lr_error *error);

/* Linear RGB of a colour with alpha; the program has been checked. */
void lr_program_color(const lr_program *program, const float rgba[4], float rgb[3]);

#endif
