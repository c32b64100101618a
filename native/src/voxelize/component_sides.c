/* Sides by the winding number, evaluated once per component of the band.
 *
 * Samples in the band are connected where they lie on one side (link_samples.h), within a
 * brick to all 26 neighbours, across bricks along the axes. A sample whose nearest point lies
 * on the mesh's border is not connected, since the level set that fills a hole ends there.
 * The winding number is evaluated at the sample of a component that is farthest from the
 * mesh, where it is most reliable.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/component_sides.h"

#include "base/pages.h"
#include "base/union_find.h"
#include "voxelize/link_samples.h"

/* ---- within a brick ---------------------------------------------------- */

static bool add_component(lr_components_part *part, uint32_t brick, uint16_t sample, uint16_t depth)
{
    if (part->n == part->room) {
        uint32_t room = 2 * part->room + 1024;
        lr_component *more = realloc(part->component, room * sizeof *more);
        if (more == NULL)
            return false;
        part->component = more;
        part->room = room;
    }
    part->component[part->n++] = (lr_component){.brick = brick, .sample = sample, .depth = depth};
    return true;
}

/* distance: 0 where a sample links to none, infinity beyond the band. Components are numbered
 * from the part's first one on until they are joined. */
static bool find_components(uint32_t active, const float *distance, const uint8_t *loose,
                            double band, lr_brick_components *out, lr_components_part *part)
{
    uint16_t parent[LR_CELLS], number_of[LR_CELLS], n = 0;
    float linked[LR_CELLS];
    for (uint16_t i = 0; i < LR_CELLS; i++)
        linked[i] = loose[i] ? 0.0f : fabsf(distance[i]);
    lr_link_samples(linked, parent);
    out->first = part->n;
    for (uint16_t i = 0; i < LR_CELLS; i++) {
        out->component[i] = LR_NO_COMPONENT;
        out->depth[i] = 0;
        if (distance[i] == INFINITY)
            continue;
        uint16_t root = lr_linked_root(parent, i);
        double depth = fabs((double)distance[i]) / band * 65535.0;
        uint16_t rounded = depth < 65535.0 ? (uint16_t)depth : 65535;
        if (root == i) {
            number_of[i] = n++;
            if (!add_component(part, active, i, rounded))
                return false;
        }
        out->component[i] = number_of[root];
        out->depth[i] = loose[i] ? 0 : rounded;
        lr_component *c = &part->component[out->first + out->component[i]];
        if (rounded > c->depth) {
            c->depth = rounded;
            c->sample = i;
        }
    }
    return true;
}

lr_status lr_components_begin(const lr_bins *bins, lr_components *all, lr_error *error)
{
    *all = (lr_components){0};
    all->brick = lr_pages_new((uint64_t)bins->n_active + 1, sizeof *all->brick);
    all->part = calloc((size_t)bins->n_parts + 1, sizeof *all->part);
    if (all->brick == NULL || all->part == NULL)
        return lr_fail_memory(error, (uint64_t)bins->n_active * sizeof *all->brick,
                              "the sides of the mesh");
    return LR_OK;
}

lr_status lr_components_find(lr_components *all, const lr_voxel_job *job, const lr_bins *bins,
                             uint32_t part, const lr_watch *watch, lr_scratch *scratch,
                             lr_error *error)
{
    _Alignas(16) float distance[LR_CELLS];
    uint8_t loose[LR_CELLS];
    lr_components_part *p = &all->part[part];
    p->n = 0;
    for (uint32_t i = bins->part[part]; i < bins->part[part + 1]; i++) {
        uint64_t list = bins->start[i];
        uint32_t n = (uint32_t)(bins->start[i + 1] - list);
        memset(loose, 0, sizeof loose);
        if (lr_stopped(watch) || !lr_brick_distances(job, bins->brick[i], bins->list + list, n,
                                                     watch, scratch, distance, loose))
            return lr_fail_stopped(error);
        if (!find_components(i, distance, loose, job->band, &all->brick[i], p))
            return lr_fail_memory(error, (uint64_t)p->room * 2 * sizeof *p->component,
                                  "the sides of the mesh");
    }
    return LR_OK;
}

/* ---- across bricks ----------------------------------------------------- */

/* The lower root stays and takes the farther sample. */
static void connect(lr_component *c, uint32_t a, uint32_t b)
{
    a = lr_root_of(&c->parent, sizeof *c, a);
    b = lr_root_of(&c->parent, sizeof *c, b);
    if (a == b)
        return;
    uint32_t to = a < b ? a : b, from = a < b ? b : a;
    c[from].parent = to;
    if (c[from].depth > c[to].depth) {
        c[to].depth = c[from].depth;
        c[to].brick = c[from].brick;
        c[to].sample = c[from].sample;
    }
}

