/* Places on a ray by the angle that the way to them takes up at the lamps beside it.
 *
 * What a lamp sheds on a ray falls with the square of the distance. By equal angles at the lamp,
 * places have just that density. Each lamp has its share of the places by what it sheds on the ray
 * in all, and only where its cone meets it.
 *
 * Source: Kulla and Fajardo, Importance sampling techniques for path tracing in participating
 * media, 2012. Departures: 1. a lamp of extent counts as a point at its middle, farther away by its
 * radius, since its light samples are drawn by solid angle, which stays finite; 2. the density is
 * that of all lamps together.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/equiangular.h"

#include "render/lights/light.h"

/* The part of a distance that rounding leaves uncertain: nearer to the ray no lamp is. */
static const double ROUNDING = 0x1p-40;

/* Of places, by a lamp that sheds its light unevenly. */
static const double SHARE = 0.5;

/* By how much its brightest place then exceeds the mean, at least. Measured on lamps near, far and
 * of extent: below that the density of the medium alone has less noise, and smaller shares have
 * more than either. */
static const double UNEVEN = 2;

/* Clip begin..end of the ray to the cone of directions within an angle (its cosine c >= 0) of the
 * axis; w leads from its apex to where the ray starts. False: nothing is left. */
static bool clip_to_cone(const double axis[3], double c, const double w[3], const double d[3],
                         double *begin, double *end)
{
    const double along = lr_dot(d, axis), before = lr_dot(w, axis);
    const double square = along * along - c * c;
    const double half = along * before - c * c * lr_dot(w, d);
    const double discriminant = half * half - square * (before * before - c * c * lr_dot(w, w));
    if (square == 0)
        return true;
    if (discriminant < 0)
        return square > 0; /* below it by rounding alone */
    const double root = sqrt(discriminant);
    const double low = (-half - copysign(root, square)) / square;
    const double high = (-half + copysign(root, square)) / square;
    if (square < 0) { /* within the cone or its mirror image */
        *begin = fmax(*begin, low);
        *end = fmin(*end, high);
        return before + 0.5 * (low + high) * along > 0 && *begin < *end;
    }
    if (along > 0)
        *begin = fmax(*begin, high);
    else
        *end = fmin(*end, low);
    return *begin < *end;
}

/* What the lamp may light of begin..end of the ray. */
static bool clip_to_light(const lr_light_bounds *bounds, double radius, const double to[3],
                          const double d[3], double *begin, double *end)
{
    const double c = bounds->cos_emission;
    double w[3];
    if (bounds->cos_facing < 1) /* to all sides */
        return *begin < *end;
    const double back = c > 0 && c < 1 ? radius / sqrt(1 - c * c) : 0; /* its cone holds its ball */
    for (int a = 0; a < 3; a++)
        w[a] = back * bounds->axis[a] - to[a];
    return clip_to_cone(bounds->axis, c, w, d, begin, end);
}

/* Whether it sheds its light unevenly on the length in which the ray is scattered. */
static bool is_uneven(const lr_lamp_beside *lamp, double length)
{
    const double off = lr_clamp(lamp->nearest, lamp->begin, lamp->end) - lamp->nearest;
    const double even =
        lamp->angle * (lamp->away + off * off / lamp->away); /* as at the brightest */
    return UNEVEN * even < length;
}

/* The lamp with these bounds beside the ray; false where it sheds nothing on it. Its chance is what
 * it sheds. */
static bool find_lamp(const lr_light_bounds *bounds, const double o[3], const double d[3],
                      double length, double extinction, lr_lamp_beside *lamp)
{
    double to[3], across[3], radius2 = 0;
    for (int a = 0; a < 3; a++) {
        const double half = 0.5 * (bounds->hi[a] - bounds->lo[a]);
        to[a] = 0.5 * (bounds->hi[a] + bounds->lo[a]) - o[a];
        radius2 += half * half;
    }
    lamp->nearest = lr_dot(to, d);
    for (int a = 0; a < 3; a++)
        across[a] = to[a] - lamp->nearest * d[a];
    const double least = ROUNDING * sqrt(lr_dot(to, to));
    lamp->away = fmax(sqrt(lr_dot(across, across) + radius2), least);
    lamp->begin = 0;
    lamp->end = length;
    if (!(lamp->away > 0 && lamp->away < INFINITY) ||
        !clip_to_light(bounds, sqrt(radius2), to, d, &lamp->begin, &lamp->end))
        return false;
    const double a = lamp->begin - lamp->nearest, b = lamp->end - lamp->nearest;
    lamp->angle = b < INFINITY ? atan2(lamp->away * (b - a), lamp->away * lamp->away + a * b)
                               : atan2(lamp->away, a);
    const double brightest = lr_clamp(lamp->nearest, lamp->begin, lamp->end);
    lamp->chance = bounds->power * lamp->angle / lamp->away * exp(-extinction * brightest);
    return lamp->chance > 0 && lamp->chance < INFINITY;
}

void lr_lamps_beside_find(const lr_scene *scene, const lr_path *path, const double o[3],
                          const double d[3], double length, double extinction,
                          lr_lamps_beside *beside)
{
    const lr_light_tree *tree = &scene->light_tree;
    const double scattered = extinction > 0 ? -expm1(-extinction * length) / extinction : length;
    double sum = 0;
    beside->n = 0;
    beside->share = 0;
    for (uint32_t i = 0; i < scene->n_lights && scene->n_lights <= LR_LIGHTS_ALL; i++) {
        const lr_light *light = &scene->lights[i];
        const lr_light_bounds *bounds = &tree->nodes[tree->leaf[i]].bounds;
        lr_lamp_beside *lamp = &beside->lamps[beside->n];
        if (bounds->distant || (light->visibility & LR_VISIBLE_VOLUME_SCATTER) == 0 ||
            path->bounces[LR_RAY_CAMERA] > light->max_bounces ||
            !find_lamp(bounds, o, d, length, extinction, lamp))
            continue;
        sum += lamp->chance;
        beside->n++;
    }
    for (uint32_t k = 0; k < beside->n; k++) {
        beside->lamps[k].chance /= sum;
        if (is_uneven(&beside->lamps[k], scattered))
            beside->share += SHARE * beside->lamps[k].chance;
    }
    if (beside->share == 0)
        beside->n = 0; /* no place is drawn by them */
}

double lr_lamps_beside_draw(const lr_lamps_beside *beside, double u)
{
    uint32_t k = 0;
    while (k + 1 < beside->n && u >= beside->lamps[k].chance)
        u -= beside->lamps[k++].chance;
    const lr_lamp_beside *lamp = &beside->lamps[k];
    const double angle = fmin(u / lamp->chance, 1) * lamp->angle;
    const double a = lamp->begin - lamp->nearest, sine = sin(angle);
    const double t = lamp->begin + sine * (lamp->away * lamp->away + a * a) /
                                       (lamp->away * cos(angle) - a * sine);
    return lr_clamp(t, lamp->begin, lamp->end);
}

double lr_lamps_beside_pdf(const lr_lamps_beside *beside, double t)
{
    double pdf = 0;
    for (uint32_t k = 0; k < beside->n; k++) {
        const lr_lamp_beside *lamp = &beside->lamps[k];
        const double off = t - lamp->nearest;
        if (t >= lamp->begin && t <= lamp->end)
            pdf +=
                lamp->chance * lamp->away / (lamp->angle * (lamp->away * lamp->away + off * off));
    }
    return pdf;
}
