/* Mesh to volume: the public calls, the parts and what lies between bricks.
 *
 * A part makes its bricks one after another and keeps those that are not
 * constant, in blocks of its own, so parts share nothing that they write but
 * their bricks' states. At the end, bricks that no triangle came near take the
 * side of the bricks around them: face-connected ones are of one side, which
 * the samples on the faces around them vote for; those that reach the border
 * of the table are outside. Then all samples are known, and where exact cells are
 * wanted every part runs again to judge the cells of its bricks.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "cpu.h"
#include "voxel/brick.h"
#include "voxel/cells.h"
#include "voxel/profile.h"

/* A 4096^3 lattice; the tables of its bricks take 1.2 GB. */
#define MOST_TABLE 134217728.0
#define WIDEST     32.0 /* reach of a filter, voxels */

/* Central differences at the corners of a surface cell reach sqrt(6) from the
 * surface (samples at offsets 2, 1, 1); the rest is for rounding. The lattice
 * has room for them, and a sheet wants its heights there. A solid's samples
 * beyond the ramp are 0 or 1, so its band only has to hold the corners of surface
 * cells, at most sqrt(3) away, for their ids. */
#define STENCIL 2.4495
#define CORNERS 1.7321

typedef struct part {
    uint32_t n;             /* mixed bricks */
    uint32_t *brick;        /* [n]: places in the table */
    unsigned char *samples; /* [n][512] */
    uint16_t *ids;          /* [n][512], or NULL */
    uint64_t (*touched)[8]; /* [n], of sheets */
    uint32_t *block_of;     /* [n]: 1 + block of attributes, or 0; NULL without */
    uint32_t n_blocks;
    uint32_t *colors, *normals; /* [n_blocks][512], or NULL */
    bool done;
} part;

typedef struct verdict {
    uint8_t state;  /* lr_brick_state */
    int8_t face[6]; /* as in lr_brick */
} verdict;

struct lr_voxelizer {
    lr_topology mesh;
    lr_bins bins;
    lr_voxel_job job;
    lr_volume_desc desc; /* of the volume */
    lr_volume *volume;   /* NULL once it is given away */
    part *parts;
    verdict *verdicts; /* [n_active] */
    int32_t simd;      /* lr_simd in use */
    lr_cells_part *cells; /* [n_parts], or NULL */
    bool *judged;         /* [n_parts] */
    bool joined;          /* the parts' bricks are in the volume */
};

/* ---- begin ------------------------------------------------------------- */

static lr_status check_options(const lr_voxelize_options *o, lr_error *error)
{
    if (!(o->voxel_size >= 1e-100 && o->voxel_size <= 1e100))
        return lr_fail(error, LR_E_ARGUMENT, "voxel_size must be positive and finite; it is %g",
                       o->voxel_size);
    if (o->filter < LR_FILTER_RAMP || o->filter > LR_FILTER_BINARY)
        return lr_fail(error, LR_E_ARGUMENT,
                       "filter %d is none of ramp (0), box (1), cone (2), gauss (3), binary (4)",
                       o->filter);
    const double widest = o->filter == LR_FILTER_GAUSS ? WIDEST / LR_GAUSS_REACH : WIDEST;
    if (!(o->half_width > 0.0 && o->half_width <= widest))
        return lr_fail(error, LR_E_ARGUMENT, "half_width must lie in (0, %.3g] voxels; it is %g",
                       widest, o->half_width);
    if (o->kind < LR_KIND_AUTO || o->kind > LR_KIND_SHEET)
        return lr_fail(error, LR_E_ARGUMENT, "kind %d is none of auto (0), solid (1), sheet (2)",
                       o->kind);
    if (o->sample_type < LR_U8 || o->sample_type > LR_F32)
        return lr_fail(error, LR_E_ARGUMENT, "sample type %d is none of u8 (0), u16 (1), f32 (2)",
                       o->sample_type);
    if (o->exact < LR_EXACT_SHEETS || o->exact > LR_EXACT_NONE)
        return lr_fail(error, LR_E_ARGUMENT,
                       "exact cells %d are none of sheets (0), all (1), none (2)", o->exact);
    return LR_OK;
}

/* The lattice lies on multiples of the voxel size, with the band and one more
 * sample around the mesh. */
