/* Point lights: a ball that emits alike to all sides. Its color is the radiant intensity.
 *
 * Source: the lights of Blender's manual; their units were measured in Cycles
 * (tests/addon/test_shading_cycles.py).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/lights/light_fields.h"
#include "render/lights/light_geometry.h"
#include "render/lights/light_type.h"

lr_status lr_point_light_check(const lr_light *light, uint64_t i, lr_error *error)
{
    const int fields = LR_FIELD_POSITION | LR_FIELD_SHAPE | LR_FIELD_RADIUS;
    return lr_light_fields_check(light, i, fields, error);
}

bool lr_point_light_has_extent(const lr_light *light)
{
    return light->radius > 0;
}

void lr_point_light_bound(const lr_light *light, lr_light_bounds *bounds)
{
    *bounds = (lr_light_bounds){
        .axis = {0, 0, 1}, .cos_facing = -1, .power = lr_brightness(light->color)};
    const double half[3] = {light->radius, light->radius, light->radius};
    lr_light_box(light, half, bounds);
}

bool lr_point_light_sample(const lr_light *light, const double p[3], const double u[2],
                           lr_light_ray *ray)
{
    return lr_light_color(light, lr_ball_sample(light, p, u, ray), ray->color);
}

bool lr_point_light_hit(const lr_light *light, const double o[3], const double d[3], double t_max,
                        double *t, double color[3], double *pdf)
{
    return lr_ball_hit(light, o, d, t_max, t, pdf) &&
           lr_light_color(light, lr_ball_radiance(light), color);
}
