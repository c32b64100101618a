/* Parallel rays that share one list of steps, laid on the base plane, and a warp to the film.
 *
 * All rays of a parallel view have one direction, hence one discrete line: the template. The base
 * plane is the face of the volume that is most perpendicular to the rays, and a copy of the
 * template begins at each of its cells, and at those beside it whose copies come in by a side. The
 * copies of one step are a slice of the volume, shifted as a whole: each voxel is on exactly one
 * copy of a 26-connected template. In the 6-connected one a slice may be passed through by more
 * than one step; then its voxels are visited by as many copies.
 *
 * Since a row of copies visits a row of voxels at every step, 64 of them are one word of bits,
 * shifted: surface and not yet hit.
 *
 * Then every pixel takes what the copy nearest to its ray has hit.
 *
 * Not exact: a copy begins at the centre of a cell, up to half a voxel off the pixel's ray along
 * each axis, and a line of whole steps is up to half a voxel off again. t is where the pixel's ray
 * comes nearest to the cell in its slice.
 *
 * Source: Yagel and Kaufman 1992. Departures: 1. words of bits; 2. a 6-connected template is laid
 * on the base plane, too, and its voxels are visited more than once.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "imaging/film_map.h"
#include "imaging/pixel_ray.h"

enum { CONNECTED_26 = 0, CONNECTED_6 = 1, BITS = 64 };

/* Rows of surface bits of the box of the surface cells: of [0] along x, of [1] along y. */
typedef struct rows {
    int32_t connectivity;
    int32_t size[3];
    int32_t words[2]; /* of a row */
    uint64_t *bits[2];
} rows;

/* Which step of the template leads where, from its first voxel; k counts slices. */
typedef struct step {
    int32_t p, q, k;
} step;

/* One image. Axis m is across the base plane, rows of it lie along axis p, one after another along
 * axis q; all counts are from the box's corner. */
typedef struct job {
    const rows *made;
    const lr_view *view;
    int m, p, q;
    int32_t sign;               /* of the direction along m */
    int32_t n_steps, n_words;   /* words of a row of copies */
    int32_t first[2], count[2]; /* the copies that there are, along p and q */
    int32_t first_row, n_rows;  /* of them, those that the image needs */
    step *steps;
    uint64_t *open; /* [n_words]: copies of a row that have hit nothing */
    int32_t *hits;  /* [n_rows][count[0]]: the step that hit, or -1 */
    lr_counters counters;
} job;

/* ---- rows of bits -------------------------------------------------------- */

void lr_templates_free(void *data)
{
    rows *f = data;
    free(f->bits[0]);
    free(f->bits[1]);
    free(f);
}

/* The word of a row in which bit x is, of the layout along x or along y. */
LR_INLINE uint64_t *row_at(const rows *f, int layout, int32_t other, int32_t z)
{
    const size_t row = (size_t)z * (size_t)f->size[1 - layout] + (size_t)other;
    return f->bits[layout] + row * (size_t)f->words[layout];
}

static void add_cell(rows *f, const int32_t c[3])
{
    row_at(f, 0, c[1], c[2])[c[0] / BITS] |= (uint64_t)1 << c[0] % BITS;
    row_at(f, 1, c[0], c[2])[c[1] / BITS] |= (uint64_t)1 << c[1] % BITS;
}

static lr_status fill_rows(rows *f, const lr_volume *v, const lr_watch *watch, lr_error *error)
{
    int32_t b[3] = {-1, 0, 0}, c[3];
    while (lr_next_surface_brick(v, watch, b))
        for (lr_cell_iterator i = lr_surface_cells_of(v, b); lr_next_cell(&i, c);) {
            for (int a = 0; a < 3; a++)
                c[a] -= v->surface_lo[a];
            add_cell(f, c);
        }
    return lr_stopped(watch) ? lr_fail_stopped(error) : LR_OK;
}

