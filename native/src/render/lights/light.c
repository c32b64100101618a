/* Lights.
 *
 * A sun is a disc of even radiance; point and spot lights are spheres, or discs
 * that turn to what they light, so that their radiance is their intensity over
 * pi radius^2. Spheres and suns are sampled evenly by the solid angle in which they
 * are seen, discs by their area. Area lights: area_light.c.
 *
 * Source: the lights of Blender's manual; their units and fading were measured in
 * Cycles (tests/addon/test_shading_cycles.py).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/lights/light.h"

#include "base/error.h"
#include "render/lights/area_light.h"

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
    if (!lr_all_finite(c, 3))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a finite color, it has (%g, %g, %g)", k, c[0], c[1],
                       c[2]);
    if (light->max_bounces < 0)
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a limit of bounces of 0 or more, it has %d", k,
                       light->max_bounces);
    if (light->kind != LR_LIGHT_SUN && !lr_all_finite(light->position, 3))
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have a finite position", k);
    const double length = sqrt(lr_dot(d, d));
    if (light->kind != LR_LIGHT_POINT && !(fabs(length - 1) < 1e-3)) /* f32 may have been at work */
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a direction of length 1, it has %g", k, length);
    if (!(light->radius >= 0 && isfinite(light->radius)))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a finite radius of 0 or more, it has %g", k,
                       light->radius);
    if (!(light->angle >= 0 && light->angle <= LR_PI * (1 + 1e-6)))
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have an angle of 0 to pi, it has %g",
                       k, light->angle);
    if (!(light->blend >= 0 && light->blend <= 1))
        return lr_fail(error, LR_E_ARGUMENT, "light %llu must have a blend of 0 to 1, it has %g", k,
                       light->blend);
    if (light->kind != LR_LIGHT_AREA)
        return LR_OK;
    if (!isfinite(light->plane_margin))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a finite plane margin, it has %g", k,
                       light->plane_margin);
    const double *u = light->axis_u, *v = light->axis_v;
    const double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                         u[0] * v[1] - u[1] * v[0]};
    const double area = sqrt(lr_dot(n, n));
    if (!(area > 0 && isfinite(area)))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have two finite sides that span an area", k);
    return LR_OK;
}

/* ---- radiance ------------------------------------------------------------- */

static double smoothstep(double x)
{
    const double y = lr_clamp(x, 0, 1);
    return y * y * (3 - 2 * y);
}

/* What a spot lets out along d, which leads to it, as a share of its color. */
static double let_out(const lr_light *light, const double d[3])
{
    if (light->kind != LR_LIGHT_SPOT)
        return 1;
    const double cosine = -lr_dot(d, light->direction), edge = cos(0.5 * light->angle);
    if (!(cosine > edge))
        return 0;
    const double fade = (1 - edge) * light->blend;
    return fade > 0 ? smoothstep((cosine - edge) / fade) : 1;
}

/* color x scale x what is let out; false where that is nothing. */
static bool shine(const lr_light *light, const double d[3], double scale, double color[3])
{
    const double share = scale * let_out(light, d);
    for (int a = 0; a < 3; a++)
        color[a] = share * light->color[a];
    return share > 0;
}

/* 1 - cosine of half the sun's disc, without cancellation. */
static double sun_cap(const lr_light *light)
{
    const double s = sin(0.25 * light->angle);
    return 2 * s * s;
}

static double sun_scale(const lr_light *light)
{
    const double s = sin(0.5 * light->angle);
    return 1 / (LR_PI * s * s);
}

double lr_light_intensity(const lr_light *light)
{
    return light->kind == LR_LIGHT_AREA ? lr_area_light_intensity(light) : 1;
}

/* ---- sampling ------------------------------------------------------------- */

/* Basis: Duff et al., Building an orthonormal basis, revisited, 2017. */
static void basis(const double n[3], double s[3], double t[3])
{
    const double sign = copysign(1.0, n[2]);
    const double a = -1 / (sign + n[2]), b = n[0] * n[1] * a;
    s[0] = 1 + sign * n[0] * n[0] * a;
    s[1] = sign * b;
    s[2] = -sign * n[0];
    t[0] = b;
    t[1] = sign + n[1] * n[1] * a;
    t[2] = -n[1];
}

/* A direction within the cap of that height (1 - cosine) about the unit vector n. */
static void sample_cap(const double n[3], double height, const double u[2], double d[3])
{
    double s[3], t[3];
    basis(n, s, t);
    const double low = u[0] * height, r = sqrt(fmax(low * (2 - low), 0));
    const double x = r * cos(2 * LR_PI * u[1]), y = r * sin(2 * LR_PI * u[1]);
    for (int a = 0; a < 3; a++)
        d[a] = x * s[a] + y * t[a] + (1 - low) * n[a];
}

/* Aim at a point q of a surface with normal n; false where it is seen edge-on. */
static bool aim(const double p[3], const double q[3], const double n[3], double area,
                lr_light_ray *ray)
{
    double to[3];
    for (int a = 0; a < 3; a++)
        to[a] = q[a] - p[a];
    const double square = lr_dot(to, to);
    ray->distance = sqrt(square);
    for (int a = 0; a < 3; a++)
        ray->direction[a] = to[a] / ray->distance;
    ray->pdf = square / (area * fabs(lr_dot(ray->direction, n)));
    return ray->pdf > 0 && ray->pdf < INFINITY;
}

