/* Frames for shading, and normals that lean too far for the view.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/bsdf/shading_frame.h"

void lr_basis_set(lr_basis *basis, const double n[3], const double view[3])
{
    lr_orthonormal_basis(n, basis->axis[0], basis->axis[1]);
    memcpy(basis->axis[2], n, sizeof basis->axis[2]);
    for (int a = 0; a < 3; a++)
        basis->view[a] = lr_dot(basis->axis[a], view);
}

/* Bend the normal n towards the face so far that the view's mirror image stands `least` over
 * it, at the sine of that angle. With the face as ground and n at the angle a from its normal,
 * in the plane of both, the image's height is x sin 2a + z cos 2a for a view with x along the
 * ground and z up: the result is the largest a at which that is `least`.
 * False, and n untouched, where it is higher anyway.
 * Source: Cycles, for what is bent and to which height. */
bool lr_bend(const double facing[3], const double view[3], double n[3])
{
    static const double LEAST = 0.01, PART = 0.9; /* of the view's own height, if less */
    const double z = lr_dot(view, facing), upright = lr_dot(n, facing);
    const double least = fmin(PART * z, LEAST), across = lr_dot(view, n);
    if (!(z > 0) || 2 * across * upright - z >= least)
        return false;
    double ground[3], length2 = 0;
    for (int a = 0; a < 3; a++) {
        ground[a] = n[a] - upright * facing[a];
        length2 += ground[a] * ground[a];
    }
    if (!(length2 > 0))
        return false;
    const double x = lr_dot(view, ground) / sqrt(length2);
    const double angle = 0.5 * (atan2(x, z) + acos(lr_clamp(least / hypot(x, z), -1, 1)));
    for (int a = 0; a < 3; a++)
        n[a] = sin(angle) * ground[a] / sqrt(length2) + cos(angle) * facing[a];
    return true;
}

/* Where smoothing has turned the field's normal away from the viewer, it is turned back until
 * the view grazes. */
void lr_turn_back(const double view[3], double n[3])
{
    static const double GRAZING = 1e-3;
    const double short_of = GRAZING - lr_dot(view, n);
    if (!(short_of > 0))
        return;
    for (int a = 0; a < 3; a++)
        n[a] += short_of * view[a];
    const double length = sqrt(lr_dot(n, n));
    for (int a = 0; a < 3; a++)
        n[a] /= length;
}
