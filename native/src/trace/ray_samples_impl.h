/* Rays side by side: plain loops over lanes, which compilers turn into vector instructions. Each
 * lane goes its own way along its own ray, and takes the next ray where that has ended. Whoever
 * includes this defines LR_SAMPLE_RAYS, the function's name, and, for x86, has set its instruction
 * set.
 *
 * Source: Levoy 1988 (samples, classified after interpolation) and 1990 (leaping, and rays that end
 * where they are opaque).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/cell_rows.h"
#include "grid/surface_cells.h"
#include "grid/transfer_function.h"
#include "grid/trilinear.h"
#include "trace/hit_record.h"
#include "trace/lane_exp.h"
#include "trace/light_sum.h"
#include "trace/ray_samples.h"

enum {
    LANES = 32,
    LOOKS = 3,   /* for visible samples, before those that were found are taken, */
    ENOUGH = 24, /* or so many of them */
};

#ifdef __clang__
#define EACH_LANE _Pragma("clang loop vectorize(enable)") for (int l = 0; l < LANES; l++)
#else
#define EACH_LANE for (int l = 0; l < LANES; l++)
#endif

#include "trace/ray_gradients_impl.h"

/* Of the steps to where a ray leaves a box: what rounding can do to their number, at most. */
static const double STEP_SLACK = 1e-6, STEP_ROUNDING = 0x1p-46;

typedef struct ray_lanes {
    _Alignas(64) double o[3][LANES];     /* in storage space, as d; */
    double d[3][LANES];                  /* 0 along an axis that is not moved along, */
    double inv[3][LANES];                /* and its reciprocal, or 0, with */
    double never[3][LANES];              /* infinity there, else 0 */
    double up[3][LANES];                 /* 1 where it moves up, else 0 */
    double step[LANES], per_step[LANES]; /* in t, and its reciprocal */
    double length[LANES];                /* of a step, as extinction counts */
    double view[3][LANES],
        lamp[3][LANES];          /* in object space, unit: back along the ray; to the light */
    double k[LANES], end[LANES]; /* the next sample; the first one that is too far */
    double p[3][LANES];          /* the sample's place in its cell */
    int32_t c[3][LANES];         /* that, */
    int32_t block[LANES];        /* and where it is not visible, nothing is in the cube */
    int32_t reach[LANES];        /* of block + 1 cells that it is in, and so far around */
    double visible[LANES];       /* 1: it is visible; 0 */
    double corner[8][LANES], value[LANES];
    double from[LANES], extinction[2][LANES], color[3][2][LANES], emission[3][2][LANES];
    double light[3][LANES], transmittance[LANES], begins[LANES]; /* so far */
    uint64_t looked[LANES], taken[LANES];
    uint64_t ray[LANES];
} ray_lanes;

/* ---- rays ------------------------------------------------------------------------ */

/* A lane without a ray: it stands beside the volume, for ever. */
static void leave_idle(ray_lanes *k, int l)
{
    for (int a = 0; a < 3; a++) {
        k->o[a][l] = -1.0;
        k->d[a][l] = k->inv[a][l] = k->never[a][l] = k->up[a][l] = 0.0;
    }
    k->step[l] = k->per_step[l] = k->transmittance[l] = 1.0;
    k->k[l] = k->length[l] = 0.0;
    k->end[l] = INFINITY;
}

static void set_directions(ray_lanes *k, int l, const double d[3], const lr_phong *phong)
{
    double to[3];
    for (int a = 0; a < 3; a++) {
        k->view[a][l] = -d[a] / sqrt(lr_dot(d, d));
        to[a] = k->view[a][l];
    }
    const double *light = phong->light; /* may be so short that its square is 0 */
    const double most = fmax(fabs(light[0]), fmax(fabs(light[1]), fabs(light[2])));
    for (int a = 0; a < 3 && most > 0.0; a++)
        to[a] = light[a] / most;
    for (int a = 0; a < 3; a++)
        k->lamp[a][l] = to[a] / sqrt(lr_dot(to, to));
}

