/* Trees of triangles: made, and what a ray in one means for a volume.
 *
 * Where every surface cell keeps its triangles, the volume has nothing to tell a ray that comes
 * from outside: it meets the nearest triangle. The tree finds that without a walk, eight boxes or
 * triangles at a time. A hit is the same as by the walk, to the bit: the same triangle is met by
 * the same operations, and of two at the same t the first counts. A ray inside a solid that meets
 * nothing has gone by an edge by rounding, or through a hole of the mesh: that is left to the walk,
 * which knows the sides of cells.
 *
 * Source: Wald, Benthin, Boulos 2008, Getting rid of packets: efficient SIMD single-ray traversal
 * using multi-branching BVHs. Departure: leaves are met in f64, in the frame of Woop, Benthin, Wald
 * 2013, and boxes too, which are stored in f32.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/triangle_tree.h"

#include "base/cpu.h"
#include "base/pages.h"
#include "trace/hit_record.h"
#include "trace/traverser.h"

/* Boxes are larger than their triangles by so much, voxels: more than rounding does to t of planes
 * for rays from up to 2^30 voxels away. */
static const double MARGIN = 0x1p-16;
/* A hit so near to a face lies in either cell, voxels. */
static const double ON_FACE = 1e-6;

/* ---- building --------------------------------------------------------------- */

/* A child of the binary hierarchy. */
typedef struct branch {
    uint32_t node;
    int side;
} branch;

typedef struct builder {
    const lr_hierarchy *binary;
    const lr_triangle_cells *cells;
    uint32_t *n_below;      /* [binary->n_nodes]: triangles */
    lr_triangle_tree *tree; /* whose nodes and blocks are NULL while they are counted */
} builder;

static uint32_t child_of(const builder *b, branch at)
{
    return b->binary->nodes[at.node].child[at.side];
}

static uint32_t n_below(const builder *b, branch at)
{
    const uint32_t child = child_of(b, at);
    return child == LR_NOWHERE ? 0 : (child & LR_LEAF) != 0 ? 1 : b->n_below[child];
}

/* Children come after their parents. */
static void count_below(builder *b)
{
    for (uint32_t i = b->binary->n_nodes; i-- > 0;)
        b->n_below[i] = n_below(b, (branch){i, 0}) + n_below(b, (branch){i, 1});
}

static double half_area_of(const builder *b, branch at)
{
    double size[3];
    const lr_node *node = &b->binary->nodes[at.node];
    for (int a = 0; a < 3; a++)
        size[a] = (double)node->bound[1][a][at.side] - (double)node->bound[0][a][at.side];
    return size[0] * size[1] + size[1] * size[2] + size[2] * size[0];
}

/* Up to eight branches in place of a node's two: the largest that does not fit into a block is
 * opened, again and again. Returns how many. */
static int widen(const builder *b, uint32_t node, branch wide[LR_TREE_LANES])
{
    int n = 2;
    wide[0] = (branch){node, 0};
    wide[1] = (branch){node, 1};
    while (n < LR_TREE_LANES) {
        int largest = -1;
        double most = -1.0;
        for (int i = 0; i < n; i++)
            if (n_below(b, wide[i]) > LR_TREE_LANES && half_area_of(b, wide[i]) > most) {
                most = half_area_of(b, wide[i]);
                largest = i;
            }
        if (largest < 0)
            break;
        const uint32_t opened = child_of(b, wide[largest]);
        wide[largest] = (branch){opened, 0};
        wide[n++] = (branch){opened, 1};
    }
    return n;
}

static void put_triangle(const lr_triangle_cells *cells, uint32_t triangle, int lane,
                         lr_triangle_block *block)
{
    const double *p[3];
    lr_triangle_cell_corners(cells, triangle, p);
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++)
            block->corner[c][a][lane] = p[c][a];
    block->triangle[lane] = triangle;
}

/* Put the triangles of a branch into a block from a lane on; returns the next lane. */
static int fill_block(const builder *b, branch at, lr_triangle_block *block, int lane)
{
    const uint32_t child = child_of(b, at);
    if (child == LR_NOWHERE)
        return lane;
    if ((child & LR_LEAF) != 0) {
        put_triangle(b->cells, child & ~LR_LEAF, lane, block);
        return lane + 1;
    }
    return fill_block(b, (branch){child, 1}, block, fill_block(b, (branch){child, 0}, block, lane));
}

