/* Lights.
 *
 * A sun is a disc of even radiance; point and spot lights are spheres, or discs
 * that turn to what they light, so that their radiance is their intensity over
 * pi radius^2. Area lights obey Lambert's law; a narrower spread is that of a grid
 * of slats before them, brightened so that as much light leaves as without it.
 *
 * Rectangles are sampled evenly by the solid angle in which they are seen, all other
 * surfaces by their area.
 *
 * Source: the lights of Blender's manual; their units and fading were measured in
 * Cycles (tests/test_shading_cycles.py). Urena, Fajardo, King, An area-preserving
 * parametrization for spherical rectangles, 2013.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/light.h"

#include "error.h"

static const double PI = 3.141592653589793;

/* The cosine beyond which slats of any grid let everything through. */
static const double SPREAD_FULL = 1e-6;

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
    if (!lr_all_finite(c, 3) || !(c[0] >= 0 && c[1] >= 0 && c[2] >= 0))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a finite color of 0 or more, it has (%g, %g, %g)", k,
                       c[0], c[1], c[2]);
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

/* ---- radiance ------------------------------------------------------------- */

static double smoothstep(double x)
{
    const double y = lr_clamp(x, 0, 1);
    return y * y * (3 - 2 * y);
}

/* What a spot or area light lets out along d, which leads to it, as a share of its color. */
static double let_out(const lr_light *light, const double d[3])
{
    const double cosine = -lr_dot(d, light->direction);
    const double half = 0.5 * light->angle;
    if (light->kind == LR_LIGHT_SPOT) {
        const double edge = cos(half);
        if (!(cosine > edge))
            return 0;
        const double fade = (1 - edge) * light->blend;
        return fade > 0 ? smoothstep((cosine - edge) / fade) : 1;
    }
    if (light->kind != LR_LIGHT_AREA)
        return 1;
    if (!(cosine > 0))
        return 0;
    if (cos(half) < SPREAD_FULL)
        return 1;
    const double steepest = tan(half);
    const double slope = sqrt(fmax(1 - cosine * cosine, 0)) / cosine;
    return half > 0 ? fmax(steepest - slope, 0) / (steepest - half) : 0;
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
    return 1 / (PI * s * s);
}

static double area_of(const lr_light *light)
{
    const double *u = light->axis_u, *v = light->axis_v;
    const double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                         u[0] * v[1] - u[1] * v[0]};
    return sqrt(lr_dot(n, n)) * (light->shape == LR_LIGHT_ROUND ? PI / 4 : 1);
}

double lr_light_intensity(const lr_light *light)
{
    const double *n = light->direction, against[3] = {-n[0], -n[1], -n[2]};
    return light->kind == LR_LIGHT_AREA ? area_of(light) * let_out(light, against) : 1;
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
    const double x = r * cos(2 * PI * u[1]), y = r * sin(2 * PI * u[1]);
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
        ray->pdf = 1 / (2 * PI * cap);
        ray->distance = meet_sphere(to, r, ray->direction);
        if (ray->distance < 0) /* by rounding, at the rim */
            ray->distance = distance;
    } else {
        double s[3], t[3], q[3];
        basis(n, s, t);
        const double off = r * sqrt(u[0]);
        const double x = off * cos(2 * PI * u[1]), y = off * sin(2 * PI * u[1]);
        for (int a = 0; a < 3; a++)
            q[a] = light->position[a] + x * s[a] + y * t[a];
        if (!aim(p, q, n, PI * r * r, ray))
            return false;
    }
    return shine(light, ray->direction, 1 / (PI * r * r), ray->color);
}

/* A rectangle as seen from the origin of a frame along its sides, its plane below. */
typedef struct lr_seen_rectangle {
    double axis[3][3], x0, x1, y0, y1, z;
    double b0, b1, k, angle; /* names of the source; angle: solid */
} lr_seen_rectangle;

/* Below it the excess of the angles is inexact, and a rectangle is as good as flat. */
static const double ANGLE_MIN = 1e-4;

/* The cosine of a plane through the origin and a side at that height. */
static double tilt(double side, double z)
{
    return side / sqrt(side * side + z * z);
}

/* False where the area light is no rectangle, or is seen as too small. */
static bool see_rectangle(const lr_light *light, const double p[3], lr_seen_rectangle *r)
{
    const double *u = light->axis_u, *v = light->axis_v;
    const double length_u = sqrt(lr_dot(u, u)), length_v = sqrt(lr_dot(v, v));
    if (light->shape != LR_LIGHT_FULL || fabs(lr_dot(u, v)) > 1e-6 * length_u * length_v)
        return false;
    double to[3];
    for (int a = 0; a < 3; a++) {
        r->axis[0][a] = u[a] / length_u;
        r->axis[1][a] = v[a] / length_v;
        to[a] = light->position[a] - p[a];
    }
    const double *x = r->axis[0], *y = r->axis[1];
    const double n[3] = {x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2],
                         x[0] * y[1] - x[1] * y[0]};
    const double height = lr_dot(to, n);
    for (int a = 0; a < 3; a++)
        r->axis[2][a] = height > 0 ? -n[a] : n[a];
    r->z = -fabs(height);
    if (r->z == 0)
        return false;
    r->x0 = lr_dot(to, x) - 0.5 * length_u;
    r->x1 = r->x0 + length_u;
    r->y0 = lr_dot(to, y) - 0.5 * length_v;
    r->y1 = r->y0 + length_v;
    const double n0 = -tilt(r->y0, r->z), n1 = tilt(r->x1, r->z);
    const double n2 = tilt(r->y1, r->z), n3 = -tilt(r->x0, r->z);
    r->b0 = n0;
    r->b1 = n2;
    r->k = 2 * PI - acos(-n2 * n3) - acos(-n3 * n0);
    r->angle = acos(-n0 * n1) + acos(-n1 * n2) - r->k;
    return r->angle > ANGLE_MIN;
}

