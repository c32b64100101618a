/* Area lights.
 *
 * A rectangle or an ellipse that emits to one side by Lambert's law. A narrower
 * spread acts as a grid of slats before it, brightened to keep the power; a point sees
 * through the slats only the part of the light within a disc about the foot of its
 * perpendicular. A spread of 0 collimates the light: every point is lit from its foot alone.
 *
 * Only the visible part is sampled: rectangles uniformly by the solid angle of the box
 * around the intersection of light and disc, ellipses by the smallest of that box, the disc
 * and themselves.
 *
 * The sides of a sheared light are not at right angles, nor is its direction to them.
 * Coordinates are products with the sides, as if they were; Cycles does the same.
 *
 * Source: the lights of Blender's manual; units and spread were measured in Cycles.
 * Urena, Fajardo, King, An area-preserving parametrization for spherical rectangles,
 * 2013.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "render/lights/light_fields.h"
#include "render/lights/light_geometry.h"
#include "render/lights/light_type.h"

/* From this spread on, slats stop nothing. */
static const double SPREAD_FULL = LR_PI - 2e-6;
/* Half a spread below which tan(h) - h loses digits; h^3 / 3 is right to 1e-8. */
static const double SPREAD_THIN = 1e-4;

lr_status lr_area_light_check(const lr_light *light, uint64_t i, lr_error *error)
{
    const int fields = LR_FIELD_POSITION | LR_FIELD_DIRECTION | LR_FIELD_SHAPE | LR_FIELD_ANGLE;
    double n[3];
    lr_cross_product(light->axis_u, light->axis_v, n);
    const double area = sqrt(lr_dot(n, n));
    if (!(area > 0 && isfinite(area)))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have two finite sides that span an area",
                       (unsigned long long)i);
    if (!isfinite(light->plane_margin))
        return lr_fail(error, LR_E_ARGUMENT,
                       "light %llu must have a finite plane margin, it has %g",
                       (unsigned long long)i, light->plane_margin);
    return lr_light_fields_check(light, i, fields, error);
}

bool lr_area_light_has_extent(const lr_light *light)
{
    return light->angle > 0;
}

/* ---- radiance ------------------------------------------------------------- */

static bool is_full(const lr_light *light)
{
    return light->angle >= SPREAD_FULL;
}

/* What leaves along d, which leads to the light, as a fraction of its color; spread > 0. */
static double let_out(const lr_light *light, const double d[3])
{
    const double cosine = -lr_dot(d, light->direction);
    if (!(cosine > 0))
        return 0;
    if (is_full(light))
        return 1;
    const double half = 0.5 * light->angle, steepest = tan(half);
    const double slope = sqrt(fmax(1 - cosine * cosine, 0)) / cosine;
    const double lost = half > SPREAD_THIN ? steepest - half : half * half * half / 3;
    return fmax(steepest - slope, 0) / lost;
}

static double area_of(const lr_light *light)
{
    const double *u = light->axis_u, *v = light->axis_v;
    return sqrt(lr_dot(u, u) * lr_dot(v, v)) * (light->shape == LR_LIGHT_ROUND ? LR_PI / 4 : 1);
}

/* The radiant intensity where it is largest, as a multiple of color. */
static double intensity(const lr_light *light)
{
    const double *n = light->direction, against[3] = {-n[0], -n[1], -n[2]};
    return area_of(light) * (light->angle > 0 ? let_out(light, against) : LR_PI);
}

void lr_area_light_bound(const lr_light *light, lr_light_bounds *bounds)
{
    double half[3];
    for (int a = 0; a < 3; a++) {
        const double u = 0.5 * light->axis_u[a], v = 0.5 * light->axis_v[a];
        half[a] = light->shape == LR_LIGHT_ROUND ? hypot(u, v) : fabs(u) + fabs(v);
    }
    *bounds = (lr_light_bounds){
        .axis = {light->direction[0], light->direction[1], light->direction[2]},
        .cos_facing = 1,
        .cos_emission = fmax(cos(0.5 * light->angle), 0),
        .power = lr_brightness(light->color) * intensity(light),
    };
    lr_light_box(light, half, bounds);
}

/* ---- what is seen ----------------------------------------------------------- */

