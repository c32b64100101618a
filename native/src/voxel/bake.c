/* From corners of triangles to samples: barycentric at the closest point.
 *
 * Textures are averaged over the piece of them that one voxel of the triangle's
 * plane covers: the singular values of the map from the plane to texels give its
 * length and width. Seams of a texture lie where the nearest triangle changes.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxel/bake.h"

#include "volume/attributes.h"
#include "voxel/texture.h"

enum { POLL = 1 << 16 };

/* With ten bits per channel a surface that shines 64 times as bright as white still
 * has steps of 2/255 next to white. Brighter is cut. */
#define BRIGHTEST 64.0

static lr_status check_sources(const lr_mesh *mesh, const lr_watch *watch, lr_bake *bake,
                               lr_error *error)
{
    const lr_attributes *a = bake->source;
    for (uint64_t t = 0; t < mesh->n_triangles; t++) {
        const int32_t from = a->color_sources[t];
        if (t % POLL == 0 && lr_stopped(watch))
            return lr_fail_stopped(error);
        if (from < LR_COLOR_NONE || (from >= 0 && (uint64_t)from >= a->n_textures))
            return lr_fail(error, LR_E_ARGUMENT,
                           "triangle %llu takes its colour from texture %d; there are %llu",
                           (unsigned long long)t, from, (unsigned long long)a->n_textures);
        if (from == LR_COLOR_VERTEX && a->corner_colors == NULL)
            return lr_fail(error, LR_E_ARGUMENT,
                           "triangle %llu takes vertex colours, but there are none",
                           (unsigned long long)t);
        if (from >= 0 && a->corner_uvs == NULL)
            return lr_fail(error, LR_E_ARGUMENT,
                           "triangle %llu takes a texture, but there are no UVs",
                           (unsigned long long)t);
        for (int i = 0; from == LR_COLOR_VERTEX && i < 9; i++) {
            const double x = a->corner_colors[9 * t + (uint64_t)i];
            bake->color_scale = x > bake->color_scale ? x : bake->color_scale;
        }
    }
    for (uint64_t i = 0; i < a->n_textures; i++)
        if (a->textures[i]->brightest > bake->color_scale)
            bake->color_scale = a->textures[i]->brightest;
    bake->color_scale = lr_clamp(bake->color_scale, 1.0, BRIGHTEST);
    return LR_OK;
}

lr_status lr_bake_check(const lr_mesh *mesh, const lr_watch *watch, lr_bake *bake, lr_error *error)
{
    const lr_attributes *a = mesh->attributes;
    *bake = (lr_bake){.source = a, .color_scale = 1.0};
    if (a == NULL)
        return LR_OK;
    bake->normals = a->corner_normals != NULL;
    bake->colors = a->color_sources != NULL;
    return bake->colors ? check_sources(mesh, watch, bake, error) : LR_OK;
}

/* ---- a triangle -------------------------------------------------------- */

/* A voxel in texels: the eigenvectors of J J^T, J the gradients of texel coordinates
 * in the triangle's plane. The weight of the corner opposite to edge e grows by
 * -m[e] / across[e]. */
static void find_footprint(lr_dress *d)
{
    double g[2][3] = {{0.0}};
    const double size[2] = {d->texture->width[0], d->texture->height[0]};
    for (int e = 0; e < 3; e++)
        for (int i = 0; i < 2; i++)
            for (int a = 0; a < 3; a++)
                g[i][a] -= d->uv[(e + 2) % 3][i] * size[i] * d->frame->m[e][a] / d->across[e];
    const double xx = lr_dot(g[0], g[0]), xy = lr_dot(g[0], g[1]), yy = lr_dot(g[1], g[1]);
    const double middle = 0.5 * (xx + yy), spread = hypot(0.5 * (xx - yy), xy);
    const double most = sqrt(middle + spread);
    const double least = sqrt(middle > spread ? middle - spread : 0.0);
    const double angle = 0.5 * atan2(2.0 * xy, xx - yy);
    const bool known = isfinite(most);
    d->major[0] = known ? most * cos(angle) : 0.0;
    d->major[1] = known ? most * sin(angle) : 0.0;
    d->width = known ? least : 1.0;
}

void lr_dress_triangle(const lr_bake *bake, uint32_t t, double side, const lr_frame *frame,
                       lr_dress *d)
{
    const lr_attributes *from = bake->source;
    const size_t first = 9 * (size_t)t;
    const int32_t source = bake->colors ? from->color_sources[t] : LR_COLOR_NONE;
    d->frame = frame;
    d->texture = source >= 0 ? from->textures[source] : NULL;
    for (int e = 0; e < 3; e++) {
        double to[3];
        lr_sub(frame->p[(e + 2) % 3], frame->p[e], to);
        d->across[e] = -lr_dot(frame->m[e], to);
    }
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++) {
            const size_t at = first + (size_t)(3 * c + a);
            d->normal[c][a] = bake->normals ? side * from->corner_normals[at] : 0.0;
            d->color[c][a] = source == LR_COLOR_VERTEX ? from->corner_colors[at] : 1.0;
        }
    if (d->texture == NULL)
        return;
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < 2; i++)
            d->uv[c][i] = from->corner_uvs[6 * (size_t)t + (size_t)(2 * c + i)];
    find_footprint(d);
}

/* ---- a sample ---------------------------------------------------------- */

/* Barycentric coordinates of the triangle's point that is closest to p. */
static void closest(const lr_dress *d, const double p[3], double weight[3])
{
    const lr_frame *f = d->frame;
    double excess[3], place[3], smallest = INFINITY;
    bool in_face = true;
    int nearest = 0;
    for (int e = 0; e < 3; e++) {
        double from[3];
        lr_sub(p, f->p[e], from);
        excess[e] = lr_dot(f->m[e], from);
        place[e] = lr_dot(f->u[e], from);
        in_face = in_face && excess[e] <= 0.0;
        const double outside = place[e] - lr_clamp(place[e], 0.0, f->length[e]);
        const double square = excess[e] * excess[e] + outside * outside;
        if (square < smallest) {
            smallest = square;
            nearest = e;
        }
    }
    memset(weight, 0, 3 * sizeof *weight);
    if (in_face) {
        double sum = 0.0;
        for (int e = 0; e < 3; e++)
            sum += weight[(e + 2) % 3] = lr_clamp(-excess[e] / d->across[e], 0.0, 1.0);
        for (int c = 0; c < 3; c++)
            weight[c] /= sum;
    } else {
        const double share = lr_clamp(place[nearest] / f->length[nearest], 0.0, 1.0);
        weight[nearest] = 1.0 - share;
        weight[(nearest + 1) % 3] = share;
    }
}

void lr_dress_sample(const lr_bake *bake, const lr_dress *d, const double p[3], uint32_t *color,
                     uint32_t *normal)
{
    double weight[3], rgb[3] = {0.0}, n[3] = {0.0}, uv[2] = {0.0};
    closest(d, p, weight);
    for (int c = 0; c < 3; c++)
        for (int a = 0; a < 3; a++) {
            rgb[a] += weight[c] * d->color[c][a];
            n[a] += weight[c] * d->normal[c][a];
        }
    if (d->texture != NULL) {
        const lr_footprint footprint = {{d->major[0], d->major[1]}, d->width};
        for (int c = 0; c < 3; c++)
            for (int i = 0; i < 2; i++)
                uv[i] += weight[c] * d->uv[c][i];
        lr_texture_average(d->texture, uv, &footprint, rgb);
    }
    if (color != NULL)
        *color = lr_color_encode(rgb, bake->color_scale);
    if (normal != NULL)
        *normal = lr_normal_encode(n);
}
