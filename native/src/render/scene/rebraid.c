/* Opens instances whose boxes overlap.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/scene/rebraid.h"

#include "base/affine.h"
#include "base/error.h"
#include "trace/structure.h"
#include "trace/triangle_tree.h"

enum {
    /* In all, as each is compared with each. */
    PARTS_MAX = 2048,
    /* Measured: where fewer boxes overlap, the ray's way through more of them takes as long. */
    LEAST_OVERLAPS = 4
};

typedef struct builder {
    const lr_placed *instances;
    lr_scene_part *parts; /* [PARTS_MAX] */
    lr_box *box;          /* [PARTS_MAX] */
    double *size; /* [PARTS_MAX]: half the area of the box; 0 where nothing is to be opened */
    uint32_t n;
} builder;

lr_box lr_world_box(const double m[16], const double lo[3], const double hi[3])
{
    lr_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int corner = 0; corner < 8; corner++) {
        double p[3], q[3];
        for (int a = 0; a < 3; a++)
            p[a] = corner >> a & 1 ? hi[a] : lo[a];
        lr_map_point(m, p, q);
        for (int a = 0; a < 3; a++) {
            box.lo[a] = fmin(box.lo[a], q[a]);
            box.hi[a] = fmax(box.hi[a], q[a]);
        }
    }
    return box;
}

static const lr_triangle_tree *tree_of(const builder *b, uint32_t part)
{
    return b->instances[b->parts[part].instance].structure->tree;
}

static bool may_be_opened(const builder *b, uint32_t k)
{
    const lr_scene_part *part = &b->parts[k];
    return b->instances[part->instance].has_tree && (part->branch & LR_LEAF) == 0;
}

/* Does the box of a part overlap some of other instances'? */
static bool overlaps(const builder *b, uint32_t k)
{
    const lr_box *own = &b->box[k];
    uint32_t n = 0;
    for (uint32_t i = 0; i < b->n && n < LEAST_OVERLAPS; i++) {
        const lr_box *other = &b->box[i];
        bool apart = b->parts[i].instance == b->parts[k].instance;
        for (int a = 0; a < 3; a++)
            apart = apart || own->hi[a] < other->lo[a] || other->hi[a] < own->lo[a];
        n += !apart;
    }
    return n == LEAST_OVERLAPS;
}

static void put(builder *b, uint32_t k, uint32_t instance, uint32_t branch, lr_box box)
{
    b->parts[k] = (lr_scene_part){instance, branch};
    b->box[k] = box;
    b->size[k] = may_be_opened(b, k) ? lr_half_area(&box) : 0.0;
}

/* Put the children of a part's node in its place. */
static void open_part(builder *b, uint32_t k)
{
    const lr_scene_part part = b->parts[k];
    const lr_placed *placed = &b->instances[part.instance];
    const lr_wide_node *node = &tree_of(b, k)->boxes.nodes[part.branch];
    double m[16];
    uint32_t to = k;
    lr_affine_multiply(placed->world_from_object, placed->structure->volume->object_from_storage,
                       m);
    for (int l = 0; l < LR_TREE_LANES && node->child[l] != LR_NOWHERE; l++) {
        double lo[3], hi[3];
        for (int a = 0; a < 3; a++) {
            lo[a] = node->bound[0][a][l];
            hi[a] = node->bound[1][a][l];
        }
        put(b, to, part.instance, node->child[l], lr_world_box(m, lo, hi));
        to = b->n++;
    }
    b->n--;
}

/* Returns whether anything was opened. */
static bool open_all(builder *b)
{
    bool any = false;
    while (b->n + LR_TREE_LANES <= PARTS_MAX) {
        uint32_t largest = 0;
        for (uint32_t k = 1; k < b->n; k++)
            largest = b->size[k] > b->size[largest] ? k : largest;
        if (!(b->size[largest] > 0.0))
            break;
        if (overlaps(b, largest)) {
            open_part(b, largest);
            any = true;
        } else {
            b->size[largest] = 0.0;
        }
    }
    return any;
}

lr_status lr_rebraid(const lr_placed *instances, uint32_t n, const lr_box *boxes, lr_rebraided *out,
                     lr_error *error)
{
    static const size_t SIZE = PARTS_MAX * (sizeof(lr_box) + sizeof(double));
    if (n > PARTS_MAX - LR_TREE_LANES)
        return LR_OK;
    out->parts = malloc(PARTS_MAX * sizeof *out->parts);
    builder b = {instances, out->parts, malloc(SIZE), NULL, 0};
    lr_hierarchy binary = {.nodes = NULL};
    lr_status status = LR_OK;
    if (b.box == NULL || b.parts == NULL)
        status = lr_fail_memory(error, SIZE, "the parts of instances");
    b.size = (double *)(b.box + PARTS_MAX);
    for (uint32_t i = 0; i < n && status == LR_OK; i++)
        if (boxes[i].lo[0] <= boxes[i].hi[0])
            put(&b, b.n++, i,
                instances[i].has_tree ? lr_tree_root(instances[i].structure->tree) : 0, boxes[i]);
    if (status == LR_OK && b.n > 0 && open_all(&b)) {
        status = lr_hierarchy_build(b.box, b.n, 1, &binary, error);
        if (status == LR_OK)
            status = lr_wide_build(&binary, &LR_ONE_BOX, &out->boxes, error);
    }
    free(binary.nodes);
    free(b.box);
    return status;
}
