/* What samples near the surface carry beside occupancy: a colour, a normal.
 *
 * Both lie in blocks of 4^3 samples, one for each sub-brick that holds corners of
 * surface cells: block_of[8 brick + sub] names it, 0 where there is none. Sample
 * (x, y, z) is the block's x%4 + 4 (y%4) + 16 (z%4). A code of 0 says that a sample
 * carries nothing.
 *
 * A colour takes 10 bits per channel of sqrt(value / color_scale): next to 1 the
 * half step is 0.11/255 of sRGB, where it is coarsest (near black) 0.2/255. A normal
 * takes 2 x 16 bits of the octahedron's map: 0.003 degrees at most.
 *
 * At a hit they are interpolated as the field is, over those corners of its cell
 * that are of the hit's id: so nothing bleeds from one material into another. Of
 * normals only those count that lean little from the surface that was hit: so
 * nothing bleeds over a crease.
 *
 * Source: Cigolle, Donow, Evangelakos et al. 2014 (octahedral unit vectors).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_ATTRIBUTES_H
#define LR_ATTRIBUTES_H

#include "volume/access.h"

#define LR_COLOR_PRESENT 0x40000000u
#define LR_COLOR_STEPS   1023.0
#define LR_OCTA_STEPS    65534.0 /* codes 1..65535 of a coordinate, so that 0 is free */

LR_INLINE uint32_t lr_color_encode(const double rgb[3], double scale)
{
    uint32_t code = LR_COLOR_PRESENT;
    for (int a = 0; a < 3; a++) {
        double share = sqrt(lr_clamp(rgb[a] / scale, 0.0, 1.0));
        code |= (uint32_t)(share * LR_COLOR_STEPS + 0.5) << 10 * a;
    }
    return code;
}

LR_INLINE void lr_color_decode(uint32_t code, double scale, double rgb[3])
{
    for (int a = 0; a < 3; a++) {
        double share = (code >> 10 * a & 1023) / LR_COLOR_STEPS;
        rgb[a] = scale * share * share;
    }
}

/* n need not be unit; 0 of nothing. */
LR_INLINE uint32_t lr_normal_encode(const double n[3])
{
    double sum = fabs(n[0]) + fabs(n[1]) + fabs(n[2]);
    if (!(sum > 0.0 && isfinite(sum)))
        return 0;
    double u = n[0] / sum, v = n[1] / sum;
    if (n[2] < 0.0) {
        double folded = copysign(1.0 - fabs(v), n[0]);
        v = copysign(1.0 - fabs(u), n[1]);
        u = folded;
    }
    return ((uint32_t)(0.5 * (u + 1.0) * LR_OCTA_STEPS + 0.5) + 1) |
           ((uint32_t)(0.5 * (v + 1.0) * LR_OCTA_STEPS + 0.5) + 1) << 16;
}

/* The code must not be 0. */
LR_INLINE void lr_normal_decode(uint32_t code, double n[3])
{
    double u = ((code & 0xffff) - 1) / (0.5 * LR_OCTA_STEPS) - 1.0;
    double v = ((code >> 16) - 1) / (0.5 * LR_OCTA_STEPS) - 1.0;
    double w = 1.0 - fabs(u) - fabs(v);
    if (w < 0.0) {
        double folded = copysign(1.0 - fabs(v), u);
        v = copysign(1.0 - fabs(u), v);
        u = folded;
    }
    double length = sqrt(u * u + v * v + w * w);
    n[0] = u / length;
    n[1] = v / length;
    n[2] = w / length;
}

/* The codes of a cell's corners that count at p (0: not) and their weights. */
LR_INLINE void lr_corner_codes(const lr_volume *v, const uint32_t *codes, const int32_t c[3],
                               const double p[3], int32_t id, uint32_t code[8], double weight[8])
{
    /* so that a corner of the own id counts even where p lies on another corner */
    static const double least = 0x1p-40;
    for (int b = 0; b < 8; b++) {
        const int o[3] = {b & 1, b >> 1 & 1, b >> 2};
        const int32_t x = c[0] + o[0], y = c[1] + o[1], z = c[2] + o[2];
        const uint32_t brick = lr_entry(v, x, y, z) >> 8;
        const uint32_t block = v->block_of[8 * (size_t)brick + lr_sub_of(x, y, z)];
        const bool own = v->ids == NULL || v->ids[lr_sample_at(v, x, y, z)] == id;
        code[b] = 0;
        if (block == 0 || !own)
            continue;
        code[b] = codes[(size_t)block * LR_BLOCK_SAMPLES + lr_bit_of(x, y, z)];
        weight[b] = least;
        weight[b] +=
            (o[0] ? p[0] : 1.0 - p[0]) * (o[1] ? p[1] : 1.0 - p[1]) * (o[2] ? p[2] : 1.0 - p[2]);
    }
}

/* Linear RGB at p (0..1) in storage cell c for a hit of that id; false, and rgb
 * untouched, where the volume carries none. */
LR_INLINE bool lr_volume_color(const lr_volume *v, const int32_t c[3], const double p[3],
                               int32_t id, double rgb[3])
{
    uint32_t code[8];
    double weight[8], sum[3] = {0.0, 0.0, 0.0}, total = 0.0;
    if (v->colors == NULL)
        return false;
    lr_corner_codes(v, v->colors, c, p, id, code, weight);
    for (int b = 0; b < 8; b++) {
        double color[3];
        if (code[b] == 0)
            continue;
        lr_color_decode(code[b], v->color_scale, color);
        total += weight[b];
        for (int a = 0; a < 3; a++)
            sum[a] += weight[b] * color[a];
    }
    if (total > 0.0)
        for (int a = 0; a < 3; a++)
            rgb[a] = sum[a] / total;
    return total > 0.0;
}

/* Unit shading normal in object space, outward as the mesh is wound; false, and n
 * untouched, where the volume carries none. geometric: the unit normal of the
 * surface there, of either sign, or NULL. */
LR_INLINE bool lr_volume_shading_normal(const lr_volume *v, const int32_t c[3], const double p[3],
                                        int32_t id, const double *geometric, double n[3])
{
    static const double least_cosine = 0.5; /* beyond 60 degrees it is another face's */
    uint32_t code[8];
    double weight[8], sum[3] = {0.0, 0.0, 0.0};
    if (v->normals == NULL)
        return false;
    lr_corner_codes(v, v->normals, c, p, id, code, weight);
    for (int b = 0; b < 8; b++) {
        double normal[3];
        if (code[b] == 0)
            continue;
        lr_normal_decode(code[b], normal);
        if (geometric != NULL && fabs(lr_dot(normal, geometric)) < least_cosine)
            continue;
        for (int a = 0; a < 3; a++)
            sum[a] += weight[b] * normal[a];
    }
    double length = sqrt(lr_dot(sum, sum));
    if (length > 1e-6) /* else they cancel, and their sum is rounding */
        for (int a = 0; a < 3; a++)
            n[a] = sum[a] / length;
    return length > 1e-6;
}

#endif
