/* Finds the solids that contain a point.
 *
 * The boxes of the hierarchy bound the surfaces, hence what is inside them too.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/medium_stack.h"

#include "base/affine.h"
#include "grid/field.h"
#include "trace/structure.h"

enum { HELD = 64 }; /* size of the stack: the height of the hierarchy at most */

/* Is f >= T at p of object space? id: of the sample nearest to it. */
static bool holds(const lr_volume *v, const double object[3], int32_t *id)
{
    double p[3];
    int32_t c[3];
    if (!lr_is_above(v, object, v->threshold, c, p))
        return false;
    *id = lr_id(v, c[0] + (p[0] > 0.5), c[1] + (p[1] > 0.5), c[2] + (p[2] > 0.5));
    return true;
}

static bool in_box(const lr_node *node, int child, const double p[3])
{
    for (int a = 0; a < 3; a++)
        if (p[a] < node->bound[0][a][child] || p[a] > node->bound[1][a][child])
            return false;
    return true;
}

static void look(const lr_scene *scene, uint32_t instance, const double p[3], uint32_t visibility,
                 lr_medium_stack *in, uint32_t *lost)
{
    const lr_placed *placed = &scene->instances[instance];
    const lr_volume *v = lr_structure_volume(placed->structure);
    double object[3];
    int32_t id;
    if (!placed->enterable || (placed->visibility & visibility) == 0)
        return;
    lr_map_point(placed->object_from_world, p, object);
    if (holds(v, object, &id))
        *lost += lr_medium_stack_enter(in, instance, lr_material_of(scene, instance, id, NULL));
}

uint32_t lr_medium_stack_find(const lr_scene *scene, const double p[3], uint32_t visibility,
                              lr_medium_stack *in)
{
    uint32_t held[HELD + 2], n = 0, lost = 0;
    in->n = 0;
    if (scene->hierarchy.n_nodes > 0)
        held[n++] = 0;
    while (n > 0) {
        const lr_node *node = &scene->hierarchy.nodes[held[--n]];
        for (int c = 1; c >= 0; c--) {
            if (!in_box(node, c, p))
                continue;
            if ((node->child[c] & LR_LEAF) == 0)
                held[n++] = node->child[c];
            else if (node->child[c] != LR_NOWHERE)
                look(scene, node->child[c] & ~LR_LEAF, p, visibility, in, &lost);
        }
    }
    return lost;
}
