/* Checks of the fields that several types of lights have.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/lights/light_fields.h"

#include "base/error.h"

lr_status lr_light_fields_check(const lr_light *light, uint64_t i, int fields, lr_error *error)
{
    const unsigned long long k = i;
    const double length = sqrt(lr_dot(light->direction, light->direction));
    if ((fields & LR_FIELD_SHAPE) != 0 && light->shape != LR_LIGHT_ROUND &&
        light->shape != LR_LIGHT_FULL)
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have shape %d or %d, it has %d", k,
                       LR_LIGHT_ROUND, LR_LIGHT_FULL, light->shape);
    if ((fields & LR_FIELD_POSITION) != 0 && !lr_all_finite(light->position, 3))
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have a finite position", k);
    if ((fields & LR_FIELD_DIRECTION) != 0 && !(fabs(length - 1) < 1e-3)) /* it may come from f32 */
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a direction of length 1, it has %g", k, length);
    if ((fields & LR_FIELD_RADIUS) != 0 && !(light->radius >= 0 && isfinite(light->radius)))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a finite radius of 0 or more, it has %g", k,
                       light->radius);
    if ((fields & LR_FIELD_ANGLE) != 0 &&
        !(light->angle >= 0 && light->angle <= LR_PI * (1 + 1e-6)))
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have an angle of 0 to pi, it has %g",
                       k, light->angle);
    return LR_OK;
}