/* Neighbours along an axis: the last layer of a, the first of b. */
static void connect_bricks(lr_components *all, const lr_brick_components *a,
                           const lr_brick_components *b, int axis, double least)
{
    int step = lr_stride(axis), u = lr_stride((axis + 1) % 3), v = lr_stride((axis + 2) % 3);
    for (int j = 0; j < LR_SIDE; j++)
        for (int k = 0; k < LR_SIDE; k++) {
            int near = j * u + k * v, last = near + (LR_SIDE - 1) * step;
            if (a->depth[last] == 0 || b->depth[near] == 0 ||
                a->depth[last] + b->depth[near] <= least)
                continue;
            connect(all->component, a->first + a->component[last], b->first + b->component[near]);
        }
}

/* The active brick at a place of the table, from a given one on; UINT32_MAX: none. */
static uint32_t active_at(const lr_bins *bins, uint32_t from, uint64_t place)
{
    uint32_t lo = from, hi = bins->n_active;
    while (lo < hi) {
        uint32_t middle = lo + (hi - lo) / 2;
        if (bins->brick[middle] < place)
            lo = middle + 1;
        else
            hi = middle;
    }
    return lo < bins->n_active && bins->brick[lo] == place ? lo : UINT32_MAX;
}

static bool connect_all(lr_components *all, const lr_voxel_job *job, const lr_bins *bins,
                        const lr_watch *watch)
{
    const double least = LR_LINK / job->band * 65535.0;
    for (uint32_t i = 0; i < bins->n_active; i++) {
        if (i % 256 == 0 && lr_stopped(watch))
            return false;
        uint64_t rest = bins->brick[i], step = 1;
        for (int a = 0; a < 3; a++) {
            uint64_t size = (uint64_t)job->table_size[a];
            uint32_t next =
                rest % size + 1 < size ? active_at(bins, i, bins->brick[i] + step) : UINT32_MAX;
            if (next != UINT32_MAX)
                connect_bricks(all, &all->brick[i], &all->brick[next], a, least);
            rest /= size;
            step *= size;
        }
    }
    return true;
}

static lr_status gather(lr_components *all, const lr_bins *bins, lr_error *error)
{
    uint64_t n = 0;
    for (uint32_t p = 0; p < bins->n_parts; p++)
        n += all->part[p].n;
    if (n > UINT32_MAX - 1)
        return lr_fail(error, LR_E_SIZE, "the mesh divides space into %llu pieces, too many",
                       (unsigned long long)n);
    all->component = malloc((n + 1) * sizeof *all->component);
    all->root = malloc((n + 1) * sizeof *all->root);
    if (all->component == NULL || all->root == NULL)
        return lr_fail_memory(error, n * (4 + sizeof *all->component), "the sides of the mesh");
    for (uint32_t p = 0; p < bins->n_parts; p++) {
        for (uint32_t i = bins->part[p]; i < bins->part[p + 1]; i++)
            all->brick[i].first += all->n;
        for (uint32_t c = 0; c < all->part[p].n; c++) {
            all->component[all->n] = all->part[p].component[c];
            all->component[all->n].parent = all->n;
            all->n++;
        }
        free(all->part[p].component);
    }
    free(all->part);
    all->part = NULL;
    return LR_OK;
}

lr_status lr_components_join(lr_components *all, const lr_voxel_job *job, const lr_bins *bins,
                             const lr_watch *watch, lr_error *error)
{
    lr_status status = gather(all, bins, error);
    if (status == LR_OK && !connect_all(all, job, bins, watch))
        status = lr_fail_stopped(error);
    for (uint32_t i = 0; i < all->n && status == LR_OK; i++)
        if (all->component[i].parent == i)
            all->root[all->n_roots++] = i;
    return status;
}

bool lr_components_decide(lr_components *all, const lr_voxel_job *job, const lr_bins *bins,
                          const lr_winding *winding, uint32_t first, uint32_t end,
                          const lr_watch *watch)
{
    for (uint32_t r = first; r < end; r++) {
        lr_component *c = &all->component[all->root[r]];
        int32_t first_of[3];
        double p[3];
        if (r % 64 == 0 && lr_stopped(watch))
            return false;
        lr_first_sample(job->table_size, bins->brick[c->brick], first_of);
        for (int a = 0; a < 3; a++)
            p[a] = first_of[a] + lr_along(c->sample, a);
        c->inside = fabs(lr_winding_at(winding, p)) > 0.5;
    }
    return true;
}

void lr_components_spread(lr_components *all)
{
    for (uint32_t i = 0; i < all->n; i++)
        all->component[i].inside =
            all->component[lr_root_of(&all->component->parent, sizeof *all->component, i)].inside;
}

void lr_components_free(lr_components *all, const lr_bins *bins)
{
    for (uint32_t p = 0; all->part != NULL && p < bins->n_parts; p++)
        free(all->part[p].component);
    free(all->part);
    lr_pages_free(all->brick);
    free(all->component);
    free(all->root);
    *all = (lr_components){0};
}