static lr_status place_lattice(lr_voxelizer *v, const lr_voxelize_options *o, lr_error *error)
{
    lr_topology *m = &v->mesh;
    lr_volume_desc *desc = &v->desc;
    const double reach = lr_profile_reach(o->filter, o->half_width);
    double margin = ceil(fmax(reach, STENCIL)) + 1.0, first[3], n[3], n_table = 1.0;
    for (int a = 0; a < 3; a++) {
        first[a] = floor(m->lo[a] * m->per_unit) - margin;
        n[a] = ceil(m->hi[a] * m->per_unit) + margin - first[a] + 1.0;
        n_table *= ceil((n[a] + 2.0 * LR_PAD) / 8.0);
    }
    if (!(n_table <= MOST_TABLE))
        return lr_fail(error, LR_E_SIZE,
                       "a mesh of %g x %g x %g with a voxel_size of %g wants %.0f x %.0f x %.0f "
                       "samples, more than fit (4096^3); use a larger voxel_size",
                       m->hi[0] - m->lo[0], m->hi[1] - m->lo[1], m->hi[2] - m->lo[2], o->voxel_size,
                       n[0], n[1], n[2]);
    bool solid = o->kind == LR_KIND_AUTO ? m->closed : o->kind == LR_KIND_SOLID;
    if (!solid && (o->filter == LR_FILTER_BOX || o->filter == LR_FILTER_BINARY))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the filters box and binary tell inside from outside, but the mesh is taken "
                       "for a sheet, which has neither; use ramp, cone or gauss, or kind solid");
    *desc = (lr_volume_desc){.nx = (int32_t)n[0],
                             .ny = (int32_t)n[1],
                             .nz = (int32_t)n[2],
                             .sample_type = o->sample_type,
                             .kind = solid ? LR_KIND_SOLID : LR_KIND_SHEET,
                             .has_ids = m->source.ids != NULL,
                             .threshold = 0.5};
    for (int a = 0; a < 3; a++) {
        desc->object_from_index[5 * a] = o->voxel_size;
        desc->object_from_index[4 * a + 3] = first[a] * o->voxel_size;
        m->origin[a] = first[a] - LR_PAD;
        v->job.size[a] = (int32_t)n[a];
    }
    desc->object_from_index[15] = 1.0;
    return LR_OK;
}

static lr_nearest_search *search_by(int32_t simd)
{
    return simd == LR_SIMD_AVX512 ? lr_nearest_avx512
           : simd == LR_SIMD_AVX2 ? lr_nearest_avx2
                                  : lr_nearest_portable;
}

static lr_status prepare(lr_voxelizer *v, const lr_mesh *mesh, const lr_voxelize_options *o,
                         const lr_watch *watch, lr_error *error)
{
    v->job = (lr_voxel_job){.mesh = &v->mesh,
                            .search = search_by(v->simd),
                            .filter = o->filter,
                            .half_width = o->half_width,
                            .sample_type = o->sample_type};
    lr_status status = lr_topology_make(mesh, o->voxel_size, watch, &v->mesh, error);
    if (status == LR_OK)
        status = lr_bake_check(mesh, watch, &v->job.bake, error);
    if (status == LR_OK)
        status = place_lattice(v, o, error);
    if (status == LR_OK)
        status = lr_volume_begin(&v->desc, &v->volume, error);
    if (status != LR_OK)
        return status;
    v->job.sheet = v->desc.kind == LR_KIND_SHEET;
    v->job.exact = o->exact == LR_EXACT_ALL || (o->exact == LR_EXACT_SHEETS && v->job.sheet);
    v->job.band =
        fmax(lr_profile_reach(o->filter, o->half_width), v->job.sheet || v->job.exact ? STENCIL : CORNERS);
    memcpy(v->job.table_size, v->volume->table_size, sizeof v->job.table_size);
    status = lr_bins_make(&v->mesh, v->job.table_size, v->job.band, watch, &v->bins, error);
    if (status != LR_OK)
        return status;
    v->parts = calloc((size_t)v->bins.n_parts + 1, sizeof *v->parts);
    v->verdicts = calloc((size_t)v->bins.n_active + 1, sizeof *v->verdicts);
    if (v->job.exact) {
        v->cells = calloc((size_t)v->bins.n_parts + 1, sizeof *v->cells);
        v->judged = calloc((size_t)v->bins.n_parts + 1, sizeof *v->judged);
    }
    if (v->parts == NULL || v->verdicts == NULL ||
        (v->job.exact && (v->cells == NULL || v->judged == NULL)))
        return lr_fail_memory(error, v->bins.n_active * sizeof *v->verdicts, "the bricks' states");
    return LR_OK;
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
    status = lr_cpu_choose(options->simd, &v->simd, error);
    if (status == LR_OK)
        status = prepare(v, mesh, options, watch, error);
    if (status != LR_OK) {
        lr_voxelizer_free(v);
        return status;
    }
    *voxelizer = v;
    return LR_OK;
}

