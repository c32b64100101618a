/* First object cells of parallel rays, with pixels skipped around those that miss.
 *
 * No surface lies within some clearance of the line of a ray that misses. All lines of the
 * image are parallel, so every pixel whose line is nearer than that misses too and is not
 * traced. Pixels are visited on coarse grids first, so that an empty region is found early
 * and pixels are skipped on all its sides.
 *
 * The clearance is that of the whole line. Between two points with empty radii a and b at a
 * distance l it is at least (a + b - l) / 2, not the smaller radius; if that is too little
 * to skip a pixel, the radius half-way is looked up too. Before and behind the volume the
 * clearance is bounded by the distance from the point where the line crosses a face of the
 * surface's box. Without both, pixels are lost: the paper, which takes the least radius of
 * the samples, loses some.
 *
 * Lengths are in voxels, so that voxels may be boxes or sheared: the squared distance of the
 * lines of two pixels is a quadratic form of their coordinates.
 *
 * Source: Zuiderveld, Koning and Viergever 1992. Departures: 1. the bounds above; 2. the
 * order of pixels; 3. any affine film in place of orthonormal axes. Rays in perspective
 * are not parallel and are refused.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "imaging/line_clearance.h"
#include "imaging/pixel_ray.h"

enum {
    SAFE = 0, /* choices of the option `skip` */
    NONE = 1,
    PAPER = 2,
    PENDING = 0xff, /* a pixel not yet visited */
    COARSEST = 16,  /* pixels between two of the first grid */
    HALVINGS = 4,   /* of a jump whose clearance is too little */
    POLL = 64,      /* pixels between checks of the stop word */
};

typedef struct clearances {
    int32_t skip;
    lr_radii *radii;
} clearances;

/* One image. */
typedef struct job {
    const lr_radii *radii;
    const lr_volume *volume;
    const lr_view *view;
    const lr_image *image;
    int32_t skip;
    double xx, xy, yy; /* (i, j) pixels apart: xx i^2 + 2 xy i j + yy j^2 voxels^2 between lines */
    double nearest;    /* voxels: no two lines are nearer to each other */
    lr_tally tally;
    uint64_t rays, hits;
} job;

/* A point of the ray, and the empty radius there. */
typedef struct sample {
    double t, radius;
    int32_t c[3];
} sample;

/* The clearance of the line between two samples in different cells; searched no further once
 * it is `enough`. */
static double clearance_between(const job *j, const lr_ray *r, const lr_pace *p, const sample *a,
                                const sample *b, double enough, int halvings)
{
    const double least = 0.5 * (a->radius + b->radius - (b->t - a->t) / p->per_voxel);
    sample middle = {.t = 0.5 * (a->t + b->t), .c = {a->c[0], a->c[1], a->c[2]}};
    if (least >= enough || halvings == 0 || !lr_cell_along(r, middle.t, middle.c))
        return least;
    middle.radius = lr_radius_at(j->radii, middle.c);
    const double before = clearance_between(j, r, p, a, &middle, enough, halvings - 1);
    if (before <= least)
        return least;
    const double behind = clearance_between(j, r, p, &middle, b, enough, halvings - 1);
    return fmax(least, fmin(before, behind));
}

/* How far p lies beyond lo..hi along an axis, signed. */
LR_INLINE double beyond(double p, double lo, double hi)
{
    return p < lo ? p - lo : p > hi ? p - hi : 0.0;
}

/* Between a line and the box of the surface cells. The derivative of the squared distance
 * grows along the line and is linear from plane to plane; its zero lies between two. */
static double clearance_of_box(const lr_ray *r, const lr_volume *v)
{
    double slope[2] = {-INFINITY, INFINITY}, at[2] = {0.0, 0.0}, lo[3], hi[3], square = 0.0;
    if (v->n_surface_cells == 0)
        return INFINITY;
    for (int a = 0; a < 3; a++) {
        lo[a] = v->surface_lo[a];
        hi[a] = v->surface_hi[a] + 1.0;
    }
    for (int n = 0; n < 6; n++) {
        const int axis = n >> 1;
        if (r->s[axis] == 0)
            continue;
        const double t = ((n & 1 ? hi[axis] : lo[axis]) - r->o[axis]) * r->inv[axis];
        double sum = 0.0;
        for (int a = 0; a < 3; a++)
            if (r->s[a] != 0 && a != axis) /* on its own plane an axis adds nothing */
                sum += r->d[a] * beyond(r->o[a] + t * r->d[a], lo[a], hi[a]);
        const int side = sum > 0.0; /* the planes next to the zero, on either side of it */
        const bool nearer = side == 0 ? sum > slope[0] : sum < slope[1];
        const bool beside = side == 0 ? t > at[0] : t < at[1];
        if (nearer || (sum == slope[side] && beside)) {
            slope[side] = sum;
            at[side] = t;
        }
    }
    double t = at[0];
    if (slope[0] < 0.0 && slope[1] < INFINITY)
        t += (at[1] - at[0]) * (-slope[0] / (slope[1] - slope[0]));
    for (int a = 0; a < 3; a++) {
        const double q = r->s[a] != 0 ? r->o[a] + t * r->d[a] : r->o[a];
        const double e = beyond(q, lo[a], hi[a]);
        square += e * e;
    }
    return sqrt(square);
}

