/* The faces at a hit, and what they give it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/attributes/attributes.h"

#include "base/affine.h"
#include "base/error.h"
#include "grid/attributes/triangle_attributes.h"
#include "grid/attributes/texture.h"
#include "grid/triangle_cells.h"

/* Two faces count alike where their distances from the hit differ by much less than
 * EVEN voxels. */
#define EVEN 0x1p-10
/* A corner's own weight counts where no face holds the hit; LEAST keeps a face that does
 * in the game where only a corner far off names it. */
#define LEAST 0x1p-6
/* Shares that are less of the largest change no colour by a step of 1/255. */
#define TINY         0x1p-9
#define LEAST_COSINE 0.5 /* a face that leans by more is that of another side */
/* Beyond its edges the map of a face goes on, unless it is a needle, whose map tells
 * nothing across it: its square height in squares of its longest side. */
#define NEEDLE 0x1p-10

/* The names of a cell's corners and their weights; how many. */
static uint32_t names(const lr_volume *v, const int32_t c[3], const double p[3], int32_t id,
                      lr_share share[LR_SHARES_MAX])
{
    uint32_t n = 0;
    for (int b = 0; b < 8; b++) {
        const int o[3] = {b & 1, b >> 1 & 1, b >> 2};
        const int32_t x = c[0] + o[0], y = c[1] + o[1], z = c[2] + o[2];
        const uint32_t brick = lr_entry(v, x, y, z) >> 8;
        const uint32_t block = v->block_of[LR_WORDS * (size_t)brick + lr_word_of(x, y, z)];
        if (block == 0 || (v->ids != NULL && v->ids[lr_sample_at(v, x, y, z)] != id))
            continue;
        const uint32_t face =
            v->nearest_triangle[(size_t)block * LR_WORD_CELLS + lr_bit_of(x, y, z)];
        const double weight =
            (o[0] ? p[0] : 1.0 - p[0]) * (o[1] ? p[1] : 1.0 - p[1]) * (o[2] ? p[2] : 1.0 - p[2]);
        uint32_t i = 0;
        while (i < n && share[i].face != face)
            i++;
        if (face == 0)
            continue;
        if (i == n) {
            share[n++] = (lr_share){.face = face, .weight = LEAST};
            __builtin_prefetch(v->faces->corner[face]);
        }
        share[i].weight += weight;
    }
    return n;
}

/* The weights of the corners at the face's point that is closest to the hit; false: it is
 * none within the face. Given are how far the hit lies along two sides ab and ac, as dot
 * products, and those of the sides.
 * Source: Ericson, Real-Time Collision Detection, 5.1.5. */
static bool closest(double along_b, double along_c, double bb, double bc, double cc, double at[3])
{
    const double d1 = along_b, d2 = along_c, d3 = d1 - bb, d4 = d2 - bc, d5 = d1 - bc, d6 = d2 - cc;
    const double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
    double u = 0.0, w = 0.0; /* of the second and third corner */
    bool within = false;
    if (d1 <= 0.0 && d2 <= 0.0) {
    } else if (d3 >= 0.0 && d4 <= d3) {
        u = 1.0;
    } else if (d6 >= 0.0 && d5 <= d6) {
        w = 1.0;
    } else if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
        u = d1 / (d1 - d3);
    } else if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
        w = d2 / (d2 - d6);
    } else if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        u = 1.0 - w;
    } else {
        const double share = 1.0 / (va + vb + vc);
        within = true;
        u = vb * share;
        w = vc * share;
    }
    at[0] = 1.0 - u - w;
    at[1] = u;
    at[2] = w;
    return within;
}

/* Where the hit lies on a face, from its corners round it. Its height over the face's
 * plane, and how far its foot is beside the face, squared. False for a face without
 * area, or one that leans from the surface. */
