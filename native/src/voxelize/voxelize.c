/* Mesh to volume: the public calls and their stages.
 *
 *   set-up      links the mesh's edges, and lists the triangles of each brick
 *   components  of the band, if pseudonormals do not give the sides
 *   winding     numbers of the components
 *   bricks      filtered distances
 *   cells       chooses the cells that keep triangles, if the job asks for some
 *
 * A solid with wide holes needs no components: its holes are filled brick by brick
 * (hole_fill.h).
 * The parts of a stage run side by side and share nothing that they write. Bricks
 * whose pseudonormals contradict each other are made again with winding numbers.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/cpu.h"
#include "grid/attributes/triangle_attributes.h"
#include "grid/classify_cells.h"
#include "mesh/link_edges.h"
#include "voxelize/brick_jobs.h"
#include "voxelize/cell_tests.h"
#include "voxelize/filter_profile.h"
#include "voxelize/flood_fill.h"
#include "voxelize/hole_fill.h"
#include "voxelize/scratch.h"

/* Central differences at the corners of a surface cell use samples up to sqrt(6) from the
 * surface (offsets 2, 1, 1); the rest is for rounding. The lattice has these samples, and a
 * sheet needs their heights. A solid's samples beyond the ramp are 0 or 1, so its band only
 * has to contain the corners of surface cells, at most sqrt(3) away, for their ids. */
#define STENCIL 2.4495
#define CORNERS 1.7321

enum { ROOTS = 4096 /* components of a part of the winding stage */ };

/* ---- filters ----------------------------------------------------------- */

lr_status lr_filter_get(int32_t filter, int32_t sample_type, lr_filter_info *info, lr_error *error)
{
    lr_status status = lr_check_choice("filter", filter, LR_FILTER_LAST, error);
    if (status == LR_OK)
        status = lr_sample_type_check(sample_type, error);
    if (status == LR_OK)
        *info = (lr_filter_info){.half_width = lr_profile_half_width(filter, sample_type),
                                 .widest = lr_profile_widest(filter),
                                 .of_solids = lr_profile_of_solids(filter)};
    return status;
}

double lr_filter_slope(int32_t filter, double half_width)
{
    return lr_profile_slope(filter, half_width);
}

/* ---- begin ------------------------------------------------------------- */

static lr_status check_options(const lr_voxelize_options *o, lr_error *error)
{
    if (!(o->voxel_size >= 1e-100 && o->voxel_size <= 1e100))
        return lr_fail(error, LR_E_ARGUMENT, "voxel_size must be positive and finite; it is %g",
                       o->voxel_size);
    lr_filter_info filter;
    lr_status status = lr_filter_get(o->filter, o->sample_type, &filter, error);
    if (status == LR_OK && !(o->half_width > 0.0 && o->half_width <= filter.widest))
        status = lr_fail(error, LR_E_ARGUMENT, "half_width must lie in (0, %.3g] voxels; it is %g",
                         filter.widest, o->half_width);
    if (status == LR_OK)
        status = lr_check_choice("kind", o->kind, LR_KIND_SHEET, error);
    return status == LR_OK ? lr_check_choice("exact", o->exact, LR_EXACT_EVERY, error) : status;
}

/* The lattice lies on multiples of the voxel size, with the band and one more
 * sample around the mesh. */
static lr_status place_lattice(lr_voxelizer *v, lr_error *error)
{
    const lr_voxelize_options *o = &v->options;
    lr_topology *m = &v->mesh;
    lr_volume_desc *desc = &v->desc;
    const double radius = lr_profile_radius(o->filter, o->half_width);
    double margin = ceil(fmax(radius, STENCIL)) + 1.0, first[3], n[3], n_table = 1.0;
    for (int a = 0; a < 3; a++) {
        first[a] = floor(m->lo[a] * m->per_unit) - margin;
        n[a] = ceil(m->hi[a] * m->per_unit) + margin - first[a] + 1.0;
        n_table *= ceil((n[a] + 2.0 * LR_PAD) / LR_SIDE);
    }
    if (!(n_table <= LR_MOST_TABLE))
        return lr_fail(error, LR_E_SIZE,
                       "a mesh of %g x %g x %g with a voxel_size of %g wants %.0f x %.0f x %.0f "
                       "samples, more than fit (4096^3); use a larger voxel_size",
                       m->hi[0] - m->lo[0], m->hi[1] - m->lo[1], m->hi[2] - m->lo[2], o->voxel_size,
                       n[0], n[1], n[2]);
    *desc = (lr_volume_desc){.nx = (int32_t)n[0],
                             .ny = (int32_t)n[1],
                             .nz = (int32_t)n[2],
                             .sample_type = o->sample_type,
                             .kind = LR_KIND_SOLID, /* until it is decided */
                             .has_ids = m->source.ids != NULL,
                             .threshold = 0.5,
                             .inside = 1.0};
    for (int a = 0; a < 3; a++) {
        desc->object_from_index[5 * a] = o->voxel_size;
        desc->object_from_index[4 * a + 3] = first[a] * o->voxel_size;
        m->origin[a] = first[a] - LR_PAD;
        v->job.size[a] = (int32_t)n[a];
    }
    desc->object_from_index[15] = 1.0;
    return LR_OK;
}