void lr_voxelizer_get_info(const lr_voxelizer *v, lr_voxelizer_info *info)
{
    const lr_volume_desc *d = &v->desc;
    const int32_t n[3] = {d->nx, d->ny, d->nz};
    const uint64_t brick_nbytes =
        lr_volume_brick_nbytes(d->sample_type, d->has_ids) +
        8 * lr_volume_block_nbytes(v->job.bake.colors, v->job.bake.normals);
    *info = (lr_voxelizer_info){
        .desc = *d,
        .n_parts = v->bins.n_parts,
        .nbytes = lr_volume_table_nbytes(n) + (uint64_t)v->bins.n_active * brick_nbytes,
        .n_border_edges = v->mesh.n_border_edges,
        .n_bad_edges = v->mesh.n_bad_edges,
        .n_degenerate = v->mesh.n_degenerate,
        .inverted = v->mesh.side < 0.0,
        .simd = v->simd,
        .has_cells = v->job.exact,
    };
    for (uint32_t i = 0; v->cells != NULL && i < v->bins.n_parts; i++)
        info->nbytes += lr_cells_nbytes(&v->cells[i]);
}

/* ---- parts ------------------------------------------------------------- */

static void free_part(part *p)
{
    free(p->brick);
    free(p->samples);
    free(p->ids);
    free(p->touched);
    free(p->block_of);
    free(p->colors);
    free(p->normals);
    *p = (part){.done = p->done};
}

static bool has_room(const lr_voxelizer *v, part *p, size_t n)
{
    size_t sample_nbytes = LR_BRICK_SAMPLES * lr_sample_nbytes(v->job.sample_type);
    p->brick = malloc(n * sizeof *p->brick);
    p->samples = malloc(n * sample_nbytes);
    if (v->mesh.source.ids != NULL)
        p->ids = malloc(n * LR_BRICK_SAMPLES * sizeof *p->ids);
    if (v->job.sheet)
        p->touched = malloc(n * sizeof *p->touched);
    const lr_bake *bake = &v->job.bake;
    if (bake->colors || bake->normals)
        p->block_of = malloc(n * sizeof *p->block_of);
    if (bake->colors)
        p->colors = malloc(n * LR_BRICK_SAMPLES * sizeof *p->colors);
    if (bake->normals)
        p->normals = malloc(n * LR_BRICK_SAMPLES * sizeof *p->normals);
    return p->brick != NULL && p->samples != NULL &&
           (v->mesh.source.ids == NULL || p->ids != NULL) &&
           (!v->job.sheet || p->touched != NULL) &&
           ((!bake->colors && !bake->normals) || p->block_of != NULL) &&
           (!bake->colors || p->colors != NULL) && (!bake->normals || p->normals != NULL);
}

/* Where the next brick's attributes go. */
static void offer_block(const part *p, lr_scratch *scratch)
{
    size_t at = (size_t)p->n_blocks * LR_BRICK_SAMPLES;
    scratch->colors = p->colors != NULL ? p->colors + at : NULL;
    scratch->normals = p->normals != NULL ? p->normals + at : NULL;
}

static void keep(const lr_voxelizer *v, uint32_t at, const lr_brick *brick, part *p)
{
    size_t first = (size_t)p->n * LR_BRICK_SAMPLES;
    for (size_t i = 0; i < LR_BRICK_SAMPLES; i++) {
        float g = brick->value[i];
        if (v->job.sample_type == LR_U8)
            p->samples[first + i] = (unsigned char)(g * 255.0f + 0.5f);
        else if (v->job.sample_type == LR_U16)
            ((uint16_t *)(void *)p->samples)[first + i] = (uint16_t)(g * 65535.0f + 0.5f);
        else
            ((float *)(void *)p->samples)[first + i] = g;
    }
    if (p->ids != NULL)
        memcpy(p->ids + first, brick->id, sizeof brick->id);
    if (p->touched != NULL)
        memcpy(p->touched[p->n], brick->touched, sizeof brick->touched);
    if (p->block_of != NULL)
        p->block_of[p->n] = brick->dressed ? ++p->n_blocks : 0;
    p->brick[p->n++] = at;
}

