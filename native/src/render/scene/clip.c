/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/scene/clip.h"

#include "base/affine.h"
#include "base/error.h"
#include "grid/field.h"

lr_status lr_clip_place(const lr_clip *clip, uint64_t instance, lr_placed_clip *placed,
                        lr_error *error)
{
    const lr_volume *v = clip->volume;
    if (v == NULL || !v->finished || v->desc.kind == LR_KIND_SHEET || v->planes[0] != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "instance %llu must be cut by finished solids that are not rectilinear",
                       (unsigned long long)instance);
    if (!lr_affine_invert(clip->world_from_object, placed->object_from_world))
        return lr_fail(error, LR_E_ARGUMENT,
                       "what cuts instance %llu must have a finite, affine and invertible matrix",
                       (unsigned long long)instance);
    if (!(clip->margin >= 0 && clip->margin <= 1))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the margin of what cuts instance %llu must be 0..1, it is %g",
                       (unsigned long long)instance, clip->margin);
    placed->volume = v;
    placed->inside = clip->inside != 0;
    placed->threshold = v->threshold + (placed->inside ? -1 : 1) * clip->margin * v->one;
    return LR_OK;
}

static bool holds(const lr_placed_clip *clip, const double world[3], bool exactly)
{
    double object[3], p[3];
    int32_t c[3];
    lr_map_point(clip->object_from_world, world, object);
    const double threshold = exactly ? clip->volume->threshold : clip->threshold;
    return lr_is_above(clip->volume, object, threshold, c, p);
}

bool lr_clips_keep(const lr_placed_clip *clips, uint64_t n, const double world[3], bool leaves)
{
    for (uint64_t i = 0; i < n; i++)
        if (holds(&clips[i], world, leaves) != clips[i].inside)
            return false;
    return true;
}
