/* Lights.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/light.h"

#include "error.h"

static const double PI = 3.141592653589793;

static bool all_finite(const double x[3])
{
    return isfinite(x[0]) && isfinite(x[1]) && isfinite(x[2]);
}

lr_status lr_light_check(const lr_light *light, uint64_t i, lr_error *error)
{
    const unsigned long long k = i;
    const double *c = light->color, *d = light->direction;
    if (light->kind < LR_LIGHT_SUN || light->kind > LR_LIGHT_AREA)
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must be of kind %d to %d, it is %d", k,
                       LR_LIGHT_SUN, LR_LIGHT_AREA, light->kind);
    if (light->shape != LR_LIGHT_ROUND && light->shape != LR_LIGHT_FULL)
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have shape %d or %d, it has %d", k,
                       LR_LIGHT_ROUND, LR_LIGHT_FULL, light->shape);
    if (!all_finite(c) || !(c[0] >= 0 && c[1] >= 0 && c[2] >= 0))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a finite color of 0 or more, it has (%g, %g, %g)", k,
                       c[0], c[1], c[2]);
    if (light->kind != LR_LIGHT_SUN && !all_finite(light->position))
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have a finite position", k);
    const double length = sqrt(lr_dot(d, d));
    if (light->kind != LR_LIGHT_POINT && !(fabs(length - 1) < 1e-3)) /* f32 may have been at work */
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a direction of length 1, it has %g", k, length);
    if (!(light->radius >= 0 && isfinite(light->radius)))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a finite radius of 0 or more, it has %g", k,
                       light->radius);
    if (!(light->angle >= 0 && light->angle <= PI * (1 + 1e-6)))
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have an angle of 0 to pi, it has %g",
                       k, light->angle);
    if (!(light->blend >= 0 && light->blend <= 1))
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have a blend of 0 to 1, it has %g", k,
                       light->blend);
    if (light->kind != LR_LIGHT_AREA)
        return LR_OK;
    const double *u = light->axis_u, *v = light->axis_v;
    const double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                         u[0] * v[1] - u[1] * v[0]};
    const double area = sqrt(lr_dot(n, n));
    if (!(area > 0 && isfinite(area)))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have two finite sides that span an area", k);
    return LR_OK;
}
