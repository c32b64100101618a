/* What discrete ray tracing stores in surface voxels.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "imaging/stored_voxels.h"

#include "base/error.h"
#include "base/octahedron.h"
#include "trace/hit_record.h"

enum { NO_NORMAL = 0xffff }; /* a code that no normal has: see to_code */

/* ---- normals -------------------------------------------------------------- */

/* On the octahedron, -127..127 each. */
static uint16_t to_code(const double n[3])
{
    double uv[2] = {0.0, 0.0};
    lr_octahedron_map(n, uv);
    return (uint16_t)((lround(127.0 * uv[0]) + 127) << 8 | (lround(127.0 * uv[1]) + 127));
}

static void from_code(uint16_t code, double n[3])
{
    const double uv[2] = {((code >> 8) - 127) / 127.0, ((code & 0xff) - 127) / 127.0};
    lr_octahedron_direction(uv, n);
}

void lr_stored_normal(const lr_stored_voxels *s, uint32_t number, double normal[3])
{
    if (s->normal[number] == NO_NORMAL)
        memset(normal, 0, 3 * sizeof *normal);
    else
        from_code(s->normal[number], normal);
}

/* ---- the list -------------------------------------------------------------- */

/* At the cell's centre. */
static void store_voxel(lr_stored_voxels *s, uint32_t number, const int32_t c[3])
{
    const lr_volume *v = s->volume;
    const double p[3] = {0.5, 0.5, 0.5};
    double corner[8], own[3], normal[3], rgb[3] = {1.0, 1.0, 1.0};
    lr_corners(v, c, corner);
    const int32_t id = lr_nearest_id(v, c, corner, p);
    s->normal[number] = NO_NORMAL;
    if (lr_field_normal(v, c, corner, p, own)) {
        lr_field_shading_normal(v, LR_NO_OBJECT, id, c, p, LR_NORMAL_CENTRAL, own, normal);
        s->normal[number] = to_code(normal);
    }
    if (s->color == NULL)
        return;
    lr_volume_color(v, c, p, id, LR_NO_TRIANGLE, 1.0, rgb);
    for (int a = 0; a < 3; a++)
        s->color[number][a] = (uint8_t)lround(255.0 * lr_clamp(rgb[a], 0.0, 1.0));
}

static lr_status take_memory(lr_stored_voxels *s, lr_error *error)
{
    const lr_volume *v = s->volume;
    const uint64_t table = lr_table_count(v) * sizeof *s->first;
    const bool colored = v->faces != NULL;
    const uint64_t per_voxel = sizeof *s->normal + (colored ? sizeof *s->color : 0);
    s->first = malloc(table);
    s->normal = malloc((s->n + (size_t)1) * sizeof *s->normal);
    if (colored)
        s->color = malloc((s->n + (size_t)1) * sizeof *s->color);
    s->nbytes += table + s->n * per_voxel;
    if (s->first == NULL || s->normal == NULL || (colored && s->color == NULL))
        return lr_fail_memory(error, table + s->n * per_voxel, "surface voxels");
    return LR_OK;
}

lr_status lr_store_voxels(lr_stored_voxels *s, const lr_volume *v, const lr_watch *watch,
                          lr_error *error)
{
    *s = (lr_stored_voxels){.volume = v};
    if (v->n_surface_cells > UINT32_MAX / 2)
        return lr_fail(error, LR_E_SIZE, "there are %llu surface voxels, and %u can be numbered",
                       (unsigned long long)v->n_surface_cells, UINT32_MAX / 2);
    s->n = (uint32_t)v->n_surface_cells;
    lr_status status = lr_proximity_build(&s->near, v, watch, &s->nbytes, error);
    if (status == LR_OK)
        status = take_memory(s, error);
    int32_t b[3] = {-1, 0, 0}, c[3];
    uint32_t number = 0;
    while (status == LR_OK && lr_next_surface_brick(v, watch, b)) {
        if (lr_stopped(watch))
            break;
        s->first[lr_table_at(v, b[0], b[1], b[2])] = number;
        for (lr_cell_iterator i = lr_surface_cells_of(v, b); lr_next_cell(&i, c);)
            store_voxel(s, number++, c);
        lr_progress(watch, (double)number / s->n);
    }
    return status == LR_OK && lr_stopped(watch) ? lr_fail_stopped(error) : status;
}