/* Triangles of no size, which no ray meets. */
static lr_triangle_block *next_block(lr_triangle_tree *tree)
{
    lr_triangle_block *block = tree->blocks != NULL ? &tree->blocks[tree->n_blocks] : NULL;
    tree->n_blocks++;
    for (int l = 0; l < LR_TREE_LANES && block != NULL; l++)
        block->triangle[l] = LR_NO_TRIANGLE;
    return block;
}

static uint32_t make_node(builder *b, uint32_t binary);

/* Make a branch a child of a node, or only count what it takes. */
static uint32_t make_child(builder *b, branch at)
{
    if (n_below(b, at) > LR_TREE_LANES)
        return make_node(b, child_of(b, at));
    const uint32_t number = b->tree->n_blocks;
    lr_triangle_block *block = next_block(b->tree);
    if (block != NULL)
        fill_block(b, at, block, 0);
    return number | LR_LEAF;
}

/* The same of a node of the binary hierarchy. */
static uint32_t make_node(builder *b, uint32_t binary)
{
    branch wide[LR_TREE_LANES];
    const int n = widen(b, binary, wide);
    const uint32_t number = b->tree->n_nodes++;
    for (int l = 0; l < LR_TREE_LANES; l++) {
        const uint32_t child = l < n ? make_child(b, wide[l]) : 0;
        if (b->tree->nodes == NULL)
            continue;
        lr_tree_node *node = &b->tree->nodes[number];
        node->child[l] = child;
        for (int a = 0; a < 3; a++)
            for (int end = 0; end < 2; end++)
                node->bound[end][a][l] =
                    l < n ? b->binary->nodes[wide[l].node].bound[end][a][wide[l].side]
                          : (end == 0 ? INFINITY : -INFINITY);
    }
    return number;
}

/* The arrays of a tree that was counted; *nbytes grows by what they take. */
static lr_status get_room(lr_triangle_tree *tree, uint64_t *nbytes, lr_error *error)
{
    const uint64_t wanted = tree->n_nodes * (uint64_t)sizeof *tree->nodes +
                            tree->n_blocks * (uint64_t)sizeof *tree->blocks;
    tree->nodes = lr_pages_new((uint64_t)tree->n_nodes + 1, sizeof *tree->nodes);
    tree->blocks = lr_pages_new(tree->n_blocks, sizeof *tree->blocks);
    if (tree->nodes == NULL || tree->blocks == NULL)
        return lr_fail_memory(error, wanted, "a tree of triangles");
    *nbytes += wanted;
    return LR_OK;
}

/* One block, and no node. */
static lr_status build_block(const lr_triangle_cells *cells, lr_triangle_tree *tree,
                             uint64_t *nbytes, lr_error *error)
{
    tree->n_blocks = 1;
    lr_status status = get_room(tree, nbytes, error);
    if (status != LR_OK)
        return status;
    tree->n_blocks = 0;
    lr_triangle_block *block = next_block(tree);
    for (uint32_t i = 0; i < cells->n_triangles; i++)
        put_triangle(cells, i, (int)i, block);
    tree->root = 0 | LR_LEAF;
    return LR_OK;
}

static void box_of(const lr_triangle_cells *cells, uint32_t triangle, lr_box *box)
{
    const double *p[3];
    lr_triangle_cell_corners(cells, triangle, p);
    for (int a = 0; a < 3; a++) {
        box->lo[a] = fmin(fmin(p[0][a], p[1][a]), p[2][a]) - MARGIN;
        box->hi[a] = fmax(fmax(p[0][a], p[1][a]), p[2][a]) + MARGIN;
    }
}

/* Count what the tree takes, then make it. */
static lr_status collapse(const lr_triangle_cells *cells, const lr_hierarchy *binary,
                          lr_triangle_tree *tree, uint64_t *nbytes, lr_error *error)
{
    const size_t size = (size_t)binary->n_nodes * sizeof(uint32_t);
    builder b = {binary, cells, malloc(size), tree};
    if (b.n_below == NULL)
        return lr_fail_memory(error, size, "the making of a tree of triangles");
    count_below(&b);
    make_node(&b, 0);
    const lr_status status = get_room(tree, nbytes, error);
    tree->n_nodes = tree->n_blocks = 0;
    if (status == LR_OK)
        tree->root = make_node(&b, 0);
    free(b.n_below);
    return status;
}