/* Where the ray leaves the box of the surface cells. */
static int leaving(const job *j, const lr_ray *r, sample *end)
{
    const int axis = lr_last_cell_of_ray(r, &end->t, end->c);
    end->radius = lr_radius_at(j->radii, end->c);
    return axis;
}

/* Walk from the cell that the cursor stands on to the first surface cell; false at the
 * ray's end. least: the smallest radius on the path. */
static bool walk(job *j, const lr_ray *r, const lr_pace *p, lr_cursor *u, double *least)
{
    *least = INFINITY;
    for (;;) {
        j->tally.cells++;
        if (lr_is_surface_cell(j->volume, u->c))
            return true;
        const double radius = lr_radius_at(j->radii, u->c);
        *least = fmin(*least, radius);
        bool jump;
        if (!lr_next_sphere(r, u, radius, p, &jump))
            return false;
        j->tally.jumps += jump;
    }
}

/* The clearance of the line of a ray that misses, from where it enters the box of the surface
 * cells: walks the ray again, with the clearance between the samples. */
static double clearance_of_line(const job *j, const lr_ray *r, const lr_pace *p, lr_cursor u)
{
    sample from, to = {u.t, lr_radius_at(j->radii, u.c), {u.c[0], u.c[1], u.c[2]}};
    double clearance = lr_clearance_outside(r, p, u.axis, to.radius);
    for (bool inside = true, jump; inside;) {
        int axis = -1;
        from = to;
        inside = lr_next_sphere(r, &u, from.radius, p, &jump);
        if (inside) {
            to = (sample){u.t, lr_radius_at(j->radii, u.c), {u.c[0], u.c[1], u.c[2]}};
        } else {
            axis = leaving(j, r, &to);
            clearance = fmin(clearance, lr_clearance_outside(r, p, axis, to.radius));
        }
        /* without a jump the radii hold for all of the cells that were crossed */
        const double here =
            jump ? clearance_between(j, r, p, &from, &to, clearance, HALVINGS) : from.radius;
        clearance = fmin(clearance, here);
    }
    return clearance;
}

/* Trace pixel (x, y) of the image; returns the voxels around its line that are known to
 * be empty, 0 where it hits. */
static double visit(job *j, int32_t x, int32_t y)
{
    const size_t at = lr_pixel_at(j->image, x, y);
    lr_ray r;
    lr_cursor u;
    lr_pace pace;
    bool hit = false;
    j->rays++;
    j->image->pixel[at] = LR_PIXEL_MISS;
    const lr_pixel_start start = lr_start_pixel(j->view, x, y, &r, &u);
    if (start == LR_START_INSIDE)
        hit = true;
    double clearance = 0.0, least;
    memcpy(r.hi, j->volume->surface_hi, sizeof r.hi); /* which a ray beside the box has not got */
    lr_begin_spheres(&r, &pace);
    if (start == LR_START_AHEAD) {
        const lr_cursor first = u;
        int axis;
        hit = walk(j, &r, &pace, &u, &least);
        /* The clearance before the ray's begin and behind its end is unknown. */
        const bool whole =
            first.axis >= 0 && lr_exit_t(&r, LR_REGULAR, r.lo, r.hi, &axis) <= r.t_max;
        if (!hit && whole && least > j->nearest)
            clearance = j->skip == SAFE ? clearance_of_line(j, &r, &pace, first) : least;
    } else if (!hit && j->skip == SAFE)
        clearance = clearance_of_box(&r, j->volume);
    if (!hit)
        return clearance - 4.0 * pace.slack;
    j->hits++;
    lr_put_pixel(j->image, at, &u);
    return 0.0;
}

