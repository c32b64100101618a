/* Copies the attributes of the triangles that samples or triangle cells of a volume refer to.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/keep_attributes.h"

#include "base/error.h"
#include "grid/attributes/triangle_attributes.h"
#include "grid/attributes/texture.h"
#include "grid/triangle_cells.h"

enum { POLL = 1 << 16 };

static lr_status check_sources(const lr_mesh *mesh, const lr_watch *watch, lr_attribute_set *set,
                               lr_error *error)
{
    const lr_attributes *a = mesh->attributes;
    for (uint64_t t = 0; t < mesh->n_triangles; t++) {
        const int32_t from = a->color_sources[t];
        if (t % POLL == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        if (from < LR_COLOR_NONE || (from >= 0 && (uint64_t)from >= a->n_textures))
            return lr_fail(error, LR_E_ARGUMENT,
                           "triangle %llu takes its colour from texture %d; there are %llu",
                           (unsigned long long)t, from, (unsigned long long)a->n_textures);
        const bool image = from >= 0 && !lr_texture_is_of_corners(a->textures[from]);
        const bool corners = from == LR_COLOR_VERTEX || (from >= 0 && !image);
        if (corners && a->corner_colors == NULL)
            return lr_fail(error, LR_E_ARGUMENT,
                           "triangle %llu takes vertex colours, but there are none",
                           (unsigned long long)t);
        if (image && a->corner_uvs == NULL)
            return lr_fail(error, LR_E_ARGUMENT,
                           "triangle %llu takes a texture, but there are no UVs",
                           (unsigned long long)t);
        set->colors = set->colors || corners;
        set->uvs = set->uvs || image;
    }
    return LR_OK;
}

lr_status lr_check_attributes(const lr_mesh *mesh, const lr_watch *watch, lr_attribute_set *set,
                              lr_error *error)
{
    const lr_attributes *a = mesh->attributes;
    *set = (lr_attribute_set){0};
    if (a == NULL)
        return LR_OK;
    set->normals = a->corner_normals != NULL;
    set->sources = a->color_sources != NULL;
    set->any = set->normals || set->sources;
    return set->sources ? check_sources(mesh, watch, set, error) : LR_OK;
}

/* ---- faces ------------------------------------------------------------- */

LR_INLINE float finite_or_zero(float x)
{
    return isfinite(x) ? x : 0.0f;
}

static void fill(const lr_topology *mesh, uint64_t t, uint32_t at, lr_triangle_attributes *f)
{
    const lr_attributes *from = mesh->source.attributes;
    double p[3][3];
    lr_triangle(mesh, t, p);
    for (int c = 0; c < 3; c++) {
        double n[3];
        for (int a = 0; a < 3; a++) {
            const size_t i = 9 * (size_t)t + (size_t)(3 * c + a);
            f->corner[at][c][a] = (float)p[c][a];
            if (f->color != NULL)
                f->color[at][c][a] = finite_or_zero(from->corner_colors[i]);
            n[a] = f->normal != NULL ? mesh->side * from->corner_normals[i] : 0.0;
        }
        if (f->normal != NULL)
            f->normal[at][c] = lr_normal_encode(n);
        for (int i = 0; f->uv != NULL && i < 2; i++)
            f->uv[at][c][i] = finite_or_zero(from->corner_uvs[6 * t + (uint64_t)(2 * c + i)]);
    }
    if (f->source != NULL)
        f->source[at] = from->color_sources[t];
}

/* Number the triangles that samples or triangle cells refer to, in face_of; 0: none does. */
static uint32_t number(lr_volume *v, uint32_t *face_of, uint64_t n_triangles)
{
    uint32_t n = 1;
    const uint32_t n_kept = v->triangle_cells != NULL ? v->triangle_cells->n_triangles : 0;
    for (uint32_t i = 0; i < n_kept; i++)
        face_of[v->triangle_cells->face[i] - 1] = 1;
    lr_volume_mark_named(v, face_of);
    for (uint64_t t = 0; t < n_triangles; t++)
        if (face_of[t] != 0)
            face_of[t] = n++;
    lr_volume_rename(v, face_of);
    for (uint32_t i = 0; i < n_kept; i++)
        v->triangle_cells->face[i] = face_of[v->triangle_cells->face[i] - 1];
    return n;
}

lr_status lr_keep_attributes(const lr_attribute_set *set, const lr_topology *mesh, lr_volume *v,
                             const lr_watch *watch, lr_error *error)
{
    const uint64_t n_triangles = mesh->source.n_triangles;
    const lr_attributes *from = mesh->source.attributes;
    uint32_t *face_of = calloc(n_triangles + 1, sizeof *face_of);
    if (face_of == NULL)
        return lr_fail_memory(error, n_triangles * sizeof *face_of, "the faces of a volume");
    const uint32_t n = number(v, face_of, n_triangles);
    lr_status status =
        lr_triangle_attributes_new(n, set->normals, set->sources, set->colors, set->uvs,
                                   (uint32_t)from->n_textures, &v->faces, error);
    for (uint64_t t = 0; t < n_triangles && status == LR_OK; t++) {
        if (face_of[t] != 0)
            fill(mesh, t, face_of[t], v->faces);
        if (t % POLL == 0 && lr_stopped(watch))
            status = lr_fail_stopped(error);
    }
    for (uint64_t i = 0; i < from->n_textures && status == LR_OK; i++)
        v->faces->texture[i] = from->textures[i];
    free(face_of);
    return status;
}
