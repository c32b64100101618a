/* The functions that a type of lights implements. A new one is a file, a line of lights.def, a name
 * in leapray.h, and there the fields of lr_light that it needs.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_LIGHTS_LIGHT_TYPE_H
#define LR_RENDER_LIGHTS_LIGHT_TYPE_H

#include "render/lights/light_ray.h"

/* As the functions of light.h; check: of the fields that not all types have. */
#define LR_LIGHT_TYPE(kind, name)                                                                  \
    lr_status lr_##name##_light_check(const lr_light *, uint64_t, lr_error *);                     \
    bool lr_##name##_light_has_extent(const lr_light *);                                           \
    void lr_##name##_light_bound(const lr_light *, lr_light_bounds *);                             \
    bool lr_##name##_light_sample(const lr_light *, const double[3], const double[2],              \
                                  lr_light_ray *);                                                 \
    bool lr_##name##_light_hit(const lr_light *, const double[3], const double[3], double,         \
                               double *, double[3], double *);
#include "render/lights/lights.def"
#undef LR_LIGHT_TYPE

#endif