/* The shape that is sampled, and how. */
typedef enum lr_part_kind {
    LR_PART_BOX,      /* uniformly by solid angle */
    LR_PART_FLAT_BOX, /* by area, as all that follow: its solid angle is too small */
    LR_PART_ELLIPSE,  /* the whole light */
    LR_PART_DISC
} lr_part_kind;

/* A part of a light as seen from a point, in coordinates along the light's sides
 * from its centre. */
typedef struct lr_light_part {
    lr_part_kind kind;
    double axis[3][3];    /* along the sides; the last across them, towards the point */
    double length[2];     /* of the sides */
    double to[3];         /* from the point to the light's centre */
    double height;        /* of the point over the light's plane, along its direction */
    double foot[2];       /* of the point's perpendicular */
    double radius;        /* of the disc that is seen through the slats */
    double lo[2], hi[2];  /* of the box */
    double area;          /* of the part */
    double x[2], y[2], z; /* the box from the point */
    double angle;         /* solid */
    double turn[2];       /* the complex number of the corners at x[0]: of the argument k of the
                             source, but for its length and the sign of its real part */
} lr_light_part;

/* Solid angle below which the excess of the angles is inexact; area sampling is as good. */
static const double ANGLE_MIN = 1e-4;

/* The cosine of a plane through the origin and a side at that height. */
static double tilt(double side, double z)
{
    return side / sqrt(side * side + z * z);
}

/* The complex number whose argument is the solid angle between the foot and a corner, as such
 * angles are added: for a corner to be taken away, sign is -1. */
static void see_corner(double x, double y, double z, double sign, double w[2])
{
    w[0] = fabs(z) * sqrt(x * x + y * y + z * z);
    w[1] = sign * x * y;
}

static void complex_product(const double a[2], const double b[2], double out[2])
{
    out[0] = a[0] * b[0] - a[1] * b[1];
    out[1] = a[0] * b[1] + a[1] * b[0];
}

/* The solid angle of the box: the sum of its corners' angles is the argument of the product of
 * their numbers. Over the foot all are positive, and their sum up to 2 pi; beside it the sum is
 * below pi, so that a negative argument is one of rounding. */
static void see_box(lr_light_part *r)
{
    double corner[2][2], right[2], all[2];
    r->z = lr_dot(r->to, r->axis[2]);
    for (int k = 0; k < 2; k++) {
        r->x[k] = lr_dot(r->to, r->axis[0]) + (k == 0 ? r->lo[0] : r->hi[0]);
        r->y[k] = lr_dot(r->to, r->axis[1]) + (k == 0 ? r->lo[1] : r->hi[1]);
    }
    r->area = (r->hi[0] - r->lo[0]) * (r->hi[1] - r->lo[1]);
    for (int k = 0; k < 2; k++)
        see_corner(r->x[0], r->y[k], r->z, k == 0 ? 1 : -1, corner[k]);
    complex_product(corner[0], corner[1], r->turn);
    for (int k = 0; k < 2; k++)
        see_corner(r->x[1], r->y[k], r->z, k == 0 ? -1 : 1, corner[k]);
    complex_product(corner[0], corner[1], right);
    complex_product(r->turn, right, all);
    const bool over = r->x[0] < 0 && r->x[1] > 0 && r->y[0] < 0 && r->y[1] > 0;
    const double argument = atan2(all[1], all[0]);
    r->angle = argument < 0 && over ? argument + 2 * LR_PI : argument;
    r->kind = r->angle > ANGLE_MIN ? LR_PART_BOX : LR_PART_FLAT_BOX;
}

/* Clip the box to the disc; false where they do not overlap. */
static bool cut_to_disc(const lr_light *light, lr_light_part *r)
{
    r->radius = r->height * tan(0.5 * light->angle);
    for (int a = 0; a < 2; a++) {
        r->lo[a] = fmax(r->lo[a], r->foot[a] - r->radius);
        r->hi[a] = fmin(r->hi[a], r->foot[a] + r->radius);
        if (!(r->lo[a] < r->hi[a]))
            return false;
    }
    return true;
}