/* Of the band; kind is LR_KIND_SOLID or LR_KIND_SHEET. */
static double band_of(const lr_voxelize_options *o, int32_t kind)
{
    bool wide = kind == LR_KIND_SHEET || o->exact == LR_EXACT_ALL || o->exact == LR_EXACT_EVERY;
    return fmax(lr_profile_radius(o->filter, o->half_width), wide ? STENCIL : CORNERS);
}

static lr_status prepare(lr_voxelizer *v, const lr_mesh *mesh, const lr_watch *watch,
                         lr_error *error)
{
    const lr_voxelize_options *o = &v->options;
    lr_status status = lr_cpu_choose(o->simd, &v->simd, error);
    v->job = (lr_voxel_job){
        .mesh = &v->mesh, .filter = o->filter, .half_width = o->half_width, .flat = o->flat != 0};
    v->job.search = LR_BY_SIMD(v->simd, lr_nearest);
    v->job.test_cells = LR_BY_SIMD(v->simd, lr_test_cells);
    if (status == LR_OK)
        status = lr_topology_begin(mesh, o->voxel_size, watch, &v->mesh, error);
    if (status == LR_OK)
        status = lr_check_attributes(mesh, watch, &v->job.attributes, error);
    if (status == LR_OK)
        status = place_lattice(v, error);
    if (status == LR_OK)
        status = lr_volume_begin(&v->desc, &v->volume, error);
    if (status == LR_OK)
        memcpy(v->job.table_size, v->volume->table_size, sizeof v->job.table_size);
    return status;
}

static void note_scratch(lr_voxelizer *v)
{
    const uint64_t now = lr_voxelizer_scratch(v);
    v->scratch_nbytes = now > v->scratch_nbytes ? now : v->scratch_nbytes;
}

lr_status lr_voxelize_begin(const lr_mesh *mesh, const lr_voxelize_options *options,
                            const lr_watch *watch, lr_voxelizer **voxelizer, lr_error *error)
{
    lr_status status = check_options(options, error);
    if (status != LR_OK)
        return status;
    lr_voxelizer *v = calloc(1, sizeof *v);
    if (v == NULL)
        return lr_fail_memory(error, sizeof *v, "a voxelizer");
    v->options = *options;
    status = prepare(v, mesh, watch, error);
    if (status != LR_OK) {
        lr_voxelizer_free(v);
        return status;
    }
    note_scratch(v);
    *voxelizer = v;
    return LR_OK;
}

void lr_voxelizer_get_info(const lr_voxelizer *v, lr_voxelizer_info *info)
{
    const lr_volume_desc *d = &v->desc;
    const int32_t n[3] = {d->nx, d->ny, d->nz};
    const lr_attribute_set *set = &v->job.attributes;
    const uint64_t brick_nbytes = lr_volume_brick_nbytes(d->sample_type, d->has_ids) +
                                  set->any * LR_WORDS * lr_volume_block_nbytes();
    const uint64_t n_faces = set->any ? v->mesh.source.n_triangles : 0;
    const uint64_t faces_nbytes =
        n_faces * lr_face_nbytes(set->normals, set->sources, set->colors, set->uvs);
    *info = (lr_voxelizer_info){
        .desc = *d,
        .nbytes = v->stage > LR_STAGE_SET_UP
                      ? lr_volume_table_nbytes(n) + (uint64_t)v->bins.n_active * brick_nbytes +
                            faces_nbytes
                      : 0,
        .n_border_edges = v->mesh.n_border_edges,
        .n_bad_edges = v->mesh.n_bad_edges,
        .n_degenerate = v->mesh.n_degenerate,
        .inverted = v->mesh.side < 0.0,
        .simd = v->simd,
        .stage = v->stage,
        .reason = v->mesh_kind.reason,
        .by_winding = v->by_winding,
        .hole = v->mesh_kind.hole,
        .scratch_nbytes = v->scratch_nbytes,
    };
    for (uint32_t i = 0; v->chosen != NULL && i < v->bins.n_parts; i++)
        info->nbytes += lr_cells_nbytes(&v->chosen[i]);
}

