/* A frame about a normal, and corrections of normals that face away from the viewer.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_BSDF_SHADING_FRAME_H
#define LR_RENDER_BSDF_SHADING_FRAME_H

#include "base/base.h"

typedef struct lr_basis {
    double axis[3][3]; /* unit; the normal is the last */
    double view[3];    /* in that frame */
} lr_basis;

/* All of these are unit vectors. */
void lr_basis_set(lr_basis *basis, const double n[3], const double view[3]);

/* Bend the normal n of a flat face towards the face's own; false, and n unchanged, where it
 * need not be. */
bool lr_bend(const double facing[3], const double view[3], double n[3]);

/* Turn the normal n back to the viewer's side, if it is not there. */
void lr_turn_back(const double view[3], double n[3]);

#endif