static bool place(const double a[3][3], const double *inward, lr_share *s, double *height,
                  double *beside)
{
    double ab[3], ac[3], n[3], foot[3];
    lr_sub(a[1], a[0], ab);
    lr_sub(a[2], a[0], ac);
    lr_cross_product(ab, ac, n);
    const double nn = lr_dot(n, n), bb = lr_dot(ab, ab), cc = lr_dot(ac, ac), bc = lr_dot(ab, ac);
    if (!(nn > 0.0 && isfinite(nn)))
        return false;
    const double length = sqrt(nn);
    if (inward != NULL && fabs(lr_dot(n, inward)) < LEAST_COSINE * length)
        return false;
    const double up = lr_dot(n, a[0]), h = up / nn; /* the foot is h n */
    const double db = -lr_dot(ab, a[0]), dc = -lr_dot(ac, a[0]);
    const bool within = closest(db, dc, bb, bc, cc, s->at);
    *height = fabs(up) / length;
    *beside = 0.0;
    memcpy(s->beyond, s->at, sizeof s->beyond);
    if (within)
        return true;
    for (int k = 0; k < 3; k++)
        foot[k] = s->at[0] * a[0][k] + s->at[1] * a[1][k] + s->at[2] * a[2][k] - h * n[k];
    *beside = lr_dot(foot, foot);
    const double longest = fmax(fmax(bb, cc), bb + cc - 2.0 * bc);
    if (nn > NEEDLE * longest * longest) {
        s->beyond[1] = (cc * db - bc * dc) / nn;
        s->beyond[2] = (bb * dc - bc * db) / nn;
        s->beyond[0] = 1.0 - s->beyond[1] - s->beyond[2];
    }
    return true;
}

/* Give every face its share by how near it is, and drop what does not count. */
static uint32_t settle(lr_share share[], double height[], const double beside[], uint32_t n)
{
    double lowest = INFINITY, most = 0.0, sum = 0.0;
    for (uint32_t i = 0; i < n; i++)
        lowest = fmin(lowest, height[i]);
    for (uint32_t i = 0; i < n; i++) {
        const double higher = height[i] - lowest;
        share[i].weight /= beside[i] + higher * higher + EVEN * EVEN;
        most = fmax(most, share[i].weight);
    }
    uint32_t left = 0;
    for (uint32_t i = 0; i < n; i++)
        if (share[i].weight >= TINY * most)
            share[left++] = share[i];
    for (uint32_t i = 0; i < left; i++)
        sum += share[i].weight;
    for (uint32_t i = 0; i < left; i++)
        share[i].weight /= sum;
    return left;
}

uint32_t lr_volume_shares(const lr_volume *v, const int32_t c[3], const double p[3], int32_t id,
                          const double *geometric, lr_share share[LR_SHARES_MAX])
{
    const double q[3] = {c[0] + p[0], c[1] + p[1], c[2] + p[2]};
    double height[LR_SHARES_MAX], beside[LR_SHARES_MAX], inward[3];
    const uint32_t n_nearest = names(v, c, p, id, share);
    if (geometric != NULL) { /* from object to storage space, and to unit length */
        lr_map_gradient(v->object_from_storage, geometric, inward);
        const double length = sqrt(lr_dot(inward, inward));
        for (int k = 0; k < 3; k++)
            inward[k] /= length;
    }
    uint32_t n = 0;
    for (uint32_t i = 0; i < n_nearest; i++) {
        double a[3][3];
        for (int b = 0; b < 3; b++)
            for (int k = 0; k < 3; k++)
                a[b][k] = v->faces->corner[share[i].face][b][k] - q[k];
        share[n] = share[i];
        n += place((const double (*)[3])a, geometric != NULL ? inward : NULL, &share[n], &height[n],
                   &beside[n]);
    }
    return settle(share, height, beside, n);
}

/* The one share of a hit on a triangle of a triangle cell; how many. */
static uint32_t own_share(const lr_volume *v, const int32_t c[3], const double p[3],
                          uint32_t triangle, lr_share *share)
{
    double a[3][3], height, beside;
    *share = (lr_share){.face = v->triangle_cells->face[triangle], .weight = 1.0};
    for (int b = 0; b < 3; b++)
        for (int k = 0; k < 3; k++)
            a[b][k] = v->faces->corner[share->face][b][k] - (c[k] + p[k]);
    return place((const double (*)[3])a, NULL, share, &height, &beside);
}

static uint32_t shares_at(const lr_volume *v, const int32_t c[3], const double p[3], int32_t id,
                          uint32_t triangle, const double *geometric, lr_share share[LR_SHARES_MAX])
{
    if (triangle != LR_NO_TRIANGLE && own_share(v, c, p, triangle, share) > 0)
        return 1;
    return lr_volume_shares(v, c, p, id, geometric, share);
}

