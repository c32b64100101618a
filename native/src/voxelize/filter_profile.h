/* Filters: the occupancy of a sample at signed distance s from a plane.
 *
 *   ramp    linear up to the half width r: the oriented box filter
 *   cone    1/2 + u - u^3 + u^4 / 2, u = s / r: a hypercone of radius r
 *   gauss   (1 + erf(s / (r sqrt 2))) / 2, r being sigma
 *   binary  1 inside, 0 outside
 *   box     the coverage of the voxel, which no distance gives: coverage.c
 *
 * Source: Sramek and Kaufman 1999 (oriented box); Wang and Kaufman 1993 (hypercone).
 * Departure: the last three are one-dimensional, along the normal, so that a sphere keeps
 * its radius; filters in space move its surface inwards by their variance over the radius.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_VOXELIZE_FILTER_PROFILE_H
#define LR_VOXELIZE_FILTER_PROFILE_H

#include "base/base.h"

#define LR_GAUSS_RADIUS 4.5    /* sigma: beyond, less than half a step of u16 is left */
#define LR_BOX_RADIUS   0.8661 /* sqrt(3) / 2: farther voxels are of one side */

#define LR_WIDEST 32.0 /* largest radius of a filter, voxels */

enum { LR_FILTER_LAST = LR_FILTER_BINARY };

/* The default, in voxels. The steps of u8 are so coarse that a steeper ramp has smaller errors,
 * although it ends nearer to the surface. */
LR_INLINE double lr_profile_half_width(int32_t filter, int32_t sample_type)
{
    switch (filter) {
    case LR_FILTER_CONE:
        return 3.0;
    case LR_FILTER_GAUSS:
        return 1.0;
    case LR_FILTER_BOX:
    case LR_FILTER_BINARY:
        return 0.5;
    default:
        return sample_type == LR_U8 ? 1.8 : 2.5;
    }
}

LR_INLINE double lr_profile_widest(int32_t filter)
{
    return filter == LR_FILTER_GAUSS ? LR_WIDEST / LR_GAUSS_RADIUS : LR_WIDEST;
}

/* Whether it needs an inside and an outside, which a sheet has not. */
LR_INLINE bool lr_profile_of_solids(int32_t filter)
{
    return filter == LR_FILTER_BOX || filter == LR_FILTER_BINARY;
}

/* Distance from the surface, in voxels, up to which occupancy is neither 0 nor 1. */
LR_INLINE double lr_profile_radius(int32_t filter, double r)
{
    switch (filter) {
    case LR_FILTER_GAUSS:
        return LR_GAUSS_RADIUS * r;
    case LR_FILTER_BOX:
        return LR_BOX_RADIUS;
    case LR_FILTER_BINARY:
        return 0.0;
    default:
        return r;
    }
}

/* Occupancy; for the box filter, that of a voxel without surface. */
LR_INLINE double lr_profile(int32_t filter, double s, double r)
{
    switch (filter) {
    case LR_FILTER_CONE: {
        const double u = lr_clamp(fabs(s) / r, 0.0, 1.0);
        return 0.5 + copysign(u - u * u * u + 0.5 * u * u * u * u, s);
    }
    case LR_FILTER_GAUSS:
        return fabs(s) < LR_GAUSS_RADIUS * r ? 0.5 + 0.5 * erf(s / (r * 1.4142135623730951))
                                             : (double)(s > 0.0);
    case LR_FILTER_BINARY:
    case LR_FILTER_BOX:
        return s >= 0.0;
    default:
        return lr_clamp(0.5 + s / (2.0 * r), 0.0, 1.0);
    }
}

/* Slope of the occupancy per voxel at a plane; of box and binary, between the samples on
 * either side. */
LR_INLINE double lr_profile_slope(int32_t filter, double r)
{
    switch (filter) {
    case LR_FILTER_CONE:
        return 1.0 / r;
    case LR_FILTER_GAUSS:
        return 0.3989422804014327 / r;
    case LR_FILTER_BINARY:
    case LR_FILTER_BOX:
        return 1.0;
    default:
        return 0.5 / r;
    }
}

#endif
