/* Lights: what all types have in common, and per function a switch over the types, so that calls
 * are direct.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/lights/light.h"

#include "base/error.h"
#include "render/lights/light_type.h"

enum {
    N_TYPES = 0
#define LR_LIGHT_TYPE(kind, name) +1
#include "render/lights/lights.def"
#undef LR_LIGHT_TYPE
};

static lr_status check_type(const lr_light *light, uint64_t i, lr_error *error)
{
    switch (light->kind) {
#define LR_LIGHT_TYPE(type, name)                                                                  \
    case type:                                                                                     \
        return lr_##name##_light_check(light, i, error);
#include "render/lights/lights.def"
#undef LR_LIGHT_TYPE
    }
    return lr_fail(error, LR_E_ARGUMENT, "light %llu must be of kind 0 to %d, it is %d",
                   (unsigned long long)i, N_TYPES - 1, light->kind);
}

lr_status lr_light_check(const lr_light *light, uint64_t i, lr_error *error)
{
    const double *c = light->color;
    if (!lr_all_finite(c, 3))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a finite color, it has (%g, %g, %g)",
                       (unsigned long long)i, c[0], c[1], c[2]);
    if (light->max_bounces < 0)
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a limit of bounces of 0 or more, it has %d",
                       (unsigned long long)i, light->max_bounces);
    return check_type(light, i, error);
}

bool lr_light_has_extent(const lr_light *light)
{
    switch (light->kind) {
#define LR_LIGHT_TYPE(type, name)                                                                  \
    case type:                                                                                     \
        return lr_##name##_light_has_extent(light);
#include "render/lights/lights.def"
#undef LR_LIGHT_TYPE
    }
    return false;
}

void lr_light_bound(const lr_light *light, lr_light_bounds *bounds)
{
    switch (light->kind) {
#define LR_LIGHT_TYPE(type, name)                                                                  \
    case type:                                                                                     \
        lr_##name##_light_bound(light, bounds);                                                    \
        return;
#include "render/lights/lights.def"
#undef LR_LIGHT_TYPE
    }
}

bool lr_light_sample(const lr_light *light, const double p[3], const double u[2], lr_light_ray *ray)
{
    ray->delta = false;
    switch (light->kind) {
#define LR_LIGHT_TYPE(type, name)                                                                  \
    case type:                                                                                     \
        return lr_##name##_light_sample(light, p, u, ray);
#include "render/lights/lights.def"
#undef LR_LIGHT_TYPE
    }
    return false;
}

bool lr_light_hit(const lr_light *light, const double o[3], const double d[3], double t_max,
                  double *t, double color[3], double *pdf)
{
    switch (light->kind) {
#define LR_LIGHT_TYPE(type, name)                                                                  \
    case type:                                                                                     \
        return lr_##name##_light_hit(light, o, d, t_max, t, color, pdf);
#include "render/lights/lights.def"
#undef LR_LIGHT_TYPE
    }
    return false;
}
