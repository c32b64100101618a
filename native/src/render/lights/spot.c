/* Spot lights: a ball that emits within a cone and fades towards its edge. Its color is the radiant
 * intensity on the axis.
 *
 * Source: the lights of Blender's manual; their units and fading were measured in Cycles
 * (tests/addon/test_shading_cycles.py).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "render/lights/light_fields.h"
#include "render/lights/light_geometry.h"
#include "render/lights/light_type.h"

lr_status lr_spot_light_check(const lr_light *light, uint64_t i, lr_error *error)
{
    const int fields =
        LR_FIELD_POSITION | LR_FIELD_DIRECTION | LR_FIELD_SHAPE | LR_FIELD_RADIUS | LR_FIELD_ANGLE;
    if (!(light->blend >= 0 && light->blend <= 1))
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have a blend of 0 to 1, it has %g",
                       (unsigned long long)i, light->blend);
    return lr_light_fields_check(light, i, fields, error);
}

bool lr_spot_light_has_extent(const lr_light *light)
{
    return light->radius > 0;
}

void lr_spot_light_bound(const lr_light *light, lr_light_bounds *bounds)
{
    *bounds = (lr_light_bounds){
        .axis = {light->direction[0], light->direction[1], light->direction[2]},
        .cos_facing = 1,
        .cos_emission = fmax(cos(0.5 * light->angle), 0),
        .power = lr_brightness(light->color),
    };
    const double half[3] = {light->radius, light->radius, light->radius};
    lr_light_box(light, half, bounds);
}

static double smoothstep(double x)
{
    const double y = lr_clamp(x, 0, 1);
    return y * y * (3 - 2 * y);
}

/* The fraction of the intensity along d, which leads to the light. */
static double let_out(const lr_light *light, const double d[3])
{
    const double cosine = -lr_dot(d, light->direction), edge = cos(0.5 * light->angle);
    if (!(cosine > edge))
        return 0;
    const double fade = (1 - edge) * light->blend;
    return fade > 0 ? smoothstep((cosine - edge) / fade) : 1;
}

bool lr_spot_light_sample(const lr_light *light, const double p[3], const double u[2],
                          lr_light_ray *ray)
{
    const double scale = lr_ball_sample(light, p, u, ray);
    return scale > 0 && lr_light_color(light, scale * let_out(light, ray->direction), ray->color);
}

bool lr_spot_light_hit(const lr_light *light, const double o[3], const double d[3], double t_max,
                       double *t, double color[3], double *pdf)
{
    return lr_ball_hit(light, o, d, t_max, t, pdf) &&
           lr_light_color(light, lr_ball_radiance(light) * let_out(light, d), color);
}