/* So many voxels of a face in texels: the eigenvectors of J J^T, J the gradients of texel
 * coordinates in the face's plane. */
static lr_footprint footprint_of(const lr_triangle_attributes *f, uint32_t face, double width)
{
    const lr_texture *t = f->texture[f->source[face]];
    const double size[2] = {t->width[0], t->height[0]};
    double side[2][3], to[2][2]; /* of the two sides that meet in corner 0: in space, in texels */
    for (int k = 0; k < 2; k++) {
        for (int a = 0; a < 3; a++)
            side[k][a] = (double)f->corner[face][k + 1][a] - (double)f->corner[face][0][a];
        for (int i = 0; i < 2; i++)
            to[k][i] = size[i] * ((double)f->uv[face][k + 1][i] - (double)f->uv[face][0][i]);
    }
    const double bb = lr_dot(side[0], side[0]), cc = lr_dot(side[1], side[1]);
    const double bc = lr_dot(side[0], side[1]), area = bb * cc - bc * bc, share = 1.0 / area;
    double m[3]; /* xx, xy, yy of J J^T = T G^-1 T^t */
    for (int k = 0; k < 3; k++) {
        const int i = k / 2, j = (k + 1) / 2;
        m[k] =
            share * (cc * to[0][i] * to[0][j] - bc * (to[0][i] * to[1][j] + to[1][i] * to[0][j]) +
                     bb * to[1][i] * to[1][j]);
    }
    const double middle = 0.5 * (m[0] + m[2]), spread = hypot(0.5 * (m[0] - m[2]), m[1]);
    const double most = width * sqrt(middle + spread), angle = 0.5 * atan2(2.0 * m[1], m[0] - m[2]);
    const double least = width * sqrt(middle > spread ? middle - spread : 0.0);
    if (!(area > 0.0 && isfinite(most)))
        return (lr_footprint){{0.0, 0.0}, 0.0};
    return (lr_footprint){{most * cos(angle), most * sin(angle)}, least};
}

static void image_color(const lr_triangle_attributes *f, const lr_share *s, double width,
                        double rgb[3])
{
    double uv[2] = {0.0, 0.0};
    for (int b = 0; b < 3; b++)
        for (int i = 0; i < 2; i++)
            uv[i] += s->beyond[b] * (double)f->uv[s->face][b][i];
    const lr_texture *texture = f->texture[f->source[s->face]];
    if (!(width > 0.0)) {
        lr_texture_look(texture, uv, rgb);
        return;
    }
    const lr_footprint footprint = footprint_of(f, s->face, width);
    lr_texture_average(texture, uv, &footprint, rgb);
}

static void face_color(const lr_triangle_attributes *f, const lr_share *s, double width,
                       double rgb[3])
{
    const int32_t source = f->source[s->face];
    const lr_texture *texture = source < 0 ? NULL : f->texture[source];
    const bool of_corners = texture != NULL && lr_texture_is_of_corners(texture);
    memcpy(rgb, (const double[3]){1.0, 1.0, 1.0}, 3 * sizeof *rgb);
    if ((source == LR_COLOR_VERTEX || of_corners) && f->color != NULL)
        for (int a = 0; a < 3; a++) {
            rgb[a] = 0.0;
            for (int b = 0; b < 3; b++)
                rgb[a] += s->at[b] * (double)f->color[s->face][b][a];
        }
    if (of_corners)
        lr_texture_of_corners(texture, (const double[3]){rgb[0], rgb[1], rgb[2]}, rgb);
    else if (texture != NULL && f->uv != NULL)
        image_color(f, s, width, rgb);
    for (int a = 0; a < 3; a++)
        rgb[a] = rgb[a] > 0.0 ? rgb[a] : 0.0;
}

