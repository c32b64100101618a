/* Sides that go from triangle cells on through the field.
 *
 * A ray that left a triangle may find itself on the wrong side of the field beside the
 * triangle cell, by what that is off. Its side goes with it through cells of the field, whose
 * surface is taken to lie that much further on, until the field agrees or the surface is
 * met. In front of a cell without surface there is nothing more to wait for: a ray that is
 * still on the wrong side there has met the surface. So no ray leaves a solid unseen.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/carried_side.h"

#include "trace/cell_common.h"

/* The field of cells without doubt is off by less on their triangles
 * (voxelize/choose_triangle_cells.c), voxels. */
static const double TRUSTED_OFF = 0.05;

bool lr_hit_handed(const lr_volume *v, const lr_ray *r, const lr_cursor *u,
                   const lr_trace_options *options, int *side, lr_found *found, uint64_t *n_samples)
{
    lr_chord h;
    int axis;
    const int way = *side > 0 ? 1 : -1;
    const double to_voxels = way * v->triangle_cells->voxels_per_value, level = v->threshold;
    lr_corners(v, u->c, h.corner);
    lr_chord_points(&h, r, LR_REGULAR, u, &axis);
    lr_chord_values(&h, r, u, axis);
    *n_samples += 2;
    const double in = (h.f_in - level) * to_voxels, out = (h.f_out - level) * to_voxels;
    *side = 0;
    found->triangle = LR_NO_TRIANGLE;
    found->object = LR_NO_OBJECT;
    const double shift = fmax(TRUSTED_OFF, -in) / to_voxels;
    double shifted[8];
    for (int b = 0; b < 8; b++)
        shifted[b] = h.corner[b] + shift;
    bool hit = lr_hit_corners(v, shifted, r, LR_REGULAR, u, way, options, found, n_samples);
    if (!hit && out >= 0.0)
        return false; /* the field agrees again */
    if (!hit) {
        int32_t beside[3] = {u->c[0], u->c[1], u->c[2]};
        beside[axis] += r->s[axis];
        if (lr_holds_surface(v, beside)) {
            *side = 2 * way;
            return false;
        }
        found->t = h.t_out;
        memcpy(found->c, u->c, sizeof found->c);
        memcpy(found->p, h.out, sizeof found->p);
        hit = h.t_out <= r->t_max;
    }
    memcpy(found->corner, h.corner, sizeof found->corner);
    return hit;
}

int lr_handed_on(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int side,
                 uint64_t *n_samples)
{
    int axis;
    double corner[8], p[3];
    const double t = lr_exit_t(r, LR_REGULAR, u->c, u->c, &axis);
    lr_corners(v, u->c, corner);
    lr_point_at(r, t, p);
    for (int a = 0; a < 3; a++)
        p[a] = lr_clamp(p[a] - u->c[a], 0.0, 1.0);
    ++*n_samples;
    const double f = lr_face_value(corner, axis, r->s[axis] > 0, p);
    const double value = (f - v->threshold) * v->triangle_cells->voxels_per_value;
    if ((value >= 0.0) == (side > 0))
        return side;
    return fabs(value) <= LR_FIELD_OFF ? LR_STILL : 0;
}

bool lr_starts_off(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int side)
{
    double corner[8], p[3];
    lr_corners(v, u->c, corner);
    lr_point_at(r, u->t, p);
    for (int a = 0; a < 3; a++)
        p[a] = lr_clamp(p[a] - u->c[a], 0.0, 1.0);
    const double value =
        (lr_trilinear(corner, p) - v->threshold) * v->triangle_cells->voxels_per_value * side;
    return value < -lr_start_off(v) && value >= -LR_FIELD_OFF;
}