/* The part of a light with extent that is seen from p; false where there is none. */
static bool see_part(const lr_light *light, const double p[3], lr_light_part *r)
{
    const double *side[2] = {light->axis_u, light->axis_v};
    for (int a = 0; a < 3; a++)
        r->to[a] = light->position[a] - p[a];
    r->height = -lr_dot(r->to, light->direction);
    if (!(r->height > fmax(light->plane_margin, 0)))
        return false;
    for (int k = 0; k < 2; k++) {
        r->length[k] = sqrt(lr_dot(side[k], side[k]));
        const double inverse = 1 / r->length[k];
        for (int a = 0; a < 3; a++)
            r->axis[k][a] = side[k][a] * inverse;
        r->foot[k] = -lr_dot(r->to, r->axis[k]) - r->height * lr_dot(light->direction, r->axis[k]);
        r->lo[k] = -0.5 * r->length[k];
        r->hi[k] = 0.5 * r->length[k];
    }
    const double *x = r->axis[0], *y = r->axis[1];
    double n[3];
    lr_cross_product(x, y, n);
    const double sign = lr_dot(r->to, n) > 0 ? -1 : 1;
    for (int a = 0; a < 3; a++)
        r->axis[2][a] = sign * n[a];
    const bool narrow = !is_full(light);
    if (narrow && !cut_to_disc(light, r))
        return false;
    const double whole = area_of(light), disc = narrow ? LR_PI * r->radius * r->radius : INFINITY;
    const double box = (r->hi[0] - r->lo[0]) * (r->hi[1] - r->lo[1]);
    if (light->shape == LR_LIGHT_FULL || box < fmin(whole, disc)) {
        see_box(r);
        return r->z < 0;
    }
    r->kind = disc < whole ? LR_PART_DISC : LR_PART_ELLIPSE;
    r->area = fmin(disc, whole);
    return true;
}

/* ---- sampling ------------------------------------------------------------- */

/* The place in the box, from the point, for u: uniformly by solid angle. */
static void place_by_angle(const lr_light_part *r, const double u[2], double *x, double *y)
{
    const double b0 = -tilt(r->y[0], r->z), b1 = tilt(r->y[1], r->z);
    const double a = u[0] * r->angle, cosine = cos(a), sine = sin(a);
    const double length = sqrt(r->turn[0] * r->turn[0] + r->turn[1] * r->turn[1]);
    const double cos_a =
        -(cosine * r->turn[0] + sine * r->turn[1]); /* of a + k, as are its parts */
    const double sin_a = cosine * r->turn[1] - sine * r->turn[0];
    const double f = (cos_a * b0 - b1 * length) / sin_a;
    const double beyond = fmax(f * f + b0 * b0 - 1, 1e-300); /* (z / x)^2 */
    *x = lr_clamp(copysign(r->z / sqrt(beyond), f), r->x[0], r->x[1]);
    const double d = sqrt(*x * *x + r->z * r->z);
    const double h0 = tilt(r->y[0], d), h1 = tilt(r->y[1], d), h = h0 + u[1] * (h1 - h0);
    *y = lr_clamp(h * d / sqrt(fmax(1 - h * h, 1e-300)), r->y[0], r->y[1]);
}

/* Per solid angle, in direction d, where the part is `distance` away. */
static double density(const lr_light *light, const lr_light_part *r, const double d[3],
                      double distance)
{
    if (r->kind == LR_PART_BOX)
        return 1 / r->angle;
    if (r->kind == LR_PART_FLAT_BOX)
        return distance * distance * distance / (r->area * -r->z);
    return distance * distance / (r->area * fabs(lr_dot(d, light->direction)));
}

/* The place in the box for u, from the point, and its density. */
static double draw_in_box(const lr_light_part *r, const double u[2], double to[3])
{
    double x = r->x[0] + u[0] * (r->x[1] - r->x[0]), y = r->y[0] + u[1] * (r->y[1] - r->y[0]);
    if (r->kind == LR_PART_BOX)
        place_by_angle(r, u, &x, &y);
    for (int k = 0; k < 3; k++)
        to[k] = x * r->axis[0][k] + y * r->axis[1][k] + r->z * r->axis[2][k];
    return r->kind == LR_PART_BOX ? 1 / r->angle : density(NULL, r, NULL, sqrt(lr_dot(to, to)));
}

