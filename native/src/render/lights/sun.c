/* Suns: a disc of constant radiance, sampled uniformly by solid angle. Its color is the
 * irradiance at right angles, whatever the sun's own angle.
 *
 * Source: the lights of Blender's manual.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/lights/light_fields.h"
#include "render/lights/light_geometry.h"
#include "render/lights/light_type.h"

lr_status lr_sun_light_check(const lr_light *light, uint64_t i, lr_error *error)
{
    return lr_light_fields_check(light, i, LR_FIELD_DIRECTION | LR_FIELD_ANGLE, error);
}

bool lr_sun_light_has_extent(const lr_light *light)
{
    return light->angle > 0;
}

void lr_sun_light_bound(const lr_light *light, lr_light_bounds *bounds)
{
    *bounds = (lr_light_bounds){
        .axis = {light->direction[0], light->direction[1], light->direction[2]},
        .cos_facing = cos(0.5 * light->angle),
        .power = lr_brightness(light->color),
        .distant = true,
    };
}

/* 1 - cosine of half the disc, without cancellation. */
static double cap_of(const lr_light *light)
{
    const double s = sin(0.25 * light->angle);
    return 2 * s * s;
}

static double radiance(const lr_light *light)
{
    const double s = sin(0.5 * light->angle);
    return 1 / (LR_PI * s * s);
}

bool lr_sun_light_sample(const lr_light *light, const double p[3], const double u[2],
                         lr_light_ray *ray)
{
    (void)p;
    ray->distance = INFINITY;
    ray->delta = light->angle == 0;
    ray->pdf = 1;
    if (ray->delta) {
        memcpy(ray->direction, light->direction, sizeof ray->direction);
        return lr_light_color(light, 1, ray->color);
    }
    lr_cap_sample(light->direction, cap_of(light), u, ray->direction);
    ray->pdf = lr_cap_pdf(cap_of(light));
    return lr_light_color(light, radiance(light), ray->color);
}

bool lr_sun_light_hit(const lr_light *light, const double o[3], const double d[3], double t_max,
                      double *t, double color[3], double *pdf)
{
    (void)o;
    double off[3];
    for (int a = 0; a < 3; a++)
        off[a] = d[a] - light->direction[a];
    /* The chord of the angle between them: no cancellation. */
    const double cap = cap_of(light);
    if (light->angle == 0 || t_max < INFINITY || 0.5 * lr_dot(off, off) > cap)
        return false;
    *t = INFINITY;
    *pdf = lr_cap_pdf(cap);
    return lr_light_color(light, radiance(light), color);
}