static lr_status build_nodes(const lr_triangle_cells *cells, lr_triangle_tree *tree,
                             uint64_t *nbytes, lr_error *error)
{
    const size_t size = (size_t)cells->n_triangles * sizeof(lr_box);
    lr_hierarchy binary = {.nodes = NULL};
    lr_box *boxes = malloc(size);
    if (boxes == NULL)
        return lr_fail_memory(error, size, "the boxes of triangles");
    for (uint32_t i = 0; i < cells->n_triangles; i++)
        box_of(cells, i, &boxes[i]);
    lr_status status = lr_hierarchy_build(boxes, cells->n_triangles, &binary, error);
    free(boxes);
    if (status == LR_OK)
        status = collapse(cells, &binary, tree, nbytes, error);
    free(binary.nodes);
    return status;
}

bool lr_has_only_triangles(const lr_volume *v)
{
    return v->triangle_cells != NULL && v->triangle_cells->n_cells == v->n_surface_cells &&
           v->triangle_cells->n_triangles > 0 && v->objects == NULL && v->transfer == NULL &&
           v->planes[0] == NULL && !lr_is_cubic(v);
}

lr_status lr_triangle_tree_build(const lr_volume *volume, lr_triangle_tree **tree, uint64_t *nbytes,
                                 lr_error *error)
{
    const lr_triangle_cells *cells = volume->triangle_cells;
    lr_triangle_tree *t = calloc(1, sizeof *t);
    if (t == NULL)
        return lr_fail_memory(error, sizeof *t, "a tree of triangles");
    t->simd = lr_cpu_simd();
    *nbytes = sizeof *t;
    const lr_status status = cells->n_triangles <= LR_TREE_LANES
                                 ? build_block(cells, t, nbytes, error)
                                 : build_nodes(cells, t, nbytes, error);
    if (status == LR_OK)
        *tree = t;
    else
        lr_triangle_tree_free(t);
    return status;
}

void lr_triangle_tree_free(lr_triangle_tree *tree)
{
    if (tree == NULL)
        return;
    lr_pages_free(tree->nodes);
    lr_pages_free(tree->blocks);
    free(tree);
}

/* ---- rays --------------------------------------------------------------- */

bool lr_tree_accepts(const lr_tree_ray *k, const lr_triangle_block *block, int lane, double t,
                     bool inward)
{
    if (k->side == 0)
        return true;
    double corner[3][3], n[3];
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++)
            corner[c][a] = block->corner[c][a][lane];
    lr_corners_normal((const double *const[3]){corner[0], corner[1], corner[2]}, n);
    const double height = (t - k->t_min) * lr_plane_speed(k->r, n);
    return height > k->off || inward == (k->side < 0);
}

static const lr_tree_ops *ops_of(int32_t simd)
{
#ifdef LR_X86
    if (simd == LR_SIMD_AVX512)
        return &lr_tree_avx512;
    if (simd == LR_SIMD_AVX2)
        return &lr_tree_avx2;
#endif
    (void)simd;
    return &lr_tree_portable;
}

/* The surface cell that holds the hit, or one beside it where it lies on a face; false: none does.
 */
static bool find_cell(const lr_volume *v, const lr_ray *r, double t, lr_found *found)
{
    double q[3];
    int32_t low[3], high[3];
    lr_point_at(r, t, q);
    for (int a = 0; a < 3; a++) {
        low[a] = (int32_t)lr_clamp(floor(q[a] - ON_FACE), 0.0, LR_MAX_SIDE);
        high[a] = (int32_t)lr_clamp(floor(q[a] + ON_FACE), 0.0, LR_MAX_SIDE);
    }
    for (int n = 0; n < 8; n++) {
        for (int a = 0; a < 3; a++)
            found->c[a] = n >> a & 1 ? low[a] : high[a];
        if (!lr_holds_surface(v, found->c))
            continue;
        for (int a = 0; a < 3; a++)
            found->p[a] = lr_clamp(q[a] - found->c[a], 0.0, 1.0);
        return true;
    }
    return false;
}

