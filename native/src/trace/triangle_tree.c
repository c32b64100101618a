/* Trees of triangles: made, and what a ray in one means for a volume.
 *
 * Where every surface cell keeps its triangles, the volume has nothing to tell a ray that comes
 * from outside: it meets the nearest triangle. The tree finds that without a walk, eight boxes or
 * triangles at a time. A hit is the same as by the walk, to the bit: the same triangle is met by
 * the same operations, and of two at the same t the first counts. A ray inside a solid that meets
 * nothing has gone by an edge by rounding, or through a hole of the mesh: that is left to the walk,
 * which knows the sides of cells.
 *
 * Source: that of wide nodes. Departure: leaves are met in f64, in the frame of Woop, Benthin, Wald
 * 2013.
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

/* From so many triangles on blocks are narrow where they can. */
enum { NARROW_LEAST = 1 << 12 };

/* ---- building --------------------------------------------------------------- */

typedef struct builder {
    const lr_triangle_cells *cells;
    lr_triangle_tree *tree; /* whose blocks are NULL while they are counted */
    bool narrow;            /* they will be */
    uint64_t *nbytes;
} builder;

static uint32_t *triangle_in(const lr_triangle_tree *t, uint32_t block, int lane)
{
    return t->narrow != NULL ? &t->narrow[block].triangle[lane] : &t->blocks[block].triangle[lane];
}

/* The number in f32 of which scale and offset make x; whether there is one. */
static bool narrowed(const lr_triangle_tree *t, int axis, double x, float *f32)
{
    *f32 = (float)((x - t->offset[axis]) / t->scale[axis]);
    return (double)*f32 * t->scale[axis] + t->offset[axis] == x;
}

/* Does the mesh have coordinates in f32, which voxels only scale and shift? Blocks of a small tree
 * stay in the cache as they are. */
static bool may_be_narrow(const lr_volume *v, lr_triangle_tree *t)
{
    bool all = t->cells->n_triangles >= NARROW_LEAST;
    float f32;
    for (int a = 0; a < 3; a++) {
        t->scale[a] = v->storage_from_object[5 * a];
        t->offset[a] = round(v->storage_from_object[4 * a + 3]); /* the lattice's own origin */
    }
    for (uint32_t i = 0; i < t->cells->n_vertices && all; i++)
        for (int a = 0; a < 3; a++)
            all = all && narrowed(t, a, t->cells->vertex[i][a], &f32);
    return all;
}

static void put_triangle(const lr_triangle_tree *t, uint32_t triangle, int lane, uint32_t block)
{
    const double *p[3];
    lr_triangle_cell_corners(t->cells, triangle, p);
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++)
            if (t->narrow != NULL)
                narrowed(t, a, p[c][a], &t->narrow[block].corner[c][a][lane]);
            else
                t->blocks[block].corner[c][a][lane] = p[c][a];
    *triangle_in(t, block, lane) = triangle;
}

/* Put the triangles of a branch into a block from a lane on; returns the next lane. */
static int fill_block(const builder *b, const lr_hierarchy *binary, lr_child at, uint32_t block,
                      int lane)
{
    const uint32_t child = binary->nodes[at.node].child[at.side];
    if (child == LR_NOWHERE)
        return lane;
    if ((child & LR_LEAF) != 0) {
        put_triangle(b->tree, child & ~LR_LEAF, lane, block);
        return lane + 1;
    }
    for (int side = 0; side < 2; side++)
        lane = fill_block(b, binary, (lr_child){child, side}, block, lane);
    return lane;
}

/* Is there room for blocks, whose next is to be filled? At first its triangles have no size, so
 * that no ray meets them. */
static bool next_block(lr_triangle_tree *tree, uint32_t *number)
{
    const bool made = tree->blocks != NULL || tree->narrow != NULL;
    *number = tree->n_blocks++;
    for (int l = 0; l < LR_TREE_LANES && made; l++)
        *triangle_in(tree, *number, l) = LR_NO_TRIANGLE;
    return made;
}

