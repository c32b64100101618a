/* Geometry that types of lights share: caps of directions, and the ball of point and spot
 * lights.
 *
 * A ball is a sphere, or a disc that faces the lit point; either has the radiance
 * intensity / (pi radius^2). Spheres are sampled uniformly by their solid angle, discs by
 * their area.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_LIGHTS_LIGHT_GEOMETRY_H
#define LR_RENDER_LIGHTS_LIGHT_GEOMETRY_H

#include "render/lights/light_ray.h"

/* A light's color x scale; false where that is 0. */
LR_INLINE bool lr_light_color(const lr_light *light, double scale, double color[3])
{
    for (int a = 0; a < 3; a++)
        color[a] = scale * light->color[a];
    return scale > 0;
}

/* A direction within the cap of that height (1 - cosine) about the unit vector n. */
LR_INLINE void lr_cap_sample(const double n[3], double height, const double u[2], double d[3])
{
    double s[3], t[3];
    lr_orthonormal_basis(n, s, t);
    const double low = u[0] * height, r = sqrt(fmax(low * (2 - low), 0));
    const double x = r * cos(2 * LR_PI * u[1]), y = r * sin(2 * LR_PI * u[1]);
    for (int a = 0; a < 3; a++)
        d[a] = x * s[a] + y * t[a] + (1 - low) * n[a];
}

/* Density of a uniformly sampled cap, per solid angle. */
LR_INLINE double lr_cap_pdf(double height)
{
    return 1 / (2 * LR_PI * height);
}

/* Height of the cap of directions to a sphere: from inside, all directions. */
LR_INLINE double lr_sphere_cap(double radius, double square)
{
    const double s2 = radius * radius / square;
    return s2 < 1 ? s2 / (1 + sqrt(1 - s2)) : 2;
}

/* Distance along d (unit) to a sphere at `to` from the origin; negative where it is missed. */
LR_INLINE double lr_sphere_meet(const double to[3], double radius, const double d[3])
{
    const double along = lr_dot(to, d);
    double off[3];
    for (int a = 0; a < 3; a++)
        off[a] = to[a] - along * d[a];
    const double half_chord2 = radius * radius - lr_dot(off, off);
    if (half_chord2 < 0)
        return -1;
    const bool outside = lr_dot(to, to) > radius * radius;
    return along - (outside ? sqrt(half_chord2) : -sqrt(half_chord2));
}

/* Aim at a point q of a surface with normal n; false where it is seen edge-on. */
LR_INLINE bool lr_aim_at_surface(const double p[3], const double q[3], const double n[3],
                                 double area, lr_light_ray *ray)
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

LR_INLINE double lr_ball_radiance(const lr_light *light)
{
    return 1 / (LR_PI * light->radius * light->radius);
}

/* Sample a ray from p to the ball, but for its color. Returns the factor of color; 0 where p is
 * not lit. */
LR_INLINE double lr_ball_sample(const lr_light *light, const double p[3], const double u[2],
                                lr_light_ray *ray)
{
    double to[3], n[3];
    for (int a = 0; a < 3; a++)
        to[a] = light->position[a] - p[a];
    const double square = lr_dot(to, to), distance = sqrt(square), r = light->radius;
    if (!(square > 0) || !(square < INFINITY))
        return 0;
    for (int a = 0; a < 3; a++)
        n[a] = to[a] / distance;
    if (r == 0) {
        ray->delta = true;
        ray->pdf = 1;
        ray->distance = distance;
        memcpy(ray->direction, n, sizeof n);
        return 1 / square;
    }
    if (light->shape == LR_LIGHT_FULL) {
        const double cap = lr_sphere_cap(r, square);
        lr_cap_sample(n, cap, u, ray->direction);
        ray->pdf = lr_cap_pdf(cap);
        ray->distance = lr_sphere_meet(to, r, ray->direction);
        if (ray->distance < 0) /* by rounding, at the rim */
            ray->distance = distance;
        return lr_ball_radiance(light);
    }
    double s[3], t[3], q[3];
    lr_orthonormal_basis(n, s, t);
    const double off = r * sqrt(u[0]);
    const double x = off * cos(2 * LR_PI * u[1]), y = off * sin(2 * LR_PI * u[1]);
    for (int a = 0; a < 3; a++)
        q[a] = light->position[a] + x * s[a] + y * t[a];
    return lr_aim_at_surface(p, q, n, LR_PI * r * r, ray) ? lr_ball_radiance(light) : 0;
}

/* Intersect a ray with the ball, as lr_light_hit; the light's color x lr_ball_radiance is its
 * radiance. */
LR_INLINE bool lr_ball_hit(const lr_light *light, const double o[3], const double d[3],
                           double t_max, double *t, double *pdf)
{
    double to[3];
    const double r = light->radius;
    for (int a = 0; a < 3; a++)
        to[a] = light->position[a] - o[a];
    const double square = lr_dot(to, to);
    if (r == 0 || !(square > 0))
        return false;
    if (light->shape == LR_LIGHT_FULL) {
        *t = lr_sphere_meet(to, r, d);
        *pdf = lr_cap_pdf(lr_sphere_cap(r, square));
    } else {
        const double cosine = lr_dot(to, d) / sqrt(square);
        *t = sqrt(square) / cosine;
        if (!(cosine > 0) || *t * *t - square > r * r)
            return false;
        *pdf = *t * *t / (LR_PI * r * r * cosine);
    }
    return *t > 0 && *t < t_max;
}

/* The box of a light of this half extent on each axis. */
LR_INLINE void lr_light_box(const lr_light *light, const double half[3], lr_light_bounds *bounds)
{
    for (int a = 0; a < 3; a++) {
        bounds->lo[a] = light->position[a] - half[a];
        bounds->hi[a] = light->position[a] + half[a];
    }
}

#endif
