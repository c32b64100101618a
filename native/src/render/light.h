/* Lights: where they are seen, how brightly, and how to choose a way to them.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_LIGHT_H
#define LR_LIGHT_H

#include "base.h"

/* Whether light i can be used. */
lr_status lr_light_check(const lr_light *light, uint64_t i, lr_error *error);

#endif