/* Skip the pixels whose lines are nearer to that of (x, y) than the clearance. */
static void skip_around(const job *j, int32_t x, int32_t y, double clearance)
{
    const lr_image *image = j->image;
    const double square = clearance * clearance, det = j->xx * j->yy - j->xy * j->xy;
    const double rows = lr_clamp(clearance * sqrt(j->xx / det), 0.0, image->height);
    const int32_t first = lr_max_i(0, y - (int32_t)rows);
    const int32_t last = lr_min_i(image->height - 1, y + (int32_t)rows);
    for (int32_t row = first; row <= last; row++) {
        const double dy = row - y, middle = -j->xy * dy / j->xx;
        const double half = sqrt(fmax(0.0, square - det / j->xx * dy * dy) / j->xx);
        /* a margin for rounding; it takes in no pixel that lies on the border */
        const double inside = half * (1.0 - 0x1p-30);
        const int32_t from = (int32_t)lr_clamp(ceil(x + middle - inside), 0.0, image->width);
        const int32_t to = (int32_t)lr_clamp(floor(x + middle + inside), -1.0, image->width - 1.0);
        uint8_t *pixel = image->pixel + (size_t)row * (size_t)image->width;
        for (int32_t i = from; i <= to; i++)
            pixel[i] = pixel[i] == PENDING ? LR_PIXEL_SKIPPED : pixel[i];
    }
}

/* The distances of neighbouring lines. */
static void measure_film(job *j)
{
    double d[3], step[2][3];
    const lr_camera *camera = j->view->camera;
    lr_map_vector(j->volume->storage_from_object, camera->forward, d);
    const double length = sqrt(lr_dot(d, d));
    for (int n = 0; n < 2; n++) {
        lr_map_vector(j->volume->storage_from_object, n == 0 ? camera->dx : camera->dy, step[n]);
        const double along = lr_dot(step[n], d) / length / length;
        for (int a = 0; a < 3; a++)
            step[n][a] -= along * d[a];
    }
    j->xx = lr_dot(step[0], step[0]);
    j->xy = lr_dot(step[0], step[1]);
    j->yy = lr_dot(step[1], step[1]);
    const double det = j->xx * j->yy - j->xy * j->xy, half = 0.5 * (j->xx + j->yy);
    j->nearest = sqrt(det / (half + sqrt(fmax(0.0, half * half - det)))); /* the least eigenvalue */
}

/* The pixels of one grid that are not known yet; false where stopped. */
static bool visit_grid(job *j, int32_t spacing, const lr_watch *watch)
{
    const lr_image *image = j->image;
    for (int32_t y = 0; y < image->height; y += spacing)
        for (int32_t x = 0; x < image->width; x += spacing) {
            if (image->pixel[lr_pixel_at(image, x, y)] != PENDING)
                continue;
            if ((j->rays & (POLL - 1)) == 0 && lr_stopped(watch))
                return false;
            const double clearance = visit(j, x, y);
            if (clearance > j->nearest && j->skip != NONE)
                skip_around(j, x, y, clearance);
        }
    return true;
}

void lr_pixel_skip_free(void *data)
{
    clearances *c = data;
    lr_radii_free(c->radii);
    free(c);
}

lr_status lr_pixel_skip_prepare(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                                void **data, uint64_t *nbytes, lr_error *error)
{
    static const int32_t metrics[] = {LR_METRIC_EUCLID, LR_METRIC_CHESSBOARD, LR_METRIC_CITYBLOCK,
                                      LR_METRIC_CHAMFER345};
    clearances *c = calloc(1, sizeof *c);
    if (c == NULL)
        return lr_fail_memory(error, sizeof *c, "clearances");
    c->skip = choices[0];
    const lr_status status = lr_radii_make(v, metrics[choices[1]], true, watch, &c->radii, error);
    if (status != LR_OK) {
        free(c);
        return status;
    }
    *data = c;
    *nbytes = sizeof *c + c->radii->nbytes;
    return LR_OK;
}

lr_status lr_pixel_skip_render(const void *data, const lr_view *view, lr_counters *counters,
                               const lr_watch *watch, lr_error *error)
{
    const clearances *c = data;
    const lr_image *image = view->image;
    const size_t n = (size_t)image->width * (size_t)image->height;
    job j = {
        .radii = c->radii, .volume = view->volume, .view = view, .image = image, .skip = c->skip};
    measure_film(&j);
    memset(image->pixel, PENDING, n);
    for (int32_t spacing = COARSEST; spacing > 0; spacing /= 2) {
        lr_progress(watch, (double)j.rays / (double)n);
        if (!visit_grid(&j, spacing, watch))
            return lr_fail_stopped(error);
    }
    *counters = (lr_counters){
        .rays = j.rays, .cells = j.tally.cells, .jumps = j.tally.jumps, .hits = j.hits};
    return LR_OK;
}