void lr_free_stored(lr_stored_voxels *s)
{
    lr_proximity_free(&s->near);
    free(s->first);
    free(s->normal);
    free(s->color);
    for (int light = 0; light < LR_IMAGE_LIGHTS_MAX; light++)
        free(s->lit[light]);
}

void lr_list_stored(const lr_stored_voxels *s, int32_t *cell, double *normal, double *color,
                    uint32_t *lit)
{
    int32_t b[3] = {-1, 0, 0}, c[3];
    size_t number = 0;
    while (lr_next_surface_brick(s->volume, NULL, b))
        for (lr_cell_iterator i = lr_surface_cells_of(s->volume, b); lr_next_cell(&i, c);
             number++) {
            lr_stored_normal(s, (uint32_t)number, normal + 3 * number);
            for (size_t a = 0; a < 3; a++) {
                cell[3 * number + a] = c[a] - LR_PAD;
                color[3 * number + a] = s->color != NULL ? s->color[number][a] / 255.0 : 1.0;
            }
            lit[number] = 0;
            for (int light = 0; light < LR_IMAGE_LIGHTS_MAX; light++)
                if (s->lit[light] != NULL && lr_sees_light(s, light, (uint32_t)number))
                    lit[number] |= (uint32_t)1 << light;
        }
}

/* ---- lines ----------------------------------------------------------------- */

void lr_voxel_outside(const lr_volume *v, const int32_t c[3], const double normal[3],
                      int32_t out[3])
{
    double d[3], largest = 0.0;
    lr_map_vector(v->storage_from_object, normal, d);
    for (int a = 0; a < 3; a++)
        largest = fmax(largest, fabs(d[a]));
    for (int a = 0; a < 3; a++)
        out[a] = c[a] + (largest > 0.0 ? (int32_t)lround(d[a] / largest) : 0);
}

void lr_line_along(lr_discrete_line *l, const lr_volume *v, const int32_t c[3], const double d[3],
                   bool ends)
{
    double t[3], out = ends ? 1.0 : INFINITY;
    int32_t lo[3], hi[3], sign[3], to[3];
    int axis = -1;
    for (int a = 0; a < 3; a++) {
        lo[a] = v->surface_lo[a] - 1;
        hi[a] = v->surface_hi[a] + 1;
        sign[a] = (d[a] > 0.0) - (d[a] < 0.0);
        t[a] = sign[a] != 0 ? ((sign[a] > 0 ? hi[a] + 1 : lo[a]) - (c[a] + 0.5)) / d[a] : INFINITY;
        if (t[a] < out) {
            out = t[a];
            axis = a;
        }
    }
    for (int a = 0; a < 3; a++) {
        const double q = sign[a] != 0 ? floor(c[a] + 0.5 + out * d[a]) : c[a];
        to[a] = a == axis ? (sign[a] > 0 ? hi[a] : lo[a]) : (int32_t)lr_clamp(q, lo[a], hi[a]);
    }
    lr_begin_line(l, c, to, sign);
}

/* ---- lights ---------------------------------------------------------------- */

/* From the centre of voxel c to the light, in object space. */
static void to_light(const lr_volume *v, const int32_t c[3], const lr_image_light *light,
                     double to[3])
{
    const double centre[3] = {c[0] + 0.5, c[1] + 0.5, c[2] + 0.5};
    double p[3];
    lr_map_point(v->object_from_storage, centre, p);
    for (int a = 0; a < 3; a++)
        to[a] = light->distant ? light->place[a] : light->place[a] - p[a];
}