/* From outside a sphere the cap in which it is seen, from inside all around; where the
 * ray leaves through the sphere, it is seen. */
static double sphere_cap(double radius, double square)
{
    const double s2 = radius * radius / square;
    return s2 < 1 ? s2 / (1 + sqrt(1 - s2)) : 2;
}

/* Distance along d (unit) to a sphere at `to` from the origin; negative where it is missed. */
static double meet_sphere(const double to[3], double radius, const double d[3])
{
    const double along = lr_dot(to, d);
    double off[3];
    for (int a = 0; a < 3; a++)
        off[a] = to[a] - along * d[a];
    const double reach = radius * radius - lr_dot(off, off);
    if (reach < 0)
        return -1;
    const bool outside = lr_dot(to, to) > radius * radius;
    return along - (outside ? sqrt(reach) : -sqrt(reach));
}

static bool sample_bulb(const lr_light *light, const double p[3], const double u[2],
                        lr_light_ray *ray)
{
    double to[3], n[3];
    for (int a = 0; a < 3; a++)
        to[a] = light->position[a] - p[a];
    const double square = lr_dot(to, to), distance = sqrt(square), r = light->radius;
    if (!(square > 0) || !(square < INFINITY))
        return false;
    for (int a = 0; a < 3; a++)
        n[a] = to[a] / distance;
    if (r == 0) {
        ray->delta = true;
        ray->pdf = 1;
        ray->distance = distance;
        memcpy(ray->direction, n, sizeof n);
        return shine(light, n, 1 / square, ray->color);
    }
    if (light->shape == LR_LIGHT_FULL) {
        const double cap = sphere_cap(r, square);
        sample_cap(n, cap, u, ray->direction);
        ray->pdf = 1 / (2 * LR_PI * cap);
        ray->distance = meet_sphere(to, r, ray->direction);
        if (ray->distance < 0) /* by rounding, at the rim */
            ray->distance = distance;
    } else {
        double s[3], t[3], q[3];
        basis(n, s, t);
        const double off = r * sqrt(u[0]);
        const double x = off * cos(2 * LR_PI * u[1]), y = off * sin(2 * LR_PI * u[1]);
        for (int a = 0; a < 3; a++)
            q[a] = light->position[a] + x * s[a] + y * t[a];
        if (!aim(p, q, n, LR_PI * r * r, ray))
            return false;
    }
    return shine(light, ray->direction, 1 / (LR_PI * r * r), ray->color);
}

bool lr_light_sample(const lr_light *light, const double p[3], const double u[2], lr_light_ray *ray)
{
    ray->delta = false;
    if (light->kind == LR_LIGHT_AREA)
        return lr_area_light_sample(light, p, u, ray);
    if (light->kind != LR_LIGHT_SUN)
        return sample_bulb(light, p, u, ray);
    ray->distance = INFINITY;
    ray->delta = light->angle == 0;
    ray->pdf = 1;
    if (ray->delta) {
        memcpy(ray->direction, light->direction, sizeof ray->direction);
        return shine(light, ray->direction, 1, ray->color);
    }
    sample_cap(light->direction, sun_cap(light), u, ray->direction);
    ray->pdf = 1 / (2 * LR_PI * sun_cap(light));
    return shine(light, ray->direction, sun_scale(light), ray->color);
}

/* ---- rays that meet lights ------------------------------------------------ */

static bool hit_sun(const lr_light *light, const double d[3], double t_max, double *t,
                    double color[3], double *pdf)
{
    double off[3];
    for (int a = 0; a < 3; a++)
        off[a] = d[a] - light->direction[a];
    /* The chord of the angle between them: no cancellation. */
    const double cap = sun_cap(light);
    if (light->angle == 0 || t_max < INFINITY || 0.5 * lr_dot(off, off) > cap)
        return false;
    *t = INFINITY;
    *pdf = 1 / (2 * LR_PI * cap);
    return shine(light, d, sun_scale(light), color);
}

static bool hit_bulb(const lr_light *light, const double o[3], const double d[3], double *t,
                     double color[3], double *pdf)
{
    double to[3];
    const double r = light->radius;
    for (int a = 0; a < 3; a++)
        to[a] = light->position[a] - o[a];
    const double square = lr_dot(to, to);
    if (r == 0 || !(square > 0))
        return false;
    if (light->shape == LR_LIGHT_FULL) {
        *t = meet_sphere(to, r, d);
        *pdf = 1 / (2 * LR_PI * sphere_cap(r, square));
    } else {
        const double cosine = lr_dot(to, d) / sqrt(square);
        *t = sqrt(square) / cosine;
        if (!(cosine > 0) || *t * *t - square > r * r)
            return false;
        *pdf = *t * *t / (LR_PI * r * r * cosine);
    }
    return *t > 0 && shine(light, d, 1 / (LR_PI * r * r), color);
}

bool lr_light_hit(const lr_light *light, const double o[3], const double d[3], double t_max,
                  double *t, double color[3], double *pdf)
{
    switch (light->kind) {
    case LR_LIGHT_SUN:
        return hit_sun(light, d, t_max, t, color, pdf);
    case LR_LIGHT_AREA:
        return lr_area_light_hit(light, o, d, t, color, pdf) && *t < t_max;
    default:
        return hit_bulb(light, o, d, t, color, pdf) && *t < t_max;
    }
}
