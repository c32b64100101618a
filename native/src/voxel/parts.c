/* The parts that threads run: bricks made one after another, those that are not
 * constant kept in blocks of the part's own until all go to the volume.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxel/crossed.h"
#include "voxel/voxelizer.h"

static void free_part(lr_part *p)
{
    free(p->brick);
    free(p->samples);
    free(p->ids);
    free(p->touched);
    free(p->block_of);
    free(p->named);
    *p = (lr_part){0};
}

static bool has_room(const lr_voxelizer *v, lr_part *p, size_t n)
{
    size_t sample_nbytes = LR_BRICK_SAMPLES * lr_sample_nbytes(v->job.sample_type);
    p->brick = malloc(n * sizeof *p->brick);
    p->samples = malloc(n * sample_nbytes);
    if (v->mesh.source.ids != NULL)
        p->ids = malloc(n * LR_BRICK_SAMPLES * sizeof *p->ids);
    if (v->job.sheet)
        p->touched = malloc(n * sizeof *p->touched);
    if (v->job.bake.wanted) {
        p->block_of = malloc(n * sizeof *p->block_of);
        p->named = malloc(n * LR_BRICK_SAMPLES * sizeof *p->named);
    }
    return p->brick != NULL && p->samples != NULL &&
           (v->mesh.source.ids == NULL || p->ids != NULL) &&
           (!v->job.sheet || p->touched != NULL) &&
           (!v->job.bake.wanted || (p->block_of != NULL && p->named != NULL));
}

/* Where the names of the next brick's samples go. */
static void offer_block(const lr_part *p, lr_scratch *scratch)
{
    size_t at = (size_t)p->n_blocks * LR_BRICK_SAMPLES;
    scratch->named = p->named != NULL ? p->named + at : NULL;
}

static void keep(const lr_voxelizer *v, uint32_t at, const lr_brick *brick, lr_part *p)
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
        offer_block(p, scratch);
        if (v->labels.brick != NULL) {
            scratch->labels = v->labels.brick[i].label;
            scratch->components = v->labels.component + v->labels.brick[i].first;
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

/* With lists for the longest list of triangles; NULL without memory. */
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
    scratch->labels = NULL;
    scratch->named = NULL;
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
    if (scratch == NULL || !has_room(v, p, (size_t)(end - first) + 1))
        status = lr_fail_memory(
            error,
            (uint64_t)(end - first) *
                lr_volume_brick_nbytes(v->job.sample_type, v->mesh.source.ids != NULL),
            "the bricks of a part");
    else if (!make_bricks(v, first, end, watch, scratch, p))
        status = lr_fail_stopped(error);
    if (status != LR_OK)
        free_part(p);
    free_scratch(scratch);
    return status;
}

lr_status lr_part_label(lr_voxelizer *v, uint32_t index, const lr_watch *watch, lr_error *error)
{
    lr_scratch *scratch = new_scratch(v);
    lr_status status =
        scratch == NULL
            ? lr_fail_memory(error, (uint64_t)v->bins.longest * 4, "the bricks of a part")
            : lr_labels_run(&v->labels, &v->job, &v->bins, index, watch, scratch, error);
    free_scratch(scratch);
    return status;
}

static lr_status move_part(lr_voxelizer *v, lr_part *p, lr_error *error)
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
        if (p->block_of != NULL && p->block_of[i] != 0)
            lr_volume_name(out, brick, p->named + (size_t)(p->block_of[i] - 1) * LR_BRICK_SAMPLES);
    }
    free_part(p);
    return LR_OK;
}

lr_status lr_parts_move(lr_voxelizer *v, const lr_watch *watch, lr_error *error)
{
    uint64_t n = 0, n_blocks = 0;
    for (uint32_t i = 0; i < v->bins.n_parts; i++) {
        n += v->parts[i].n;
        n_blocks += v->parts[i].n_blocks;
    }
    lr_status status = lr_volume_reserve(v->volume, n, error);
    if (status == LR_OK && v->job.bake.wanted)
        status = lr_volume_carry(v->volume, n_blocks, error);
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

void lr_parts_free(lr_voxelizer *v)
{
    for (uint32_t i = 0; v->parts != NULL && i < v->bins.n_parts; i++)
        free_part(&v->parts[i]);
    free(v->parts);
    v->parts = NULL;
}