lr_status lr_templates_prepare(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                               void **data, uint64_t *nbytes, lr_error *error)
{
    rows *f = calloc(1, sizeof *f);
    if (f == NULL)
        return lr_fail_memory(error, sizeof *f, "rows of surface cells");
    *nbytes = sizeof *f;
    f->connectivity = choices[0];
    lr_status status = LR_OK;
    for (int a = 0; a < 3; a++)
        f->size[a] = v->n_surface_cells > 0 ? v->surface_hi[a] - v->surface_lo[a] + 1 : 0;
    for (int layout = 0; layout < 2 && status == LR_OK; layout++) {
        f->words[layout] = (f->size[layout] + BITS - 1) / BITS;
        const size_t n =
            (size_t)f->size[1 - layout] * (size_t)f->size[2] * (size_t)f->words[layout];
        f->bits[layout] = calloc(n + 1, sizeof(uint64_t));
        *nbytes += n * sizeof(uint64_t);
        if (f->bits[layout] == NULL)
            status = lr_fail_memory(error, n * sizeof(uint64_t), "rows of surface cells");
    }
    if (status == LR_OK)
        status = fill_rows(f, v, watch, error);
    if (status != LR_OK) {
        lr_templates_free(f);
        return status;
    }
    *data = f;
    return LR_OK;
}

/* ---- the template -------------------------------------------------------- */

/* How far the template is along an axis of the base plane in slice k. */
LR_INLINE int32_t steps_along(double slope, int32_t k)
{
    const int32_t n = (int32_t)floor(fabs(slope) * k + 0.5);
    return slope < 0.0 ? -n : n;
}

/* From one slice to the next by its faces: the planes on the way, in the order in which the line
 * through the first voxel's centre crosses them. */
static void add_side_steps(job *j, const double slope[2], const step *to)
{
    step at = j->steps[j->n_steps - 1];
    for (;;) {
        const double along = at.k < to->k ? at.k + 0.5 : INFINITY; /* crosses the next slice */
        const double p = at.p != to->p ? (abs(at.p) + 0.5) / fabs(slope[0]) : INFINITY;
        const double q = at.q != to->q ? (abs(at.q) + 0.5) / fabs(slope[1]) : INFINITY;
        if (along <= p && along <= q)
            at.k++;
        else if (p <= q)
            at.p += slope[0] < 0.0 ? -1 : 1;
        else
            at.q += slope[1] < 0.0 ? -1 : 1;
        if (at.p == to->p && at.q == to->q && at.k == to->k)
            return;
        j->steps[j->n_steps++] = at;
    }
}

static void make_template(job *j, const double slope[2])
{
    int32_t least[2] = {0, 0}, most[2] = {0, 0};
    for (int32_t k = 0; k < j->made->size[j->m]; k++) {
        const step to = {steps_along(slope[0], k), steps_along(slope[1], k), k};
        if (j->made->connectivity == CONNECTED_6 && k > 0)
            add_side_steps(j, slope, &to);
        j->steps[j->n_steps++] = to;
        const int32_t at[2] = {to.p, to.q};
        for (int i = 0; i < 2; i++) {
            least[i] = lr_min_i(least[i], at[i]);
            most[i] = lr_max_i(most[i], at[i]);
        }
    }
    const int32_t size[2] = {j->made->size[j->p], j->made->size[j->q]};
    for (int i = 0; i < 2; i++) {
        j->first[i] = -most[i];
        j->count[i] = size[i] + most[i] - least[i];
    }
    j->n_words = (j->count[0] + BITS - 1) / BITS;
}

/* ---- copies -------------------------------------------------------------- */

/* The row of voxels in slice k that has number q in it. */
LR_INLINE const uint64_t *row_of(const job *j, int32_t q, int32_t k)
{
    const int32_t slice = j->sign > 0 ? k : j->made->size[j->m] - 1 - k;
    if (j->m == 2)
        return row_at(j->made, 0, q, slice);
    return row_at(j->made, j->m == 0, slice, q);
}

/* Bits at..at+63 of a row of n bits, 0 beyond its ends. */
LR_INLINE uint64_t bits_at(const uint64_t *row, int32_t n_words, int32_t at)
{
    const int32_t word = at >= 0 ? at / BITS : -((BITS - 1 - at) / BITS), shift = at - word * BITS;
    const uint64_t low = word >= 0 && word < n_words ? row[word] : 0;
    const uint64_t high = word >= -1 && word + 1 < n_words ? row[word + 1] : 0;
    return shift == 0 ? low : low >> shift | high << (BITS - shift);
}