bool lr_volume_color(const lr_volume *v, const int32_t c[3], const double p[3], int32_t id,
                     uint32_t triangle, double width, double rgb[3])
{
    lr_share share[LR_SHARES_MAX];
    double sum[3] = {0.0, 0.0, 0.0};
    if (v->faces == NULL || v->faces->source == NULL)
        return false;
    const uint32_t n = shares_at(v, c, p, id, triangle, NULL, share);
    for (uint32_t i = 0; i < n; i++) {
        double color[3];
        face_color(v->faces, &share[i], width, color);
        for (int a = 0; a < 3; a++)
            sum[a] += share[i].weight * color[a];
    }
    if (n > 0)
        memcpy(rgb, sum, sizeof sum);
    return n > 0;
}

bool lr_volume_shading_normal(const lr_volume *v, const int32_t c[3], const double p[3], int32_t id,
                              uint32_t triangle, const double *geometric, double n[3])
{
    lr_share share[LR_SHARES_MAX];
    double sum[3] = {0.0, 0.0, 0.0};
    if (v->faces == NULL || v->faces->normal == NULL)
        return false;
    const uint32_t n_shares = shares_at(v, c, p, id, triangle, geometric, share);
    for (uint32_t i = 0; i < n_shares; i++)
        for (int b = 0; b < 3; b++) {
            const uint32_t code = v->faces->normal[share[i].face][b];
            double normal[3] = {0.0, 0.0, 0.0};
            if (code != 0)
                lr_normal_decode(code, normal);
            for (int a = 0; a < 3; a++)
                sum[a] += share[i].weight * share[i].at[b] * normal[a];
        }
    const double length = sqrt(lr_dot(sum, sum));
    if (length > 1e-6) /* else they cancel, and their sum is rounding */
        for (int a = 0; a < 3; a++)
            n[a] = sum[a] / length;
    return length > 1e-6;
}

bool lr_carries_normals(const lr_volume *v)
{
    return v->faces != NULL && v->faces->normal != NULL;
}

bool lr_volume_smooth_triangle(const lr_volume *v, const int32_t c[3], const double p[3],
                               uint32_t triangle, lr_smooth_triangle *smooth)
{
    lr_share share;
    if (triangle == LR_NO_TRIANGLE || v->faces == NULL || v->faces->normal == NULL ||
        own_share(v, c, p, triangle, &share) == 0)
        return false;
    memcpy(smooth->at, share.at, sizeof share.at);
    for (int b = 0; b < 3; b++) {
        double storage[3];
        if (v->faces->normal[share.face][b] == 0)
            return false;
        for (int a = 0; a < 3; a++)
            storage[a] = v->faces->corner[share.face][b][a];
        lr_map_point(v->object_from_storage, storage, smooth->corner[b]);
        lr_normal_decode(v->faces->normal[share.face][b], smooth->normal[b]);
    }
    return true;
}

lr_status lr_volume_attributes(const lr_volume *v, const double *points, const uint16_t *ids,
                               uint64_t n, double width, double *colors, double *normals,
                               lr_error *error)
{
    if (!(width >= 0.0))
        return lr_fail(error, LR_E_ARGUMENT, "width must be 0 or more voxels, it is %g", width);
    if (!v->finished)
        return lr_fail(error, LR_E_ARGUMENT, "the volume is not finished");
    const int32_t last[3] = {v->desc.nx + 1, v->desc.ny + 1, v->desc.nz + 1}; /* storage cells */
    for (uint64_t i = 0; i < n; i++) {
        double q[3], p[3], color[3] = {NAN, NAN, NAN}, normal[3] = {NAN, NAN, NAN};
        int32_t c[3];
        lr_map_point(v->storage_from_object, points + 3 * i, q);
        for (int a = 0; a < 3; a++) {
            c[a] = (int32_t)lr_clamp(floor(q[a]), 1.0, last[a]);
            p[a] = lr_clamp(q[a] - c[a], 0.0, 1.0);
        }
        const int32_t id = ids != NULL ? ids[i] : 0;
        const uint32_t triangle = lr_triangle_cell_nearest(v, c, q);
        if (colors != NULL) {
            lr_volume_color(v, c, p, id, triangle, width, color);
            memcpy(colors + 3 * i, color, sizeof color);
        }
        if (normals != NULL) {
            lr_volume_shading_normal(v, c, p, id, triangle, NULL, normal);
            memcpy(normals + 3 * i, normal, sizeof normal);
        }
    }
    return LR_OK;
}