/* ---- stages ------------------------------------------------------------ */

static lr_status open_stage(lr_voxelizer *v, lr_stage stage, uint32_t n_parts, lr_error *error)
{
    free(v->ran);
    v->ran = calloc((size_t)n_parts + 1, sizeof *v->ran);
    if (v->ran == NULL)
        return lr_fail_memory(error, n_parts, "a list of parts");
    v->stage = stage;
    v->n_parts = n_parts;
    return LR_OK;
}

static lr_status bin(lr_voxelizer *v, int32_t kind, bool all, const lr_watch *watch,
                     lr_error *error)
{
    v->job.band = band_of(&v->options, kind);
    lr_bins_free(&v->bins);
    return lr_bins_make(&v->mesh, v->job.table_size, v->job.band, all, watch, &v->bins, error);
}

/* Solid or sheet, and why. */
static lr_status decide_kind(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    const int32_t kind = v->options.kind;
    v->mesh_kind.reason = kind == LR_KIND_AUTO ? LR_REASON_CLOSED : LR_REASON_ASKED;
    v->mesh_kind.solid = kind != LR_KIND_SHEET;
    if (v->mesh.closed || kind == LR_KIND_SHEET)
        return LR_OK;
    lr_status status = LR_OK;
    bool open = false;
    const lr_mesh_kind requested = v->mesh_kind;
    status = lr_mesh_kind_by_edges(&v->mesh, watch, &v->mesh_kind, &open, error);
    if (kind == LR_KIND_SOLID) {
        v->mesh_kind.solid = requested.solid;
        v->mesh_kind.reason = requested.reason;
    }
    if (status != LR_OK || (open && kind == LR_KIND_AUTO))
        return status;
    status = lr_winding_make(&v->mesh, watch, &v->winding, error);
    if (status == LR_OK && kind == LR_KIND_AUTO)
        status = lr_mesh_kind_by_probes(&v->winding, watch, &v->mesh_kind, error);
    v->by_winding = v->mesh_kind.solid;
    return status;
}

static lr_status open_bricks(lr_voxelizer *v, lr_error *error)
{
    lr_parts_free(v);
    v->parts = calloc((size_t)v->bins.n_parts + 1, sizeof *v->parts);
    if (v->parts == NULL)
        return lr_fail_memory(error, v->bins.n_parts * sizeof *v->parts, "a list of parts");
    const lr_status status = lr_parts_begin(v, error);
    return status == LR_OK ? open_stage(v, LR_STAGE_BRICKS, v->bins.n_parts, error) : status;
}

static lr_status open_components(lr_voxelizer *v, lr_error *error)
{
    lr_status status = lr_components_begin(&v->bins, &v->components, error);
    return status == LR_OK ? open_stage(v, LR_STAGE_COMPONENTS, v->bins.n_parts, error) : status;
}

static lr_status close_set_up(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    const lr_voxelize_options *o = &v->options;
    lr_status status = decide_kind(v, watch, error);
    if (status != LR_OK)
        return status;
    v->job.sheet = !v->mesh_kind.solid;
    if (v->job.sheet && lr_profile_of_solids(o->filter))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the filters box and binary tell inside from outside, but the mesh is taken "
                       "for a sheet, which has neither; use ramp, cone or gauss, or kind solid");
    v->desc.kind = v->job.sheet ? LR_KIND_SHEET : LR_KIND_SOLID;
    v->volume->desc.kind = v->desc.kind;
    v->job.every = o->exact == LR_EXACT_EVERY;
    v->job.exact =
        v->job.every || o->exact == LR_EXACT_ALL || (o->exact == LR_EXACT_SHEETS && v->job.sheet);
    if (band_of(o, v->desc.kind) != v->job.band || v->mesh.twin != NULL)
        status = bin(v, v->desc.kind, false, watch, error);
    if (status == LR_OK && v->by_winding && v->mesh_kind.wide) {
        v->job.hole_fill = &v->winding;
        status = lr_hole_fill_bricks(&v->winding, v->job.table_size, v->job.band, watch, &v->bins,
                                     error);
    }
    v->verdicts = calloc((size_t)v->bins.n_active + 1, sizeof *v->verdicts);
    if (status == LR_OK && v->verdicts == NULL)
        status =
            lr_fail_memory(error, v->bins.n_active * sizeof *v->verdicts, "the bricks' states");
    if (status != LR_OK)
        return status;
    return v->by_winding && v->job.hole_fill == NULL ? open_components(v, error)
                                                     : open_bricks(v, error);
}