/* Which of bits at..at+63 are bits of a row of n. */
LR_INLINE uint64_t bits_within(int32_t n, int32_t at)
{
    const int32_t from = lr_max_i(0, -at), to = lr_min_i(BITS, n - at);
    if (from >= to)
        return 0;
    return ~(uint64_t)0 >> (BITS - (to - from)) << from;
}

/* One step of a row of copies, whose first is at voxel `at` of the row of voxels. */
static void take_step(job *j, const uint64_t *row, int32_t at, int32_t number, int32_t *hits)
{
    const int32_t n = j->made->size[j->p], n_words = (n + BITS - 1) / BITS;
    const int32_t from = lr_max_i(0, -at) / BITS;
    const int32_t to = lr_min_i(j->n_words, (n - at + BITS - 1) / BITS);
    for (int32_t w = from; w < to; w++) {
        const int32_t first = at + w * BITS;
        const uint64_t visited = j->open[w] & bits_within(n, first);
        uint64_t found = visited & bits_at(row, n_words, first);
        j->counters.cells += (uint64_t)__builtin_popcountll(visited);
        j->open[w] &= ~found;
        for (; found != 0; found &= found - 1) {
            hits[w * BITS + __builtin_ctzll(found)] = number;
            j->counters.hits++;
        }
    }
}

static void trace_row(job *j, int32_t row)
{
    const int32_t size = j->made->size[j->q];
    int32_t *hits = j->hits + (size_t)(row - j->first_row) * (size_t)j->count[0];
    for (int32_t w = 0; w < j->n_words; w++)
        j->open[w] = bits_within(j->count[0], w * BITS);
    for (int32_t i = 0; i < j->count[0]; i++)
        hits[i] = -1;
    j->counters.rays += (uint64_t)j->count[0];
    for (int32_t n = 0; n < j->n_steps; n++) {
        const step *s = &j->steps[n];
        const int32_t q = row + s->q;
        if (q >= 0 && q < size)
            take_step(j, row_of(j, q, s->k), j->first[0] + s->p, n, hits);
    }
}

/* ---- the warp ------------------------------------------------------------ */

/* The copy that begins nearest to where a ray crosses the first slice's centres. */
LR_INLINE void copy_of(const job *j, const lr_ray *r, double copy[2])
{
    const lr_volume *v = j->view->volume;
    const int axis[2] = {j->p, j->q};
    const double plane =
        (j->sign > 0 ? v->surface_lo[j->m] : v->surface_hi[j->m]) + 0.5; /* the slice's centres */
    const double t = (plane - r->o[j->m]) * r->inv[j->m];
    for (int i = 0; i < 2; i++)
        copy[i] = floor(r->o[axis[i]] + t * r->d[axis[i]]) - v->surface_lo[axis[i]];
}

/* Where the ray is nearest to the cell within its slice. */
static double t_near(const job *j, const lr_ray *r, const int32_t c[3])
{
    const double in = lr_plane_t(r, LR_REGULAR, j->m, c[j->m] + (j->sign < 0));
    const double out = lr_plane_t(r, LR_REGULAR, j->m, c[j->m] + (j->sign > 0));
    double t = in;
    for (int a = 0; a < 3; a++)
        if (a != j->m && r->s[a] != 0)
            t = fmax(t, fmin(out, lr_plane_t(r, LR_REGULAR, a, c[a] + (r->s[a] < 0))));
    return t;
}

static void warp_pixel(const job *j, int32_t x, int32_t y)
{
    const lr_volume *v = j->view->volume;
    const lr_camera *camera = j->view->camera;
    lr_ray r;
    double copy[2];
    if (!lr_pixel_ray(j->view, x, y, &r))
        return;
    copy_of(j, &r, copy);
    const double column = copy[0] - j->first[0], row = copy[1] - j->first_row;
    if (!(column >= 0.0 && column < j->count[0] && row >= 0.0 && row < j->n_rows))
        return;
    const int32_t n = j->hits[(size_t)row * (size_t)j->count[0] + (size_t)column];
    if (n < 0)
        return;
    lr_cursor u = {.axis = j->m};
    u.c[j->p] = v->surface_lo[j->p] + (int32_t)copy[0] + j->steps[n].p;
    u.c[j->q] = v->surface_lo[j->q] + (int32_t)copy[1] + j->steps[n].q;
    u.c[j->m] =
        j->sign > 0 ? v->surface_lo[j->m] + j->steps[n].k : v->surface_hi[j->m] - j->steps[n].k;
    u.t = t_near(j, &r, u.c);
    if (u.t >= camera->clip_start && u.t <= camera->clip_end)
        lr_put_pixel(j->view->image, lr_pixel_at(j->view->image, x, y), &u);
}