static bool voxel_sees(const lr_stored_voxels *s, uint32_t number, const int32_t c[3],
                       const lr_image_light *light)
{
    const lr_volume *v = s->volume;
    double normal[3], to[3], d[3];
    int32_t from[3], at[3];
    uint64_t n_cells = 0;
    lr_discrete_line l;
    lr_stored_normal(s, number, normal);
    to_light(v, c, light, to);
    if (!(lr_dot(normal, to) > 0.0))
        return false;
    lr_voxel_outside(v, c, normal, from);
    to_light(v, from, light, to);
    lr_map_vector(v->storage_from_object, to, d);
    lr_line_along(&l, v, from, d, !light->distant);
    return !lr_next_surface_on_line(s, &l, false, at, &n_cells);
}

static lr_status check_light(int32_t index, const lr_image_light *light, lr_error *error)
{
    if (index < 0 || index >= LR_IMAGE_LIGHTS_MAX)
        return lr_fail(error, LR_E_ARGUMENT, "voxels have a bit for lights 0 to %d, not for %d",
                       LR_IMAGE_LIGHTS_MAX - 1, index);
    if (light == NULL)
        return LR_OK;
    const double square = lr_dot(light->place, light->place);
    if (!isfinite(square) || !lr_all_finite(light->color, 3))
        return lr_fail(error, LR_E_ARGUMENT,
                       "a light's color and the square of its distance must be finite, one is not");
    if (light->distant && square == 0.0)
        return lr_fail(error, LR_E_ARGUMENT, "a distant light must have a direction, it is zero");
    return LR_OK;
}

lr_status lr_store_light(lr_stored_voxels *s, int32_t index, const lr_image_light *light,
                         const lr_watch *watch, lr_error *error)
{
    const lr_status status = check_light(index, light, error);
    const size_t words = s->n / 64 + (size_t)1;
    uint64_t *lit = NULL;
    if (status != LR_OK)
        return status;
    if (light != NULL) {
        lit = calloc(words, sizeof *lit);
        if (lit == NULL)
            return lr_fail_memory(error, words * sizeof *lit, "a light's bits");
        int32_t b[3] = {-1, 0, 0}, c[3];
        for (uint32_t number = 0; !lr_stopped(watch) && lr_next_surface_brick(s->volume, watch, b);)
            for (lr_cell_iterator i = lr_surface_cells_of(s->volume, b); lr_next_cell(&i, c);
                 number++)
                lit[number >> 6] |= (uint64_t)voxel_sees(s, number, c, light) << (number & 63);
    }
    if (lr_stopped(watch)) {
        free(lit);
        return lr_fail_stopped(error);
    }
    if (light != NULL)
        s->light[index] = *light;
    s->nbytes += (light != NULL ? words * sizeof *lit : 0);
    s->nbytes -= (s->lit[index] != NULL ? words * sizeof *lit : 0);
    free(s->lit[index]);
    s->lit[index] = lit;
    return LR_OK;
}

void lr_shade_voxel(const lr_stored_voxels *s, uint32_t number, const int32_t c[3],
                    const double n[3], double rgb[3])
{
    memset(rgb, 0, 3 * sizeof *rgb);
    for (int light = 0; light < LR_IMAGE_LIGHTS_MAX; light++) {
        if (s->lit[light] == NULL || !lr_sees_light(s, light, number))
            continue;
        const lr_image_light *from = &s->light[light];
        double to[3];
        to_light(s->volume, c, from, to);
        const double square = lr_dot(to, to), cosine = lr_dot(n, to) / sqrt(square);
        const double arrives = cosine / (from->distant ? LR_PI : LR_PI * square);
        for (int a = 0; a < 3; a++)
            rgb[a] +=
                arrives * from->color[a] * (s->color != NULL ? s->color[number][a] / 255.0 : 1.0);
    }
}
