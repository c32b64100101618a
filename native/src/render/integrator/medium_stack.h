/* The solids that a ray is in.
 *
 * Found by a point query where a ray starts, then updated at the surfaces that it passes
 * through. Where solids overlap, the one entered last is the medium: its
 * index of refraction counts, and the surfaces of the others inside it do not bend
 * the ray. What fills them adds up, but for those that rays of its kind do not see. Sheets have no
 * inside.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_MEDIUM_STACK_H
#define LR_RENDER_INTEGRATOR_MEDIUM_STACK_H

#include "render/integrator/path_state.h"
#include "render/scene/scene.h"

/* Enter, if it is not in there: by rounding, rays may start on the wrong side of a surface. True
 * where the stack was full and its outermost entry was dropped. */
LR_INLINE bool lr_medium_stack_enter(lr_medium_stack *in, uint32_t instance, uint32_t material)
{
    for (uint32_t k = 0; k < in->n; k++)
        if (in->instance[k] == instance)
            return false;
    const bool full = in->n == LR_MEDIA_MAX;
    if (full)
        for (uint32_t k = 1; k < LR_MEDIA_MAX; k++) {
            in->instance[k - 1] = in->instance[k];
            in->material[k - 1] = in->material[k];
        }
    in->n -= full;
    in->instance[in->n] = instance;
    in->material[in->n++] = material;
    return full;
}

/* Leave; no effect where the instance has been dropped. */
LR_INLINE void lr_medium_stack_leave(lr_medium_stack *in, uint32_t instance)
{
    uint32_t k = in->n;
    while (k > 0 && in->instance[k - 1] != instance)
        k--;
    if (k == 0)
        return;
    for (in->n--; k <= in->n; k++) {
        in->instance[k - 1] = in->instance[k];
        in->material[k - 1] = in->material[k];
    }
}

/* Index of refraction where the ray is: of the last refracting solid that it entered. */
LR_INLINE double lr_medium_stack_ior(const lr_scene *scene, const lr_medium_stack *in)
{
    for (uint32_t k = in->n; k > 0; k--) {
        const lr_material *m = &scene->materials[in->material[k - 1]];
        if ((m->flags & LR_MATERIAL_REFRACTS) != 0)
            return m->ior;
    }
    return 1;
}

/* What fills solid k of the stack for rays of that visibility, or NULL. */
LR_INLINE const lr_material *lr_medium_stack_filling(const lr_scene *scene,
                                                     const lr_medium_stack *in, uint32_t k,
                                                     uint32_t visibility)
{
    const lr_material *m = &scene->materials[in->material[k]];
    const bool seen = (scene->instances[in->instance[k]].visibility & visibility) != 0;
    return seen && (m->flags & LR_MATERIAL_FILLS) != 0 ? m : NULL;
}

/* Attenuate the throughput of a ray of that visibility over this length. */
LR_INLINE void lr_medium_stack_absorb(const lr_scene *scene, const lr_medium_stack *in,
                                      uint32_t visibility, double length, double throughput[3])
{
    for (uint32_t k = 0; k < in->n; k++) {
        const lr_material *m = lr_medium_stack_filling(scene, in, k, visibility);
        for (int a = 0; a < 3 && m != NULL; a++)
            if (m->medium.extinction[a] > 0)
                throughput[a] *= exp(-m->medium.extinction[a] * length);
    }
}

/* The solids around a point of the world, among those that rays of that visibility can enter.
 * Returns how many did not fit. */
uint32_t lr_medium_stack_find(const lr_scene *scene, const double p[3], uint32_t visibility,
                              lr_medium_stack *in);

#endif