static bool run_part(lr_voxelizer *v, uint32_t first, uint32_t end, const lr_watch *watch,
                     lr_scratch *scratch, part *p)
{
    lr_brick brick;
    for (uint32_t i = first; i < end; i++) {
        if (lr_stopped(watch))
            return false;
        lr_progress(watch, (double)(i - first) / (double)(end - first));
        uint64_t list = v->bins.start[i];
        uint32_t n = (uint32_t)(v->bins.start[i + 1] - list);
        offer_block(p, scratch);
        if (!lr_brick_make(&v->job, v->bins.brick[i], v->bins.list + list, n, watch, scratch,
                           &brick))
            return false;
        v->verdicts[i].state = (uint8_t)brick.state;
        memcpy(v->verdicts[i].face, brick.face, sizeof brick.face);
        if (brick.state == LR_STATE_MIXED)
            keep(v, v->bins.brick[i], &brick, p);
    }
    return true;
}

lr_status lr_voxelize_part(lr_voxelizer *v, uint64_t index, const lr_watch *watch, lr_error *error)
{
    if (index >= v->bins.n_parts || v->parts[index].done)
        return lr_fail(error, LR_E_ARGUMENT, "part %llu of %u was run before or does not exist",
                       (unsigned long long)index, v->bins.n_parts);
    uint32_t first = v->bins.part[index], end = v->bins.part[index + 1];
    part *p = &v->parts[index];
    lr_scratch *scratch = aligned_alloc(64, (sizeof *scratch + 63) / 64 * 64);
    int32_t *lists = malloc(((size_t)v->bins.longest + 1) * sizeof *lists);
    lr_status status = LR_OK;
    if (scratch == NULL || lists == NULL || !has_room(v, p, (size_t)(end - first) + 1)) {
        status = lr_fail_memory(
            error,
            (uint64_t)(end - first) *
                lr_volume_brick_nbytes(v->job.sample_type, v->mesh.source.ids != NULL),
            "the bricks of a part");
    } else {
        for (uint32_t i = 0; i < v->bins.longest; i++)
            lists[i] = -1;
        scratch->first = lists;
        if (!run_part(v, first, end, watch, scratch, p))
            status = lr_fail_stopped(error);
    }
    p->done = status == LR_OK;
    if (status != LR_OK)
        free_part(p);
    else
        lr_progress(watch, 1.0);
    free(scratch);
    free(lists);
    return status;
}

/* ---- join -------------------------------------------------------------- */

/* Bricks that are decided among bricks: their votes, component by component. */
typedef struct undecided {
    const lr_voxelizer *v;
    uint32_t *active; /* [table]: active brick + 1, 0: no triangle near */
    uint8_t *seen;    /* [table] */
    uint32_t *queue;  /* bricks of the component */
    size_t n;
    int64_t votes;
    bool at_border;
} undecided;

static bool is_unknown(const undecided *u, size_t at)
{
    uint32_t active = u->active[at];
    return active == 0 || u->v->verdicts[active - 1].state == LR_STATE_UNKNOWN;
}

static void look(undecided *u, size_t at, int their_face)
{
    if (!is_unknown(u, at)) {
        u->votes += u->v->verdicts[u->active[at] - 1].face[their_face];
    } else if (!u->seen[at]) {
        u->seen[at] = 1;
        u->queue[u->n++] = (uint32_t)at;
    }
}

static void look_around(undecided *u, size_t at)
{
    const int32_t *size = u->v->job.table_size;
    size_t rest = at, step = 1;
    for (int a = 0; a < 3; a++) {
        size_t n = (size_t)size[a], x = rest % n;
        rest /= n;
        if (x == 0 || x == n - 1)
            u->at_border = true;
        if (x > 0)
            look(u, at - step, 2 * a + 1);
        if (x < n - 1)
            look(u, at + step, 2 * a);
        step *= n;
    }
}

static bool decide_component(undecided *u, size_t seed, lr_volume *volume, const lr_watch *watch)
{
    u->n = 0;
    u->votes = 0;
    u->at_border = false;
    u->seen[seed] = 1;
    u->queue[u->n++] = (uint32_t)seed;
    for (size_t i = 0; i < u->n; i++) {
        if (i % 65536 == 0 && lr_stopped(watch))
            return false;
        look_around(u, u->queue[i]);
    }
    if (!u->at_border && u->votes > 0)
        for (size_t i = 0; i < u->n; i++)
            volume->table[u->queue[i]] = LR_BRICK_ONE << 8;
    return true;
}