/* What the ray is for the tree; false: it meets nothing, by its own numbers. */
static bool set_up(const lr_volume *v, const lr_rays *rays, uint64_t i, bool any, lr_ray *r,
                   lr_tree_ray *k)
{
    const double o[3] = {rays->ox[i], rays->oy[i], rays->oz[i]};
    const double d[3] = {rays->dx[i], rays->dy[i], rays->dz[i]};
    const double t_min = rays->t_min != NULL ? rays->t_min[i] : 0.0;
    const lr_start *start = rays->start != NULL ? &rays->start[i] : NULL;
    const int32_t side = start != NULL ? start->side : 0;
    lr_cursor u;
    if (!lr_ray_setup(r, v, o, d, rays->t_max != NULL ? rays->t_max[i] : INFINITY) ||
        !(t_min <= r->t_max && t_min < INFINITY) ||
        (side != 0 && !lr_leave(v, r, &u, start, t_min)))
        return false;
    *k = (lr_tree_ray){.r = r,
                       .v = v,
                       .t_min = t_min,
                       .side = side,
                       .off = side != 0 ? lr_start_off(v) : 0.0,
                       .any = any,
                       .t = r->t_max,
                       .triangle = LR_NO_TRIANGLE};
    return true;
}

/* Trace ray i by the tree and put its hit; false where only a walk through cells can tell. any: as
 * in lr_trace_scene. */
static bool trace_ray(const lr_triangle_tree *tree, const lr_volume *v, const lr_rays *rays,
                      uint64_t i, const lr_trace_options *options, bool any, const lr_hits *hits,
                      lr_counters *counters)
{
    lr_ray r;
    lr_tree_ray k = {.triangle = LR_NO_TRIANGLE};
    lr_put_miss(hits, i);
    if (set_up(v, rays, i, any, &r, &k)) {
        ops_of(tree->simd)->meet(tree, &k);
        const bool inside = k.side > 0 && v->desc.kind == LR_KIND_SOLID;
        if (k.triangle == LR_NO_TRIANGLE && inside)
            return false;
    }
    if (k.triangle != LR_NO_TRIANGLE && any)
        hits->t[i] = k.t;
    else if (k.triangle != LR_NO_TRIANGLE) {
        lr_found found = {.t = k.t, .triangle = k.triangle, .object = LR_NO_OBJECT};
        if (!find_cell(v, &r, k.t, &found))
            return false;
        lr_put_surface(v, hits, i, &found, (double[3]){rays->dx[i], rays->dy[i], rays->dz[i]},
                       options->normal);
    }
    if (counters != NULL) {
        counters->rays++;
        counters->pairs++;
        counters->in_lanes++;
        counters->nodes += k.n_nodes;
        counters->tests += k.n_blocks;
        counters->hits += k.triangle != LR_NO_TRIANGLE;
    }
    return true;
}

/* The arrays of rays and hits from ray i on. */
static void skip(uint64_t i, lr_rays *rays, lr_hits *hits)
{
#define SKIP(of, field) of->field = of->field != NULL ? of->field + i : NULL
    SKIP(rays, ox), SKIP(rays, oy), SKIP(rays, oz), SKIP(rays, dx), SKIP(rays, dy);
    SKIP(rays, dz), SKIP(rays, t_min), SKIP(rays, t_max), SKIP(rays, start), SKIP(rays, length);
    SKIP(hits, t), SKIP(hits, ci), SKIP(hits, cj), SKIP(hits, ck), SKIP(hits, nx), SKIP(hits, ny);
    SKIP(hits, nz), SKIP(hits, gx), SKIP(hits, gy), SKIP(hits, gz), SKIP(hits, id);
    SKIP(hits, triangle), SKIP(hits, steps);
#undef SKIP
}

lr_status lr_trace_scene(const lr_structure *s, const lr_rays *rays, uint64_t n,
                         const lr_trace_options *options, bool any, const lr_hits *hits,
                         lr_counters *counters, const lr_watch *watch, lr_error *error)
{
    if (s->tree == NULL)
        return lr_trace(s, rays, n, options, hits, counters, watch, error);
    lr_status status =
        lr_trace(s, rays, 0, options, hits, counters, watch, error); /* checks them */
    for (uint64_t i = 0; i < n && status == LR_OK; i++) {
        lr_rays own = *rays;
        lr_hits to = *hits;
        if (trace_ray(s->tree, s->volume, rays, i, options, any, hits, counters))
            continue;
        skip(i, &own, &to);
        status = s->ops->trace(s->volume, s->data, &own, 1, options, &to, counters, watch, error);
    }
    return status;
}
