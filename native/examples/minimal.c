/* From a mesh to a hit in C: a cube becomes a volume, the volume gets a structure, a ray is traced.
 *
 * native/README.md says how to compile it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <leapray.h>
#include <math.h>
#include <stdio.h>

/* A cube from -1 to 1, its triangles counter-clockwise from outside. */
static const double VERTICES[8][3] = {{-1, -1, -1}, {1, -1, -1}, {-1, 1, -1}, {1, 1, -1},
                                      {-1, -1, 1},  {1, -1, 1},  {-1, 1, 1},  {1, 1, 1}};
static const int32_t TRIANGLES[12][3] = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6},
                                         {0, 1, 5}, {0, 5, 4}, {2, 6, 7}, {2, 7, 3},
                                         {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};

static lr_status voxelize(lr_volume **volume, lr_error *error)
{
    const lr_mesh mesh = {&VERTICES[0][0], 8, &TRIANGLES[0][0], 12, NULL, NULL};
    const lr_voxelize_options options = {
        .voxel_size = 0.1, .half_width = 2.5, .sample_type = LR_U16, .exact = LR_EXACT_ALL};
    lr_voxelizer *voxelizer = NULL;
    uint64_t n_parts = 0;
    lr_status status = lr_voxelize_begin(&mesh, &options, NULL, &voxelizer, error);
    do { /* the parts of a stage could run side by side */
        if (status == LR_OK)
            status = lr_voxelize_next(voxelizer, NULL, &n_parts, error);
        for (uint64_t part = 0; part < n_parts && status == LR_OK; part++)
            status = lr_voxelize_part(voxelizer, part, NULL, error);
    } while (n_parts > 0 && status == LR_OK);
    if (status == LR_OK)
        status = lr_voxelize_end(voxelizer, NULL, volume, error);
    lr_voxelizer_free(voxelizer);
    return status;
}

int main(void)
{
    lr_error error;
    lr_volume *volume = NULL;
    lr_structure *structure = NULL;
    const double o[3] = {-3, 0.2, 0.3}, d[3] = {1, 0, 0};
    const lr_rays rays = {.ox = &o[0], .oy = &o[1], .oz = &o[2], &d[0], &d[1], &d[2]};
    const lr_trace_options options = {.hit_test = LR_HIT_EXTREMA}; /* the rest is 0: defaults */
    double t, n[3];
    int32_t c[3];
    const lr_hits hits = {
        .t = &t, .ci = &c[0], .cj = &c[1], .ck = &c[2], .nx = &n[0], .ny = &n[1], .nz = &n[2]};
    lr_status status = voxelize(&volume, &error);
    if (status == LR_OK) /* traverser 0 of the registry; see lr_traverser_get for the others */
        status = lr_structure_build(volume, 0, NULL, NULL, &structure, &error);
    if (status == LR_OK)
        status = lr_trace(structure, &rays, 1, &options, &hits, NULL, NULL, &error);
    if (status != LR_OK)
        fprintf(stderr, "%s\n", error.text);
    else if (isinf(t))
        printf("miss\n");
    else
        printf("t %.6f cell %d %d %d normal %.3f %.3f %.3f\n", t, c[0], c[1], c[2], n[0], n[1],
               n[2]);
    lr_structure_free(structure);
    lr_volume_free(volume);
    return status;
}