/* As draw_in_box, for the ellipse or the disc. */
static double draw_in_ellipse(const lr_light *light, const lr_light_part *r, const double u[2],
                              double to[3])
{
    const bool disc = r->kind == LR_PART_DISC;
    const double off = sqrt(u[0]), angle = 2 * LR_PI * u[1];
    const double half[2] = {disc ? r->radius : 0.5 * r->length[0],
                            disc ? r->radius : 0.5 * r->length[1]};
    const double x = (disc ? r->foot[0] : 0) + half[0] * off * cos(angle);
    const double y = (disc ? r->foot[1] : 0) + half[1] * off * sin(angle);
    for (int k = 0; k < 3; k++)
        to[k] = r->to[k] + x * r->axis[0][k] + y * r->axis[1][k];
    const double distance = sqrt(lr_dot(to, to));
    const double d[3] = {to[0] / distance, to[1] / distance, to[2] / distance};
    return density(light, r, d, distance);
}

/* Does the place, relative to the point, lie in the light itself? */
static bool holds(const lr_light_part *r, int32_t shape, const double to[3])
{
    double x = 0, y = 0;
    for (int a = 0; a < 3; a++) {
        x += (to[a] - r->to[a]) * r->axis[0][a];
        y += (to[a] - r->to[a]) * r->axis[1][a];
    }
    x /= r->length[0];
    y /= r->length[1];
    return shape == LR_LIGHT_ROUND ? x * x + y * y <= 0.25 : fabs(x) <= 0.5 && fabs(y) <= 0.5;
}

/* The end of shadow rays to the light at `distance`, by its plane margin. */
static double end_of(const lr_light *light, double height, double distance)
{
    return fmax(distance * (1 + light->plane_margin / height), 0);
}

/* A light of spread 0: all of it comes from the foot of p. */
static bool sample_collimated(const lr_light *light, const double p[3], lr_light_ray *ray)
{
    lr_light_part r;
    lr_light wide = *light;
    double to[3];
    wide.angle = LR_PI;
    if (!see_part(&wide, p, &r))
        return false;
    ray->delta = true;
    ray->pdf = 1;
    ray->distance = end_of(light, r.height, r.height);
    for (int a = 0; a < 3; a++) {
        ray->direction[a] = -light->direction[a];
        ray->color[a] = LR_PI * light->color[a];
        to[a] = r.height * ray->direction[a];
    }
    return holds(&r, light->shape, to);
}

bool lr_area_light_sample(const lr_light *light, const double p[3], const double u[2],
                          lr_light_ray *ray)
{
    lr_light_part r;
    double to[3];
    if (light->angle == 0)
        return sample_collimated(light, p, ray);
    if (!see_part(light, p, &r))
        return false;
    ray->pdf =
        r.kind <= LR_PART_FLAT_BOX ? draw_in_box(&r, u, to) : draw_in_ellipse(light, &r, u, to);
    const double distance = sqrt(lr_dot(to, to));
    for (int a = 0; a < 3; a++)
        ray->direction[a] = to[a] / distance;
    ray->distance = end_of(light, r.height, distance);
    if (!(ray->pdf > 0 && ray->pdf < INFINITY))
        return false;
    if (light->shape == LR_LIGHT_FULL &&
        is_full(light)) { /* sheared: before and behind, as Cycles */
        memcpy(ray->color, light->color, sizeof ray->color);
        return true;
    }
    const bool all = r.kind == LR_PART_ELLIPSE || light->shape == LR_LIGHT_FULL;
    return (all || holds(&r, light->shape, to)) &&
           lr_light_color(light, let_out(light, ray->direction), ray->color);
}

bool lr_area_light_hit(const lr_light *light, const double o[3], const double d[3], double t_max,
                       double *t, double color[3], double *pdf)
{
    lr_light_part r;
    const double cosine = -lr_dot(d, light->direction);
    if (!(cosine > 0) || light->angle == 0 || !see_part(light, o, &r))
        return false;
    const double distance = r.height / cosine;
    const double to[3] = {distance * d[0], distance * d[1], distance * d[2]};
    if (!holds(&r, light->shape, to) || !lr_light_color(light, let_out(light, d), color))
        return false;
    *pdf = density(light, &r, d, distance);
    *t = end_of(light, r.height, distance);
    return *t < t_max;
}