static lr_status decide(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    size_t n_table = lr_table_count(v->volume);
    undecided u = {.v = v};
    u.active = calloc(n_table, sizeof *u.active);
    u.seen = calloc(n_table, 1);
    u.queue = malloc(n_table * sizeof *u.queue);
    lr_status status = LR_OK;
    if (u.active == NULL || u.seen == NULL || u.queue == NULL) {
        status = lr_fail_memory(error, n_table * 9, "the flood of the bricks");
    } else {
        for (uint32_t i = 0; i < v->bins.n_active; i++)
            u.active[v->bins.brick[i]] = i + 1;
        for (size_t at = 0; at < n_table && status == LR_OK; at++)
            if (!u.seen[at] && is_unknown(&u, at) && !decide_component(&u, at, v->volume, watch))
                status = lr_fail_stopped(error);
    }
    free(u.active);
    free(u.seen);
    free(u.queue);
    return status;
}

static lr_status move_part(lr_voxelizer *v, part *p, lr_error *error)
{
    lr_volume *out = v->volume;
    size_t nbytes = LR_BRICK_SAMPLES * lr_sample_nbytes(v->job.sample_type);
    for (uint32_t i = 0; i < p->n; i++) {
        uint32_t brick;
        lr_status status = lr_volume_open_brick(out, p->brick[i], &brick, error);
        if (status != LR_OK)
            return status;
        memcpy(out->samples + brick * nbytes, p->samples + i * nbytes, nbytes);
        if (p->ids != NULL)
            memcpy(out->ids + (size_t)brick * LR_BRICK_SAMPLES,
                   p->ids + (size_t)i * LR_BRICK_SAMPLES, LR_BRICK_SAMPLES * sizeof *p->ids);
        if (p->touched != NULL)
            memcpy(out->cells[brick], p->touched[i], sizeof out->cells[brick]);
        if (p->block_of != NULL && p->block_of[i] != 0) {
            size_t at = (size_t)(p->block_of[i] - 1) * LR_BRICK_SAMPLES;
            lr_volume_put_codes(out, brick, p->colors != NULL ? p->colors + at : NULL,
                                p->normals != NULL ? p->normals + at : NULL);
        }
    }
    free_part(p);
    return LR_OK;
}

static lr_status move_parts(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    uint64_t n = 0, n_blocks = 0;
    for (uint32_t i = 0; i < v->bins.n_parts; i++) {
        n += v->parts[i].n;
        n_blocks += v->parts[i].n_blocks;
    }
    const lr_bake *bake = &v->job.bake;
    lr_status status = lr_volume_reserve(v->volume, n, error);
    if (status == LR_OK && (bake->colors || bake->normals))
        status = lr_volume_carry(v->volume, bake->colors, bake->normals, bake->color_scale,
                                 n_blocks, error);
    for (uint32_t i = 0; i < v->bins.n_parts && status == LR_OK; i++) {
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        lr_progress(watch, 0.5 * (double)i / v->bins.n_parts);
        status = move_part(v, &v->parts[i], error);
    }
    for (uint32_t i = 0; i < v->bins.n_active; i++)
        if (v->verdicts[i].state == LR_STATE_ONE)
            v->volume->table[v->bins.brick[i]] = LR_BRICK_ONE << 8;
    return status;
}

static lr_status check_parts(const lr_voxelizer *v, lr_error *error)
{
    if (v->volume == NULL)
        return lr_fail(error, LR_E_ARGUMENT, "the volume of this voxelizer was made before");
    for (uint32_t i = 0; i < v->bins.n_parts; i++)
        if (!v->parts[i].done)
            return lr_fail(error, LR_E_ARGUMENT, "part %u of %u has not been run", i,
                           v->bins.n_parts);
    return LR_OK;
}

lr_status lr_voxelize_join(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    lr_status status = check_parts(v, error);
    if (status == LR_OK && v->joined)
        status = lr_fail(error, LR_E_ARGUMENT, "the parts of this voxelizer were joined before");
    if (status == LR_OK && !v->job.sheet)
        status = decide(v, watch, error);
    if (status == LR_OK)
        status = move_parts(v, watch, error);
    v->joined = status == LR_OK;
    return status;
}