/* Let lane l begin ray i; false: that meets nothing. */
static bool begin_ray(ray_lanes *k, int l, const lr_volume *v, const lr_rays *rays, uint64_t i,
                      const lr_trace_options *options)
{
    lr_ray r;
    lr_cursor u;
    const double o[3] = {rays->ox[i], rays->oy[i], rays->oz[i]};
    const double d[3] = {rays->dx[i], rays->dy[i], rays->dz[i]};
    const double t_min = rays->t_min != NULL ? rays->t_min[i] : 0.0;
    int axis;
    if (!lr_ray_setup(&r, v, o, d, rays->t_max != NULL ? rays->t_max[i] : INFINITY) ||
        !(t_min <= r.t_max && t_min < INFINITY) ||
        !lr_enter(&r, LR_REGULAR, &u, v->surface_lo, v->surface_hi, t_min))
        return false;
    const double step = options->step / sqrt(lr_dot(r.d, r.d));
    /* a sample more at both ends, which rounding may take from the box */
    const double out = lr_exit_t(&r, LR_REGULAR, v->surface_lo, v->surface_hi, &axis) / step;
    k->k[l] = fmax(ceil(t_min / step), ceil(u.t / step) - 1.0);
    k->end[l] = fmin(ceil(r.t_max / step), ceil(out) + 1.0);
    if (!(k->k[l] < k->end[l]) || !(k->end[l] < k->end[l] + 1.0))
        return false; /* or so far away that steps are lost in rounding */
    for (int a = 0; a < 3; a++) {
        k->o[a][l] = r.o[a];
        k->d[a][l] = r.s[a] != 0 ? r.d[a] : 0.0;
        k->inv[a][l] = r.inv[a];
        k->never[a][l] = r.never[a];
        k->up[a][l] = r.s[a] > 0 ? 1.0 : 0.0;
        k->light[a][l] = 0.0;
    }
    k->step[l] = step;
    k->per_step[l] = 1.0 / step;
    k->length[l] = step * (rays->length != NULL ? rays->length[i] : sqrt(lr_dot(d, d)));
    if (options->phong != NULL)
        set_directions(k, l, d, options->phong);
    k->transmittance[l] = 1.0;
    k->begins[l] = INFINITY;
    k->looked[l] = k->taken[l] = 0;
    k->ray[l] = i;
    return true;
}

static void put_ray(const ray_lanes *k, int l, const lr_hits *hits, lr_counters *counters)
{
    const double light[3] = {k->light[0][l], k->light[1][l], k->light[2][l]};
    lr_put_light(hits, k->ray[l], k->begins[l], light, k->transmittance[l], k->looked[l], counters);
    counters->tests += k->taken[l];
    counters->samples += k->taken[l];
}

/* Give lane l the next ray that meets something; false: there is none. */
static bool next_ray(ray_lanes *k, int l, const lr_volume *v, const lr_rays *rays, uint64_t *next,
                     uint64_t end, const lr_trace_options *options, const lr_hits *hits)
{
    while (*next < end) {
        const uint64_t i = (*next)++;
        lr_put_dark(hits, i);
        if (begin_ray(k, l, v, rays, i, options))
            return true;
    }
    leave_idle(k, l);
    return false;
}

/* ---- where samples lie ------------------------------------------------------------ */

/* The cells of the next samples; those beside the box of visible cells are put next to it. */
LR_INLINE void find_cells(ray_lanes *k, const lr_volume *v)
{
    for (int a = 0; a < 3; a++) {
        const double low = v->surface_lo[a] - 1, high = v->surface_hi[a] + 1;
        EACH_LANE
        {
            const double q = k->o[a][l] + k->k[l] * k->step[l] * k->d[a][l];
            const double c = lr_clamp(floor(q), low, high);
            k->p[a][l] = lr_clamp(q - c, 0.0, 1.0);
            k->c[a][l] = (int32_t)c;
        }
    }
}

/* Where cells are, and which lie in the box of visible ones and before their ray's end. All lie in
 * the table. */
LR_INLINE void find_places(const ray_lanes *k, const lr_volume *v, int32_t place[LANES],
                           int32_t inside[LANES])
{
    const int32_t lo[3] = {v->surface_lo[0], v->surface_lo[1], v->surface_lo[2]};
    const int32_t hi[3] = {v->surface_hi[0], v->surface_hi[1], v->surface_hi[2]};
    EACH_LANE
    {
        const int32_t x = k->c[0][l], y = k->c[1][l], z = k->c[2][l];
        place[l] = (int32_t)lr_table_of(v, x, y, z);
        inside[l] = (k->k[l] < k->end[l]) & (x >= lo[0]) & (y >= lo[1]) & (z >= lo[2]) &
                    (x <= hi[0]) & (y <= hi[1]) & (z <= hi[2]);
    }
}