/* The point of the rectangle for u, from the origin of its frame. */
static void point_of(const lr_seen_rectangle *r, const double u[2], double to[3])
{
    const double a = u[0] * r->angle + r->k;
    const double f = (cos(a) * r->b0 - r->b1) / sin(a);
    const double c = lr_clamp(copysign(1 / sqrt(f * f + r->b0 * r->b0), f), -1, 1);
    const double x = lr_clamp(-c * r->z / sqrt(fmax(1 - c * c, 1e-300)), r->x0, r->x1);
    const double d = sqrt(x * x + r->z * r->z);
    const double h0 = tilt(r->y0, d), h1 = tilt(r->y1, d), h = h0 + u[1] * (h1 - h0);
    const double y = lr_clamp(h * d / sqrt(fmax(1 - h * h, 1e-300)), r->y0, r->y1);
    for (int k = 0; k < 3; k++)
        to[k] = x * r->axis[0][k] + y * r->axis[1][k] + r->z * r->axis[2][k];
}

static bool sample_rectangle(const lr_light *light, const lr_seen_rectangle *seen,
                             const double u[2], lr_light_ray *ray)
{
    double to[3];
    point_of(seen, u, to);
    ray->distance = sqrt(lr_dot(to, to));
    ray->pdf = 1 / seen->angle;
    for (int a = 0; a < 3; a++)
        ray->direction[a] = to[a] / ray->distance;
    return shine(light, ray->direction, 1, ray->color);
}

static bool sample_area(const lr_light *light, const double p[3], const double u[2],
                        lr_light_ray *ray)
{
    lr_seen_rectangle seen;
    if (see_rectangle(light, p, &seen))
        return sample_rectangle(light, &seen, u, ray);
    double x = u[0] - 0.5, y = u[1] - 0.5, q[3];
    if (light->shape == LR_LIGHT_ROUND) {
        const double r = 0.5 * sqrt(u[0]);
        x = r * cos(2 * PI * u[1]);
        y = r * sin(2 * PI * u[1]);
    }
    for (int a = 0; a < 3; a++)
        q[a] = light->position[a] + x * light->axis_u[a] + y * light->axis_v[a];
    return aim(p, q, light->direction, area_of(light), ray) &&
           shine(light, ray->direction, 1, ray->color);
}

bool lr_light_sample(const lr_light *light, const double p[3], const double u[2], lr_light_ray *ray)
{
    ray->delta = false;
    if (light->kind == LR_LIGHT_AREA)
        return sample_area(light, p, u, ray);
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
    ray->pdf = 1 / (2 * PI * sun_cap(light));
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
    *pdf = 1 / (2 * PI * cap);
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
        *pdf = 1 / (2 * PI * sphere_cap(r, square));
    } else {
        const double cosine = lr_dot(to, d) / sqrt(square);
        *t = sqrt(square) / cosine;
        if (!(cosine > 0) || *t * *t - square > r * r)
            return false;
        *pdf = *t * *t / (PI * r * r * cosine);
    }
    return *t > 0 && shine(light, d, 1 / (PI * r * r), color);
}

static bool hit_area(const lr_light *light, const double o[3], const double d[3], double *t,
                     double color[3], double *pdf)
{
    const double *u = light->axis_u, *v = light->axis_v;
    const double cosine = -lr_dot(d, light->direction);
    double q[3];
    if (!(cosine > 0))
        return false;
    for (int a = 0; a < 3; a++)
        q[a] = o[a] - light->position[a];
    *t = lr_dot(q, light->direction) / cosine;
    for (int a = 0; a < 3; a++)
        q[a] += *t * d[a];
    const double uu = lr_dot(u, u), vv = lr_dot(v, v), uv = lr_dot(u, v);
    const double qu = lr_dot(q, u), qv = lr_dot(q, v), det = uu * vv - uv * uv;
    const double x = (qu * vv - qv * uv) / det, y = (qv * uu - qu * uv) / det;
    const bool inside =
        light->shape == LR_LIGHT_ROUND ? x * x + y * y <= 0.25 : fabs(x) <= 0.5 && fabs(y) <= 0.5;
    if (!(*t > 0) || !inside)
        return false;
    lr_seen_rectangle seen;
    *pdf = see_rectangle(light, o, &seen) ? 1 / seen.angle : *t * *t / (area_of(light) * cosine);
    return shine(light, d, 1, color);
}

bool lr_light_hit(const lr_light *light, const double o[3], const double d[3], double t_max,
                  double *t, double color[3], double *pdf)
{
    switch (light->kind) {
    case LR_LIGHT_SUN:
        return hit_sun(light, d, t_max, t, color, pdf);
    case LR_LIGHT_AREA:
        return hit_area(light, o, d, t, color, pdf) && *t < t_max;
    default:
        return hit_bulb(light, o, d, t, color, pdf) && *t < t_max;
    }
}