/* ---- cells ------------------------------------------------------------- */

lr_status lr_voxelize_cells(lr_voxelizer *v, uint64_t index, const lr_watch *watch,
                            lr_error *error)
{
    if (!v->joined || v->cells == NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "cells are judged where the voxelizer has_cells and its parts are joined");
    if (index >= v->bins.n_parts || v->judged[index])
        return lr_fail(error, LR_E_ARGUMENT,
                       "the cells of part %llu of %u were judged before or do not exist",
                       (unsigned long long)index, v->bins.n_parts);
    lr_status status = lr_cells_make(&v->job, v->volume, &v->bins, v->bins.part[index],
                                     v->bins.part[index + 1], watch, &v->cells[index], error);
    v->judged[index] = status == LR_OK;
    if (status != LR_OK)
        lr_cells_free(&v->cells[index]);
    else
        lr_progress(watch, 1.0);
    return status;
}

/* The cells of a sheet in which its field holds: those near a triangle. */
static lr_status mark_near(lr_voxelizer *v, lr_error *error)
{
    lr_status status = LR_OK;
    for (uint32_t i = 0; i < v->bins.n_parts && v->job.sheet; i++)
        for (uint32_t k = 0; k < v->cells[i].n && status == LR_OK; k++) {
            uint32_t brick;
            status = lr_volume_open_brick(v->volume, v->cells[i].place[k], &brick, error);
            for (int s = 0; s < 8 && status == LR_OK; s++)
                v->volume->cells[brick][s] |= v->cells[i].near[k][s];
        }
    return status;
}

static void vertex_of(const void *mesh, int64_t v, double p[3])
{
    lr_vertex(mesh, v, p);
}

static lr_status finish_exact(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    const lr_exact_source source = {
        .triangles = v->mesh.source.triangles,
        .n_triangles = v->mesh.source.n_triangles,
        .n_vertices = v->mesh.source.n_vertices,
        .ids = v->mesh.source.ids,
        .turned = v->mesh.side < 0.0,
        .slope = lr_profile_slope(v->job.filter, v->job.half_width),
        .vertex = vertex_of,
        .mesh = &v->mesh,
    };
    lr_exact_part *parts = calloc((size_t)v->bins.n_parts + 1, sizeof *parts);
    if (parts == NULL)
        return lr_fail_memory(error, v->bins.n_parts * sizeof *parts, "a list of parts");
    for (uint32_t i = 0; i < v->bins.n_parts; i++)
        parts[i] = v->cells[i].exact;
    lr_status status =
        lr_volume_finish_exact(v->volume, parts, v->bins.n_parts, &source, watch, error);
    free(parts);
    return status;
}

/* ---- end --------------------------------------------------------------- */

lr_status lr_voxelize_end(lr_voxelizer *v, const lr_watch *watch, lr_volume **volume,
                          lr_error *error)
{
    lr_status status = check_parts(v, error);
    for (uint32_t i = 0; i < v->bins.n_parts && status == LR_OK && v->cells != NULL; i++)
        if (!v->judged[i])
            status = lr_fail(error, LR_E_ARGUMENT, "the cells of part %u of %u have not been judged",
                             i, v->bins.n_parts);
    if (status == LR_OK && !v->joined)
        status = lr_voxelize_join(v, watch, error);
    if (status == LR_OK && v->cells != NULL)
        status = mark_near(v, error);
    if (status == LR_OK)
        status = v->cells != NULL ? finish_exact(v, watch, error)
                                  : lr_volume_finish(v->volume, watch, error);
    if (status != LR_OK)
        return status;
    *volume = v->volume;
    v->volume = NULL;
    return LR_OK;
}

void lr_voxelizer_free(lr_voxelizer *v)
{
    if (v == NULL)
        return;
    for (uint32_t i = 0; v->parts != NULL && i < v->bins.n_parts; i++)
        free_part(&v->parts[i]);
    for (uint32_t i = 0; v->cells != NULL && i < v->bins.n_parts; i++)
        lr_cells_free(&v->cells[i]);
    free(v->parts);
    free(v->verdicts);
    free(v->cells);
    free(v->judged);
    lr_topology_free(&v->mesh);
    lr_bins_free(&v->bins);
    lr_volume_free(v->volume);
    free(v);
}
