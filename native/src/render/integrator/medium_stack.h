/* The solids that a ray is in.
 *
 * Found by a point query where a ray starts, then updated at the surfaces that it passes
 * through. Where solids overlap, the one entered last is the medium: its
 * index of refraction counts, and the surfaces of the others inside it do not bend
 * the ray. Absorption adds up. Sheets have no inside.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_INTEGRATOR_MEDIUM_STACK_H
#define LR_RENDER_INTEGRATOR_MEDIUM_STACK_H

#include "render/integrator/path_state.h"
#include "render/scene/scene.h"

/* Enter; true where the stack was full and its outermost entry was dropped. */
LR_INLINE bool lr_medium_stack_enter(lr_medium_stack *in, uint32_t instance, uint32_t material)
{
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

/* Attenuate the throughput over this length. */
LR_INLINE void lr_medium_stack_absorb(const lr_scene *scene, const lr_medium_stack *in,
                                      double length, double throughput[3])
{
    for (uint32_t k = 0; k < in->n; k++) {
        const lr_material *m = &scene->materials[in->material[k]];
        if ((m->flags & LR_MATERIAL_ABSORBS) == 0)
            continue;
        for (int a = 0; a < 3; a++)
            if (m->absorption[a] > 0)
                throughput[a] *= exp(-m->absorption[a] * length);
    }
}

/* The solids around a point of the world, among those that rays can enter. Returns how many did
 * not fit. */
uint32_t lr_medium_stack_find(const lr_scene *scene, const double p[3], lr_medium_stack *in);

#endif