/* The rows of copies that the image's corners lie between, and hence all of its pixels. */
static void choose_rows(job *j)
{
    const lr_image *image = j->view->image;
    double least = INFINITY, most = -INFINITY;
    for (int n = 0; n < 4; n++) {
        lr_ray r;
        double copy[2] = {0.0, 0.0};
        if (lr_pixel_ray(j->view, n & 1 ? image->width - 1 : 0, n & 2 ? image->height - 1 : 0, &r))
            copy_of(j, &r, copy);
        least = fmin(least, copy[1] - 1.0); /* a row more, for rounding */
        most = fmax(most, copy[1] + 1.0);
    }
    const int32_t last = j->first[1] + j->count[1] - 1;
    j->first_row = (int32_t)lr_clamp(least, j->first[1], last);
    j->n_rows = (int32_t)lr_clamp(most, j->first[1], last) - j->first_row + 1;
}

/* ---- images -------------------------------------------------------------- */

static lr_status render_with(job *j, const lr_watch *watch, lr_error *error)
{
    const lr_image *image = j->view->image;
    for (int32_t row = 0; row < j->n_rows; row++) {
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        lr_progress(watch, (double)row / j->n_rows);
        trace_row(j, j->first_row + row);
    }
    for (int32_t y = 0; y < image->height; y++) {
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        for (int32_t x = 0; x < image->width; x++)
            warp_pixel(j, x, y);
    }
    return LR_OK;
}

/* The axis across the base plane, and the slopes of the template along the others. */
static void choose_base_plane(job *j, double slope[2])
{
    double d[3];
    lr_map_vector(j->view->volume->storage_from_object, j->view->camera->forward, d);
    j->m = 0;
    for (int a = 1; a < 3; a++)
        j->m = fabs(d[a]) > fabs(d[j->m]) ? a : j->m;
    j->p = j->m == 0 ? 1 : 0;
    j->q = j->m == 2 ? 1 : 2;
    j->sign = d[j->m] > 0.0 ? 1 : -1;
    slope[0] = d[j->p] / fabs(d[j->m]);
    slope[1] = d[j->q] / fabs(d[j->m]);
}

/* Rays begin at the base plane: what a camera would cut off before cannot be told. */
static lr_status check_start(const lr_view *view, lr_error *error)
{
    lr_film_map map;
    double range[2];
    lr_film_map_setup(&map, view->volume, view->camera, view->image);
    if (lr_depth_range(&map, view->volume, range) && range[0] < view->camera->clip_start)
        return lr_fail(error, LR_E_ARGUMENT,
                       "templates begin before the surface, at a depth of %g: the camera must not "
                       "clip from %g",
                       range[0], view->camera->clip_start);
    return LR_OK;
}

lr_status lr_templates_render(const void *data, const lr_view *view, lr_counters *counters,
                              const lr_watch *watch, lr_error *error)
{
    const rows *made = data;
    job j = {.made = made, .view = view};
    double slope[2];
    lr_status status = check_start(view, error);
    if (status != LR_OK || made->size[0] == 0)
        return status != LR_OK ? status : lr_stopped(watch) ? lr_fail_stopped(error) : LR_OK;
    choose_base_plane(&j, slope);
    const size_t most_steps = 3 * (size_t)made->size[j.m];
    j.steps = malloc(most_steps * sizeof *j.steps);
    if (j.steps == NULL)
        return lr_fail_memory(error, most_steps * sizeof *j.steps, "a template");
    make_template(&j, slope);
    choose_rows(&j);
    const size_t n_hits = (size_t)j.n_rows * (size_t)j.count[0];
    j.open = malloc((size_t)j.n_words * sizeof *j.open + n_hits * sizeof *j.hits);
    if (j.open == NULL)
        status = lr_fail_memory(error, n_hits * sizeof *j.hits, "an image of the base plane");
    else {
        j.hits = (int32_t *)(j.open + j.n_words);
        status = render_with(&j, watch, error);
    }
    free(j.open);
    free(j.steps);
    *counters = j.counters;
    return status;
}