static lr_status close_components(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    lr_status status = lr_components_join(&v->components, &v->job, &v->bins, watch, error);
    uint32_t n_parts = v->components.n_roots / ROOTS + 1;
    return status == LR_OK ? open_stage(v, LR_STAGE_WINDING, n_parts, error) : status;
}

static lr_status decide_components(lr_voxelizer *v, uint32_t part, const lr_watch *watch,
                                   lr_error *error)
{
    uint32_t first = part * ROOTS, left = v->components.n_roots - first;
    uint32_t end = first + (left < ROOTS ? left : ROOTS);
    return lr_components_decide(&v->components, &v->job, &v->bins, &v->winding, first, end, watch)
               ? LR_OK
               : lr_fail_stopped(error);
}

/* Restart the bricks, with sides by winding numbers. */
static lr_status fall_back(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    lr_volume_empty_table(v->volume);
    v->by_winding = true;
    if (v->mesh_kind.reason == LR_REASON_CLOSED)
        v->mesh_kind.reason = LR_REASON_CROSSING;
    lr_status status = lr_winding_make(&v->mesh, watch, &v->winding, error);
    return status == LR_OK ? open_components(v, error) : status;
}

static lr_status close_bricks(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    bool contradicts = false;
    lr_status status = LR_OK;
    if (!v->job.sheet)
        status = lr_between_decide(v, watch, &contradicts, error);
    for (uint32_t i = 0; i < v->bins.n_active; i++)
        contradicts = contradicts || v->verdicts[i].contradicts;
    if (status == LR_OK && contradicts && !v->by_winding && !v->job.sheet)
        return fall_back(v, watch, error);
    lr_components_free(&v->components, &v->bins);
    lr_winding_free(&v->winding);
    v->job.hole_fill = NULL;
    if (status == LR_OK)
        status = lr_parts_move(v, watch, error);
    if (status != LR_OK || !v->job.exact)
        return status == LR_OK ? open_stage(v, LR_STAGE_DONE, 0, error) : status;
    v->chosen = calloc((size_t)v->bins.n_parts + 1, sizeof *v->chosen);
    if (v->chosen == NULL)
        return lr_fail_memory(error, v->bins.n_parts * sizeof *v->chosen, "a list of parts");
    return open_stage(v, LR_STAGE_CELLS, v->bins.n_parts, error);
}

static lr_status open_next(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    switch ((lr_stage)v->stage) {
    case LR_STAGE_NONE:
        return open_stage(v, LR_STAGE_SET_UP, 2, error);
    case LR_STAGE_SET_UP:
        return close_set_up(v, watch, error);
    case LR_STAGE_COMPONENTS:
        return close_components(v, watch, error);
    case LR_STAGE_WINDING:
        lr_components_spread(&v->components);
        return open_bricks(v, error);
    case LR_STAGE_BRICKS:
        return close_bricks(v, watch, error);
    default:
        return open_stage(v, LR_STAGE_DONE, 0, error);
    }
}

lr_status lr_voxelize_next(lr_voxelizer *v, const lr_watch *watch, uint64_t *n_parts,
                           lr_error *error)
{
    for (uint32_t i = 0; i < v->n_parts; i++)
        if (!v->ran[i])
            return lr_fail(error, LR_E_ARGUMENT, "part %u of %u has not been run", i, v->n_parts);
    lr_status status;
    do
        status = open_next(v, watch, error);
    while (status == LR_OK && v->n_parts == 0 && v->stage != LR_STAGE_DONE);
    note_scratch(v);
    *n_parts = v->n_parts;
    return status;
}

static lr_status choose_cells(lr_voxelizer *v, uint32_t part, const lr_watch *watch,
                              lr_error *error)
{
    lr_status status = lr_cells_make(&v->job, v->volume, &v->bins, v->bins.part[part],
                                     v->bins.part[part + 1], watch, &v->chosen[part], error);
    if (status != LR_OK)
        lr_cells_free(&v->chosen[part]);
    return status;
}