/* Are they visible, and if not, how much around them is not? By the masks of bricks. Beside the box
 * something in the same brick may be visible. */
LR_INLINE void look_at_masks(ray_lanes *k, const lr_volume *v)
{
    int32_t place[LANES], inside[LANES];
    uint32_t entry[LANES];
    uint64_t cells[LANES];
    find_places(k, v, place, inside);
    for (int l = 0; l < LANES; l++)
        entry[l] = lr_entry_at(v, (size_t)place[l]);
    for (int l = 0; l < LANES; l++)
        cells[l] = lr_entry_cells(v, entry[l], k->c[0][l], k->c[1][l], k->c[2][l]);
    EACH_LANE
    {
        const int32_t x = k->c[0][l], y = k->c[1][l], z = k->c[2][l];
        const int32_t any = lr_entry_has_word(entry[l], x, y, z) & inside[l];
        const int32_t around = lr_entry_words(entry[l]) == 0 ? LR_SIDE - 1 : LR_SIDE / 2 - 1;
        k->visible[l] = (double)(lr_cells_have(cells[l], x, y, z) & any);
        k->block[l] = (inside[l] & ~any) != 0 ? around : 0;
        k->reach[l] = 0;
    }
}

/* Likewise by distances. */
LR_INLINE void look_at_distances(ray_lanes *k, const lr_volume *v, const lr_empty_cubes *cubes)
{
    const uint32_t *const bricks = cubes->bricks;
    const uint8_t *const near = cubes->near[0];
    int32_t place[LANES], inside[LANES], cell[LANES], distance[LANES];
    uint32_t brick[LANES];
    find_places(k, v, place, inside);
    EACH_LANE
    cell[l] = lr_in_brick(k->c[0][l], k->c[1][l], k->c[2][l]);
    for (int l = 0; l < LANES; l++)
        brick[l] = bricks[place[l]];
    for (int l = 0; l < LANES; l++) {
        const uint32_t number = brick[l] & LR_FAR_BRICK ? 0 : brick[l];
        distance[l] = near[(size_t)number * LR_CELLS + (size_t)cell[l]];
    }
    EACH_LANE
    {
        const int32_t far = brick[l] & LR_FAR_BRICK ? 1 : 0;
        const int32_t bricks_off = ((int32_t)(brick[l] & 0xff) - 1) * LR_SIDE;
        const int32_t reach = far ? bricks_off : distance[l] - 1;
        k->visible[l] = (double)(inside[l] & (reach < 0));
        k->block[l] = (inside[l] & far) != 0 ? LR_SIDE - 1 : 0;
        k->reach[l] = (inside[l] & (reach > 0)) != 0 ? reach : 0;
    }
}

/* Lanes that stand on nothing visible leave the cube that has nothing. */
LR_INLINE void leap(ray_lanes *k)
{
    double out[LANES];
    EACH_LANE
    out[l] = INFINITY;
    for (int a = 0; a < 3; a++) {
        EACH_LANE
        {
            const int32_t low = (k->c[a][l] & ~k->block[l]) - k->reach[l];
            const int32_t high = (k->c[a][l] | k->block[l]) + k->reach[l] + 1;
            const double plane = k->up[a][l] != 0.0 ? (double)high : (double)low;
            const double t = (plane - k->o[a][l]) * k->inv[a][l] + k->never[a][l];
            out[l] = t < out[l] ? t : out[l];
        }
    }
    EACH_LANE
    {
        const double steps = out[l] * k->per_step[l], off = fabs(steps) * STEP_ROUNDING;
        const double first = ceil(steps - (off > STEP_SLACK ? off : STEP_SLACK));
        const double after = k->k[l] + 1.0;
        const double next = first > after ? first : after;
        k->k[l] = k->visible[l] != 0.0 ? k->k[l] : next;
        k->looked[l]++;
    }
}

/* Go on until most lanes stand on visible samples; how many do. */
LR_INLINE int find_samples(ray_lanes *k, const lr_volume *v, const lr_empty_cubes *cubes)
{
    double found = 0.0;
    for (int look = 0; look < LOOKS && found < ENOUGH; look++) {
        find_cells(k, v);
        if (cubes != NULL)
            look_at_distances(k, v, cubes);
        else
            look_at_masks(k, v);
        leap(k);
        found = 0.0;
        for (int l = 0; l < LANES; l++)
            found += k->visible[l];
    }
    return (int)found;
}

