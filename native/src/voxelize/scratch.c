/* Memory of a voxelization, beside the volume's own.
 *
 * Counts the lists that grow with the mesh or the table of bricks: those that exist, and those
 * that the next stage will need at most. A thread's own scratch is some 20 KB.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/scratch.h"

#include "mesh/half_edges.h"

enum {
    BOX = 4,     /* bytes of a triangle's box while the bricks' lists are made, */
    COUNT = 4,   /* of a count in the table, */
    LISTED = 8,  /* of a triangle in these lists, before they are counted, */
    SORTED = 8,  /* of a triangle while those of winding numbers are sorted, */
    DECIDED = 9, /* of a brick in the table while those between others are decided, */
    NUMBER = 4,  /* of a triangle's or vertex' number while triangle cells take them over, */
    ISLAND = 12  /* of a triangle while islands are found: parent, number, layer */
};

uint64_t lr_mesh_scratch_nbytes(uint64_t n_vertices, uint64_t n_triangles)
{
    return 3 * n_triangles * sizeof(uint32_t) + n_triangles * ISLAND +
           lr_half_edges_nbytes(n_vertices, n_triangles);
}

static uint64_t of_bins(const lr_bins *b)
{
    const uint64_t listed = b->list != NULL ? b->start[b->n_active] : 0;
    return b->n_active * (sizeof *b->brick + sizeof *b->start) + listed * sizeof *b->list;
}

static uint64_t of_components(const lr_voxelizer *v)
{
    const lr_components *c = &v->components;
    return c->brick == NULL ? 0
                            : v->bins.n_active * sizeof *c->brick +
                                  c->n * (sizeof *c->component + sizeof *c->root);
}

static uint64_t of_cells(const lr_voxelizer *v)
{
    uint64_t nbytes = 0;
    for (uint32_t i = 0; v->chosen != NULL && i < v->bins.n_parts; i++) {
        const lr_cells_part *p = &v->chosen[i];
        nbytes += p->n * (sizeof *p->place + sizeof *p->near) + lr_cells_nbytes(p) +
                  p->exact.n * (sizeof *p->exact.place + 2 * sizeof *p->exact.doubt);
    }
    return nbytes;
}

uint64_t lr_voxelizer_scratch(const lr_voxelizer *v)
{
    const lr_mesh *mesh = &v->mesh.source;
    const uint64_t n = mesh->n_triangles, n_vertices = mesh->n_vertices;
    const uint64_t n_table = v->volume != NULL ? lr_table_count(v->volume) : 0;
    const uint64_t ring = 3 * n * sizeof *v->mesh.ring;
    const uint64_t binning = n * BOX + n_table * COUNT;
    if (v->stage <= LR_STAGE_SET_UP)
        return ring + lr_half_edges_nbytes(n_vertices, n) + binning + n * LISTED;
    uint64_t held =
        of_bins(&v->bins) + of_components(v) + of_cells(v) + lr_winding_nbytes(&v->winding);
    held += v->verdicts != NULL ? v->bins.n_active * sizeof *v->verdicts : 0;
    if (v->stage == LR_STAGE_DONE) /* the mesh is not linked any more */
        return held + (v->chosen != NULL ? (n + n_vertices) * NUMBER : 0);
    held += ring + (v->mesh.weld != NULL ? n_vertices * sizeof *v->mesh.weld : 0);
    held += v->mesh.twin != NULL ? n * sizeof *v->mesh.twin : 0;
    uint64_t passing = binning;
    if (v->winding.nodes != NULL && n * SORTED > passing)
        passing = n * SORTED;
    if (!v->job.sheet && n_table * DECIDED > passing)
        passing = n_table * DECIDED;
    return held + passing;
}