static lr_status run(lr_voxelizer *v, uint32_t part, const lr_watch *watch, lr_error *error)
{
    switch ((lr_stage)v->stage) {
    case LR_STAGE_SET_UP:
        return part == 0 ? lr_topology_link(&v->mesh, watch, error)
                         : bin(v, v->options.kind == LR_KIND_SHEET ? LR_KIND_SHEET : LR_KIND_SOLID,
                               true, watch, error);
    case LR_STAGE_COMPONENTS:
        return lr_part_components(v, part, watch, error);
    case LR_STAGE_WINDING:
        return decide_components(v, part, watch, error);
    case LR_STAGE_CELLS:
        return choose_cells(v, part, watch, error);
    default:
        return lr_part_run(v, part, watch, error);
    }
}

lr_status lr_voxelize_part(lr_voxelizer *v, uint64_t index, const lr_watch *watch, lr_error *error)
{
    if (index >= v->n_parts || v->ran[index])
        return lr_fail(error, LR_E_ARGUMENT, "part %llu of %u was run before or does not exist",
                       (unsigned long long)index, v->n_parts);
    lr_status status = run(v, (uint32_t)index, watch, error);
    v->ran[index] = status == LR_OK;
    if (status == LR_OK)
        lr_progress(watch, 1.0);
    return status;
}

/* ---- end --------------------------------------------------------------- */

/* The cells of a sheet in which its field holds: those near a triangle. */
static lr_status mark_near(lr_voxelizer *v, lr_error *error)
{
    lr_status status = LR_OK;
    for (uint32_t i = 0; i < v->bins.n_parts && v->job.sheet; i++)
        for (uint32_t k = 0; k < v->chosen[i].n && status == LR_OK; k++)
            status = lr_volume_touch(v->volume, v->chosen[i].place[k], v->chosen[i].near[k], error);
    return status;
}

static void vertex_of(const void *mesh, int64_t v, double p[3])
{
    lr_vertex(mesh, v, p);
}

static lr_status finish_triangle_cells(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    const lr_triangle_cells_source source = {
        .triangles = v->mesh.source.triangles,
        .n_triangles = v->mesh.source.n_triangles,
        .n_vertices = v->mesh.source.n_vertices,
        .ids = v->mesh.source.ids,
        .turned = v->mesh.side < 0.0,
        .faces = v->job.attributes.any,
        .slope = lr_profile_slope(v->job.filter, v->job.half_width),
        .vertex = vertex_of,
        .mesh = &v->mesh,
    };
    lr_triangle_cells_part *parts = calloc((size_t)v->bins.n_parts + 1, sizeof *parts);
    if (parts == NULL)
        return lr_fail_memory(error, v->bins.n_parts * sizeof *parts, "a list of parts");
    for (uint32_t i = 0; i < v->bins.n_parts; i++)
        parts[i] = v->chosen[i].exact;
    lr_status status =
        lr_volume_finish_triangle_cells(v->volume, parts, v->bins.n_parts, &source, watch, error);
    free(parts);
    return status;
}

lr_status lr_voxelize_end(lr_voxelizer *v, const lr_watch *watch, lr_volume **volume,
                          lr_error *error)
{
    if (v->stage != LR_STAGE_DONE || v->volume == NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       v->volume == NULL ? "the volume of this voxelizer was made before"
                                         : "the stages of this voxelizer have not all been run");
    lr_topology_unlink(&v->mesh);
    lr_status status = v->chosen != NULL ? mark_near(v, error) : LR_OK;
    if (status == LR_OK)
        status = v->chosen != NULL ? finish_triangle_cells(v, watch, error)
                                   : lr_volume_finish(v->volume, watch, error);
    if (status == LR_OK && v->job.attributes.any)
        status = lr_keep_attributes(&v->job.attributes, &v->mesh, v->volume, watch, error);
    if (status != LR_OK)
        return status;
    v->volume->flat = v->job.flat;
    *volume = v->volume;
    v->volume = NULL;
    return LR_OK;
}

void lr_voxelizer_free(lr_voxelizer *v)
{
    if (v == NULL)
        return;
    lr_parts_free(v);
    for (uint32_t i = 0; v->chosen != NULL && i < v->bins.n_parts; i++)
        lr_cells_free(&v->chosen[i]);
    lr_components_free(&v->components, &v->bins);
    lr_winding_free(&v->winding);
    free(v->ran);
    free(v->verdicts);
    free(v->chosen);
    lr_topology_free(&v->mesh);
    lr_bins_free(&v->bins);
    lr_volume_free(v->volume);
    free(v);
}
