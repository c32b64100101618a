/* The parts that threads run, each a range of bricks. Bricks that are not constant are written
 * into the volume, which has room for all bricks of a part; after all parts, the gaps are
 * closed in place.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/brick_jobs.h"

#include "grid/attributes/triangle_attributes.h"
#include "voxelize/brick.h"
#include "voxelize/coverage_bsp.h"

static void free_part(lr_part *p)
{
    free(p->brick);
    free(p->nearest_triangle);
    *p = (lr_part){0};
}

static bool has_room(const lr_voxelizer *v, lr_part *p, uint32_t first, uint32_t end)
{
    p->first = lr_stored_brick(first);
    p->next_block = lr_first_block(first);
    p->brick = malloc(((size_t)(end - first) + 1) * sizeof *p->brick);
    if (v->job.attributes.any)
        p->nearest_triangle = malloc(LR_CELLS * sizeof *p->nearest_triangle);
    return p->brick != NULL && (!v->job.attributes.any || p->nearest_triangle != NULL);
}

static void keep(const lr_voxelizer *v, uint32_t at, const lr_brick *brick, lr_part *p)
{
    const uint32_t slot = p->first + p->n;
    lr_volume_write_brick(v->volume, slot, brick->value, brick->id,
                          v->job.sheet ? brick->touched : NULL);
    if (p->nearest_triangle != NULL)
        lr_volume_set_nearest(v->volume, slot, brick->has_nearest ? p->nearest_triangle : NULL,
                              &p->next_block);
    p->brick[p->n++] = at;
}

static bool make_bricks(lr_voxelizer *v, uint32_t first, uint32_t end, const lr_watch *watch,
                        lr_scratch *scratch, lr_part *p)
{
    lr_brick brick;
    for (uint32_t i = first; i < end; i++) {
        if (lr_stopped(watch))
            return false;
        lr_progress(watch, (double)(i - first) / (double)(end - first));
        uint64_t list = v->bins.start[i];
        uint32_t n = (uint32_t)(v->bins.start[i + 1] - list);
        scratch->nearest_triangle = p->nearest_triangle;
        if (v->components.brick != NULL) {
            scratch->component_of = v->components.brick[i].component;
            scratch->components = v->components.component + v->components.brick[i].first;
        }
        if (!lr_brick_make(&v->job, v->bins.brick[i], v->bins.list + list, n, watch, scratch,
                           &brick))
            return false;
        v->verdicts[i].state = (uint8_t)brick.state;
        v->verdicts[i].contradicts = brick.contradicts;
        v->verdicts[i].faces = brick.faces;
        if (brick.state == LR_STATE_MIXED)
            keep(v, v->bins.brick[i], &brick, p);
    }
    return true;
}

/* With room for the longest list of triangles; NULL without memory. */
static lr_scratch *new_scratch(const lr_voxelizer *v)
{
    lr_scratch *scratch = aligned_alloc(64, (sizeof *scratch + 63) / 64 * 64);
    int32_t *lists = malloc(((size_t)v->bins.longest + 1) * sizeof *lists);
    const bool unite = v->by_winding && v->job.filter == LR_FILTER_BOX;
    lr_crossed *crossed = unite ? malloc(sizeof *crossed) : NULL;
    if (scratch == NULL || lists == NULL || (unite && crossed == NULL)) {
        free(scratch);
        free(lists);
        free(crossed);
        return NULL;
    }
    if (unite)
        crossed->winding = &v->winding;
    scratch->crossed = crossed;
    for (uint32_t i = 0; i < v->bins.longest; i++)
        lists[i] = -1;
    scratch->first = lists;
    scratch->component_of = NULL;
    scratch->nearest_triangle = NULL;
    return scratch;
}

static void free_scratch(lr_scratch *scratch)
{
    if (scratch != NULL) {
        free(scratch->first);
        free(scratch->crossed);
    }
    free(scratch);
}

lr_status lr_part_run(lr_voxelizer *v, uint32_t index, const lr_watch *watch, lr_error *error)
{
    uint32_t first = v->bins.part[index], end = v->bins.part[index + 1];
    lr_part *p = &v->parts[index];
    lr_scratch *scratch = new_scratch(v);
    lr_status status = LR_OK;
    if (scratch == NULL || !has_room(v, p, first, end))
        status = lr_fail_memory(error, (uint64_t)(end - first) * 4 + sizeof *scratch,
                                "the bricks of a part");
    else if (!make_bricks(v, first, end, watch, scratch, p))
        status = lr_fail_stopped(error);
    if (status != LR_OK)
        free_part(p);
    free_scratch(scratch);
    return status;
}

lr_status lr_part_components(lr_voxelizer *v, uint32_t index, const lr_watch *watch,
                             lr_error *error)
{
    lr_scratch *scratch = new_scratch(v);
    lr_status status =
        scratch == NULL
            ? lr_fail_memory(error, (uint64_t)v->bins.longest * 4, "the bricks of a part")
            : lr_components_find(&v->components, &v->job, &v->bins, index, watch, scratch, error);
    free_scratch(scratch);
    return status;
}

lr_status lr_parts_begin(lr_voxelizer *v, lr_error *error)
{
    lr_status status = lr_volume_reserve(v->volume, v->bins.n_active, error);
    if (status == LR_OK && v->job.attributes.any)
        status = lr_volume_carry(v->volume, v->bins.n_active, error);
    return status;
}

lr_status lr_parts_move(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    lr_volume *out = v->volume;
    for (uint32_t i = 0; i < v->bins.n_parts; i++) {
        lr_part *p = &v->parts[i];
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        lr_progress(watch, 0.5 * (double)i / v->bins.n_parts);
        for (uint32_t k = 0; k < p->n; k++) {
            const uint32_t to = lr_volume_enter_brick(out, p->brick[k], p->first + k);
            lr_volume_move_names(out, to);
        }
        free_part(p);
    }
    for (uint32_t i = 0; i < v->bins.n_active; i++)
        if (v->verdicts[i].state == LR_STATE_ONE)
            lr_volume_enter_full(out, v->bins.brick[i]);
    return LR_OK;
}

void lr_parts_free(lr_voxelizer *v)
{
    for (uint32_t i = 0; v->parts != NULL && i < v->bins.n_parts; i++)
        free_part(&v->parts[i]);
    free(v->parts);
    v->parts = NULL;
}
