/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/scene/field_color.h"

#include "base/affine.h"
#include "base/error.h"
#include "grid/attributes/shader_program.h"
#include "grid/field.h"

lr_status lr_field_color_place(const lr_field_color *color, uint64_t instance,
                               lr_placed_color *placed, lr_error *error)
{
    const lr_volume *v = color->volume;
    const bool has_id = color->part == LR_FIELD_ID;
    if (v == NULL || !v->finished || v->planes[0] != NULL || (color->program == NULL) != has_id)
        return lr_fail(error, LR_E_ARGUMENT,
                       "instance %llu must take its colours from a finished volume that is not "
                       "rectilinear, by a program, or its ids without one",
                       (unsigned long long)instance);
    if (!isfinite(color->scale) || !isfinite(color->offset))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the field that colours instance %llu must have a finite scale and offset, "
                       "it has %g and %g",
                       (unsigned long long)instance, color->scale, color->offset);
    const lr_status status = lr_check_choice("part of the field", color->part, LR_FIELD_ID, error);
    if (status != LR_OK)
        return status;
    if (!lr_affine_invert(color->world_from_object, placed->object_from_world))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the field that colours instance %llu must have a finite, affine and "
                       "invertible matrix",
                       (unsigned long long)instance);
    placed->volume = v;
    placed->program = color->program;
    placed->scale = color->scale / v->one;
    placed->offset = color->offset;
    placed->slope = color->part == LR_FIELD_SLOPE;
    return has_id ? LR_OK : lr_program_check(color->program, error);
}

void lr_field_color_at(const lr_placed_color *color, const double world[3], double rgb[3])
{
    const lr_volume *v = color->volume;
    double object[3], p[3], g[3], g_object[3], g_world[3] = {0};
    int32_t c[3];
    lr_map_point(color->object_from_world, world, object);
    const bool inside = lr_cell_at(v, object, c, p);
    double grey = color->offset;
    if (inside)
        grey += color->scale * lr_height_in(v, c, p, 0.0, g);
    if (color->slope && inside) {
        lr_map_gradient(v->storage_from_object, g, g_object);
        lr_map_gradient(color->object_from_world, g_object, g_world);
    }
    if (color->slope)
        grey = fabs(color->scale) * sqrt(lr_dot(g_world, g_world));
    const float told[4] = {(float)grey, (float)grey, (float)grey, 1};
    float made[3];
    lr_program_color(color->program, told, made);
    for (int a = 0; a < 3; a++)
        rgb[a] = isfinite(made[a]) ? made[a] : 0;
}

/* Of the four samples around a cell, along an axis on which p lies in it: averages by 1-2-1 around
 * its two corners, which linear interpolation mixes. */
static void weigh(double p, double weight[4])
{
    weight[0] = (1 - p) / 4;
    weight[1] = (1 - p) / 2 + p / 4;
    weight[2] = (1 - p) / 4 + p / 2;
    weight[3] = p / 4;
}

int32_t lr_field_id_at(const lr_placed_color *color, const double world[3])
{
    const lr_volume *v = color->volume;
    double object[3], p[3], value[64], weight[3][4], sum[64];
    int32_t c[3], ids[64], best = 0;
    int n = 0;
    lr_map_point(color->object_from_world, world, object);
    if (!lr_cell_at(v, object, c, p))
        return 0;
    lr_block(v, c[0] - 1, c[1] - 1, c[2] - 1, 4, value);
    for (int a = 0; a < 3; a++)
        weigh(p[a], weight[a]);
    for (int b = 0; b < 64; b++) {
        const int i = b & 3, j = b >> 2 & 3, k = b >> 4;
        if (!(value[b] >= v->threshold))
            continue;
        const int32_t id = lr_id(v, c[0] - 1 + i, c[1] - 1 + j, c[2] - 1 + k);
        int at = 0;
        while (at < n && ids[at] != id)
            at++;
        if (at == n) {
            ids[n] = id;
            sum[n++] = 0;
        }
        sum[at] += weight[0][i] * weight[1][j] * weight[2][k];
    }
    for (int at = 0; at < n; at++)
        best = sum[at] > sum[best] ? at : best;
    return n > 0 ? ids[best] : 0;
}
