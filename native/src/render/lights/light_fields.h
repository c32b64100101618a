/* Checks of the fields that several types of lights have.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_LIGHTS_LIGHT_FIELDS_H
#define LR_RENDER_LIGHTS_LIGHT_FIELDS_H

#include "base/base.h"

enum {
    LR_FIELD_POSITION = 1,
    LR_FIELD_DIRECTION = 2,
    LR_FIELD_SHAPE = 4,
    LR_FIELD_RADIUS = 8,
    LR_FIELD_ANGLE = 16
};

/* LR_E_ARGUMENT if one of these fields of light i is invalid. */
lr_status lr_light_fields_check(const lr_light *light, uint64_t i, int fields, lr_error *error);

#endif