/* ---- samples ------------------------------------------------------------------------ */

/* The corners of the cells of visible samples. */
LR_INLINE void load_corners(ray_lanes *k, const lr_volume *v, int32_t type, size_t size)
{
    uint64_t rows[LR_CELL_ROWS][LANES];
    for (int l = 0; l < LANES; l++) {
        uint64_t row[LR_CELL_ROWS] = {0};
        if (k->visible[l] != 0.0)
            lr_load_rows(v, size, k->c[0][l], k->c[1][l], k->c[2][l], row);
        for (int n = 0; n < LR_CELL_ROWS; n++)
            rows[n][l] = row[n];
    }
    for (int n = 0; n < LR_CELL_ROWS; n++)
        EACH_LANE
    lr_unpack_row(rows[n][l], type, &k->corner[2 * n][l], &k->corner[2 * n + 1][l]);
}

/* The field at the samples; never beyond the corners', between which a cell's values are told
 * visible. */
LR_INLINE void interpolate(ray_lanes *k)
{
    EACH_LANE
    {
        double s[8];
        double low = k->corner[0][l], high = low;
        for (int b = 0; b < 8; b++) {
            s[b] = k->corner[b][l];
            low = s[b] < low ? s[b] : low;
            high = s[b] > high ? s[b] : high;
        }
        const double p[3] = {k->p[0][l], k->p[1][l], k->p[2][l]};
        k->value[l] = lr_clamp(lr_trilinear(s, p), low, high);
    }
}

LR_INLINE void find_pieces(const ray_lanes *k, const lr_transfer *f, double piece[LANES])
{
    if (f->n > LR_FEW_KNOTS) {
        for (int l = 0; l < LANES; l++)
            piece[l] = (double)lr_piece_of(f, k->value[l]);
        return;
    }
    EACH_LANE
    piece[l] = 0.0;
    for (uint64_t i = 0; i < f->n; i++) {
        const double knot = f->values[i];
        EACH_LANE
        piece[l] += k->value[l] >= knot ? 1.0 : 0.0;
    }
}

/* The lines of the pieces in which values lie. */
LR_INLINE void load_lines(ray_lanes *k, const lr_transfer *f)
{
    double piece[LANES];
    find_pieces(k, f, piece);
    for (int l = 0; l < LANES; l++) {
        const lr_transfer_piece *p = &f->pieces[(int32_t)piece[l]];
        k->from[l] = p->from;
        for (int i = 0; i < 2; i++) {
            k->extinction[i][l] = p->extinction[i];
            for (int a = 0; a < 3; a++)
                k->color[a][i][l] = p->color[a][i];
            for (int a = 0; a < 3 && f->emits; a++)
                k->emission[a][i][l] = p->emission[a][i];
        }
    }
}

/* What gradients do to samples that absorb or emit: modulate them, and light them. */
LR_INLINE void find_gradients(ray_lanes *k, gradient_lanes *g, const lr_volume *v,
                              const lr_trace_options *options, int32_t type)
{
    const lr_transfer *f = v->transfer;
    const bool central = options->phong != NULL && options->normal == LR_NORMAL_CENTRAL;
    double counts[LANES];
    EACH_LANE
    {
        const double from = k->value[l] - k->from[l];
        const double line = k->extinction[0][l] + k->extinction[1][l] * from;
        counts[l] = line > 0.0 || f->emits ? k->visible[l] : 0.0;
    }
    if (central || f->full_gradient > 0.0)
        load_around(g, v, k->c, counts, type);
    if (f->full_gradient > 0.0)
        modulate(g, v, k->p);
    if (options->phong == NULL)
        return;
    if (central)
        central_gradients(g, v, k->p);
    else
        analytic_gradients(g, v, k->corner, k->p);
    light_normals(g, k->view, k->lamp, options->phong->power);
}

/* Colours of samples, as they are lit. */
LR_INLINE void find_colors(const ray_lanes *k, const gradient_lanes *g, const lr_phong *phong,
                           const double from[LANES], double color[3][LANES])
{
    for (int a = 0; a < 3; a++)
        EACH_LANE
    color[a][l] = k->color[a][0][l] + k->color[a][1][l] * from[l];
    if (phong == NULL)
        return;
    for (int a = 0; a < 3; a++)
        EACH_LANE
        {
            const double share = phong->ambient + phong->diffuse * g->lit[l];
            color[a][l] = color[a][l] * share + phong->specular * g->highlight[l];
        }
}