static uint32_t make_block(void *own, const lr_hierarchy *binary, lr_child at)
{
    const builder *b = own;
    uint32_t number;
    if (next_block(b->tree, &number))
        fill_block(b, binary, at, number, 0);
    return number;
}

/* Room for the blocks that were counted. */
static lr_status get_room(void *own, lr_error *error)
{
    const builder *b = own;
    const size_t size = b->narrow ? sizeof *b->tree->narrow : sizeof *b->tree->blocks;
    const uint64_t wanted = b->tree->n_blocks * (uint64_t)size;
    void *room = lr_pages_new(b->tree->n_blocks, size);
    if (room == NULL)
        return lr_fail_memory(error, wanted, "a tree of triangles");
    if (b->narrow)
        b->tree->narrow = room;
    else
        b->tree->blocks = room;
    *b->nbytes += wanted;
    b->tree->n_blocks = 0;
    return LR_OK;
}

/* One block, and no node. */
static lr_status build_block(builder *b, lr_error *error)
{
    b->tree->n_blocks = 1;
    const lr_status status = get_room(b, error);
    if (status != LR_OK)
        return status;
    uint32_t number;
    next_block(b->tree, &number);
    for (uint32_t i = 0; i < b->cells->n_triangles; i++)
        put_triangle(b->tree, i, (int)i, number);
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

static lr_status build_nodes(builder *b, lr_error *error)
{
    const lr_triangle_cells *cells = b->cells;
    const size_t size = (size_t)cells->n_triangles * sizeof(lr_box);
    const lr_leaf_maker leaves = {LR_TREE_LANES, make_block, get_room, b};
    lr_hierarchy binary = {.nodes = NULL};
    lr_box *boxes = malloc(size);
    if (boxes == NULL)
        return lr_fail_memory(error, size, "the boxes of triangles");
    for (uint32_t i = 0; i < cells->n_triangles; i++)
        box_of(cells, i, &boxes[i]);
    lr_status status = lr_hierarchy_build(boxes, cells->n_triangles, LR_TREE_LANES, &binary, error);
    free(boxes);
    if (status == LR_OK)
        status = lr_wide_build(&binary, &leaves, &b->tree->boxes, error);
    *b->nbytes += b->tree->boxes.n_nodes * (uint64_t)sizeof *b->tree->boxes.nodes;
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
    t->cells = cells;
    *nbytes = sizeof *t;
    builder b = {cells, t, may_be_narrow(volume, t), nbytes};
    const lr_status status =
        cells->n_triangles <= LR_TREE_LANES ? build_block(&b, error) : build_nodes(&b, error);
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
    lr_pages_free(tree->boxes.nodes);
    lr_pages_free(tree->blocks);
    lr_pages_free(tree->narrow);
    free(tree);
}

/* ---- rays --------------------------------------------------------------- */

bool lr_tree_accepts(const lr_triangle_tree *tree, const lr_tree_ray *k, uint32_t triangle,
                     double t, bool inward)
{
    double n[3];
    if (k->side == 0)
        return true;
    lr_triangle_cell_normal(tree->cells, triangle, n);
    const double height = (t - k->t_min) * lr_plane_speed(&k->r, n);
    return height > k->off || inward == (k->side < 0);
}

const lr_tree_ops *lr_tree_ops_of(int32_t simd)
{
    return LR_BY_SIMD(simd, &lr_tree);
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

bool lr_tree_takes(const lr_trace_options *o)
{
    return o->mode == LR_MODE_SURFACE && o->hit_test >= 0 && o->hit_test < LR_HIT_UNIFORM &&
           o->root >= 0 && o->root <= LR_ROOT_CUBIC && o->normal >= 0 &&
           o->normal <= LR_NORMAL_ZUCKER_HUMMEL;
}

bool lr_tree_aim(const lr_structure *structure, const double o[3], const double d[3], double t_min,
                 const lr_start *start, const double *way, bool any, lr_tree_ray *k)
{
    const lr_volume *v = structure->volume;
    lr_cursor u;
    k->t_min = t_min;
    k->side = start != NULL ? start->side : 0;
    k->off = k->side != 0 ? lr_start_off(v) : 0.0;
    k->any = any;
    k->n_nodes = k->n_blocks = 0;
    if (!lr_ray_make(&k->r, v, o, d, INFINITY, true) || !(t_min < INFINITY) ||
        (k->side != 0 && !lr_leave(v, &k->r, &u, start, t_min, way)))
        return false;
    k->shear = lr_shear_of(&k->r);
    return structure->tree->boxes.n_nodes == 0 || lr_slabs_of(k->r.o, k->r.d, k->t_min, &k->slabs);
}

lr_tree_outcome lr_tree_meet(const lr_structure *structure, uint32_t branch, double t_max,
                             uint32_t triangle, lr_tree_ray *k)
{
    k->t = t_max;
    k->triangle = triangle;
    k->n_nodes = k->n_blocks = 0;
    if (!(k->t_min <= t_max))
        return LR_TREE_MISSES;
    lr_tree_ops_of(structure->tree->simd)->meet(structure->tree, branch, k);
    if (k->triangle != triangle)
        return LR_TREE_MEETS;
    return k->side > 0 && structure->volume->desc.kind == LR_KIND_SOLID ? LR_TREE_ASKS
                                                                        : LR_TREE_MISSES;
}

bool lr_tree_put(const lr_structure *structure, const lr_tree_ray *k, const double d[3],
                 int32_t normal_kind, const lr_hits *hits, uint64_t i)
{
    lr_found found = {.t = k->t, .triangle = k->triangle, .object = LR_NO_OBJECT};
    if (!find_cell(structure->volume, &k->r, k->t, &found))
        return false;
    lr_put_surface(structure->volume, hits, i, &found, d, normal_kind);
    return true;
}

/* Trace ray i by the tree and put its hit; false where only a walk through cells can tell. any: as
 * in lr_trace_scene. */
static bool trace_ray(const lr_structure *s, const lr_rays *rays, uint64_t i,
                      const lr_trace_options *options, bool any, const lr_hits *hits,
                      lr_counters *counters)
{
    lr_tree_ray k;
    const double o[3] = {rays->ox[i], rays->oy[i], rays->oz[i]};
    const double d[3] = {rays->dx[i], rays->dy[i], rays->dz[i]};
    const double t_min = rays->t_min != NULL ? rays->t_min[i] : 0.0;
    const double t_max = rays->t_max != NULL ? rays->t_max[i] : INFINITY;
    const lr_start *start = rays->start != NULL ? &rays->start[i] : NULL;
    lr_put_miss(hits, i);
    const lr_tree_outcome outcome =
        lr_tree_aim(s, o, d, t_min, start, lr_way_of(rays, i), any, &k)
            ? lr_tree_meet(s, lr_tree_root(s->tree), t_max, LR_NO_TRIANGLE, &k)
            : LR_TREE_MISSES;
    if (outcome == LR_TREE_ASKS)
        return false;
    if (outcome == LR_TREE_MEETS && any)
        hits->t[i] = k.t;
    else if (outcome == LR_TREE_MEETS && !lr_tree_put(s, &k, d, options->normal, hits, i))
        return false;
    if (counters != NULL) {
        counters->rays++;
        counters->pairs++;
        counters->in_lanes++;
        counters->nodes += k.n_nodes;
        counters->tests += k.n_blocks;
        counters->hits += outcome == LR_TREE_MEETS;
    }
    return true;
}

/* The arrays of rays and hits from ray i on. */
static void skip(uint64_t i, lr_rays *rays, lr_hits *hits)
{
#define SKIP(of, field) of->field = of->field != NULL ? of->field + i : NULL
    SKIP(rays, ox), SKIP(rays, oy), SKIP(rays, oz), SKIP(rays, dx), SKIP(rays, dy);
    SKIP(rays, dz), SKIP(rays, t_min), SKIP(rays, t_max), SKIP(rays, start), SKIP(rays, length);
    SKIP(rays, way);
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
        if (trace_ray(s, rays, i, options, any, hits, counters))
            continue;
        skip(i, &own, &to);
        status = s->ops->trace(s->volume, s->data, &own, 1, options, &to, counters, watch, error);
    }
    return status;
}