LR_INLINE void add_samples(ray_lanes *k, const gradient_lanes *g, const lr_transfer *f,
                           const lr_phong *phong)
{
    double opacity[LANES], from[LANES], length[LANES], color[3][LANES];
    EACH_LANE
    length[l] = f->full_gradient > 0.0 ? k->length[l] * g->seen[l] : k->length[l];
    EACH_LANE
    {
        from[l] = k->value[l] - k->from[l];
        const double line = k->extinction[0][l] + k->extinction[1][l] * from[l];
        const double after = lr_lane_exp(-length[l] * (line > 0.0 ? line : 0.0));
        opacity[l] = k->visible[l] != 0.0 ? 1.0 - after : 0.0;
    }
    find_colors(k, g, phong, from, color);
    for (int a = 0; a < 3; a++)
        EACH_LANE
    k->light[a][l] += k->transmittance[l] * (opacity[l] * color[a][l]);
    for (int a = 0; a < 3 && f->emits; a++)
        EACH_LANE
        {
            const double shines = k->emission[a][0][l] + k->emission[a][1][l] * from[l];
            const double light = k->transmittance[l] * (length[l] * shines);
            k->light[a][l] += k->visible[l] != 0.0 ? light : 0.0;
        }
    EACH_LANE
    {
        k->transmittance[l] *= 1.0 - opacity[l];
        const double seen =
            1.0 - k->transmittance[l] + k->light[0][l] + k->light[1][l] + k->light[2][l];
        const double t = seen > 0.0 ? k->k[l] * k->step[l] : INFINITY;
        k->begins[l] = t < k->begins[l] ? t : k->begins[l];
        k->k[l] += k->visible[l];
        k->taken[l] += k->visible[l] != 0.0;
    }
}

/* ---- all of it ------------------------------------------------------------------------ */

/* Has any lane reached its ray's end? */
LR_INLINE bool some_have_ended(const ray_lanes *k, double opaque)
{
    double ended = 0.0;
    for (int l = 0; l < LANES; l++)
        ended += k->k[l] >= k->end[l] || k->transmittance[l] <= opaque ? 1.0 : 0.0;
    return ended > 0.0;
}

LR_INLINE void sample_rays(const lr_volume *v, const lr_empty_cubes *cubes, const lr_rays *rays,
                           uint64_t first, uint64_t end, const lr_trace_options *options,
                           const lr_hits *hits, lr_counters *counters, int32_t type, size_t size)
{
    ray_lanes k;
    gradient_lanes g;
    uint64_t next = first;
    const bool by_gradient = options->phong != NULL || v->transfer->full_gradient > 0.0;
    const double opaque = fmax(1.0 - options->stop_opacity, LR_OPAQUE);
    int busy = 0;
    memset(&k, 0, sizeof k);
    if (by_gradient)
        memset(&g, 0, sizeof g);
    for (int l = 0; l < LANES; l++)
        busy += next_ray(&k, l, v, rays, &next, end, options, hits);
    while (busy > 0) {
        if (find_samples(&k, v, cubes) > 0) {
            load_corners(&k, v, type, size);
            interpolate(&k);
            load_lines(&k, v->transfer);
            if (by_gradient)
                find_gradients(&k, &g, v, options, type);
            add_samples(&k, &g, v->transfer, options->phong);
        }
        if (!some_have_ended(&k, opaque))
            continue;
        for (int l = 0; l < LANES; l++) {
            if (!(k.k[l] >= k.end[l] || k.transmittance[l] <= opaque))
                continue;
            put_ray(&k, l, hits, counters);
            busy -= !next_ray(&k, l, v, rays, &next, end, options, hits);
        }
    }
    counters->rays += end - first;
}

void LR_SAMPLE_RAYS(const lr_volume *v, const lr_empty_cubes *cubes, const lr_rays *rays,
                    uint64_t first, uint64_t end, const lr_trace_options *options,
                    const lr_hits *hits, lr_counters *counters)
{
    switch (v->desc.sample_type) {
#define LR_SAMPLE_TYPE(id, name, stored, one, step)                                                \
    case id:                                                                                       \
        sample_rays(v, cubes, rays, first, end, options, hits, counters, id, sizeof(stored));      \
        return;
#include "grid/sample_types.def"
#undef LR_SAMPLE_TYPE
    }
}

#undef EACH_LANE
