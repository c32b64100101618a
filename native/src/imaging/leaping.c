/* Rays of an animation that start where the frame before has shown that nothing lies before.
 *
 * Along each ray a frame keeps a tube: up to some depth, no surface comes nearer than its
 * clearance. A ray of the next frame is held against the tube of the pixel in which the camera saw
 * its neighbourhood before. The distance of the two lines is convex along the ray, so that it is
 * largest at the ends; where it stays below the clearance at both, all between is empty, and the
 * ray starts at the end of the tube, which is its own tube now, thinner by that distance. Where the
 * ray before missed, its tube has no end, and a ray within it misses. A tube too thin for the
 * camera's motion is made anew, by spheres of empty space that leave its clearance free on all
 * sides.
 *
 * Nothing is taken from the frame before but emptiness: whatever turns into view is found, and the
 * cell and t of a hit are those of the walk, which recomputes t from the planes.
 *
 * Source: Yagel and Shi 1993. Departures: 1. they carry first hits to the next frame and start rays
 * there, which loses what rotates in before them; here only tubes that are proved empty are
 * carried;
 * 2. perspective, and any motion of the camera.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "imaging/film_map.h"
#include "imaging/line_clearance.h"
#include "imaging/pixel_ray.h"

enum { BY_SPHERES = 0, BY_CELLS = 1 };

/* Voxels: how wide tubes are made, if there is no frame before; at least, as they take time; at
 * most, as wide ones end far before the surface. */
static const double FIRST_WIDTH = 0.5, LEAST_WIDTH = 0.25, MOST_WIDTH = 3.0;
static const double FRAMES = 6.0; /* for which a tube is to last, if all are moved alike */

typedef struct leaping {
    int32_t walk;
    lr_radii *radii;
} leaping;

/* The part of a line that is known to be empty: from t0 to t1, for so many voxels around. */
typedef struct tube {
    double o[3], d[3], square; /* of d */
    double t0, t1;             /* -infinity and infinity where it has no end */
    double clearance;
} tube;

/* One image. */
typedef struct job {
    const leaping *made;
    const lr_view *view;
    lr_film_map then;   /* of the frame before */
    bool starts_inside; /* may a ray start in the lattice? */
    lr_ray parallel;    /* the ray that all others are but for their origin */
    lr_pace pace;       /* of it; its slack is enough for all rays */
    lr_counters counters;
} job;

void lr_leaping_free(void *data)
{
    leaping *l = data;
    lr_radii_free(l->radii);
    free(l);
}

lr_status lr_leaping_prepare(const lr_volume *v, const int32_t *choices, const lr_watch *watch,
                             void **data, uint64_t *nbytes, lr_error *error)
{
    leaping *l = calloc(1, sizeof *l);
    if (l == NULL)
        return lr_fail_memory(error, sizeof *l, "clearances");
    l->walk = choices[0];
    const lr_status status = lr_radii_make(v, LR_METRIC_EUCLID, true, watch, &l->radii, error);
    if (status != LR_OK) {
        free(l);
        return status;
    }
    *data = l;
    *nbytes = sizeof *l + l->radii->nbytes;
    return LR_OK;
}

/* ---- tubes of the frame before --------------------------------------------- */

/* The tube of a pixel of the frame before; false where it has none. */
static bool tube_of(const job *j, int32_t x, int32_t y, tube *t)
{
    const lr_frame_before *before = j->view->before;
    const double *kept = before->empty + 2 * ((size_t)y * (size_t)before->width + (size_t)x);
    t->t1 = kept[0];
    t->clearance = fabs(kept[1]);
    if (!(t->clearance > 0.0))
        return false;
    for (int a = 0; a < 3; a++) {
        const double film = (x + 0.5) * j->then.side[1][a] + (y + 0.5) * j->then.side[2][a];
        t->o[a] = j->then.base[a] + (j->then.perspective ? 0.0 : film);
        t->d[a] = j->then.side[0][a] + (j->then.perspective ? film : 0.0);
    }
    t->square = lr_dot(t->d, t->d);
    t->t0 = kept[1] > 0.0 ? -INFINITY : before->camera.clip_start;
    return true;
}

/* Which pixel of the frame before looked through p; the nearest one of those at its border. */
static void pixel_before(const job *j, const double p[3], int32_t pixel[2])
{
    const lr_frame_before *before = j->view->before;
    const double t = j->then.perspective ? lr_film_factor(&j->then, 0, p) : 1.0;
    for (int i = 0; i < 2; i++) {
        const double most = (i == 0 ? before->width : before->height) - 1.0;
        pixel[i] = (int32_t)lr_clamp(floor(lr_film_factor(&j->then, i + 1, p) / t), 0.0, most);
    }
}

LR_INLINE void point_on(const double o[3], const double d[3], double t, double p[3])
{
    for (int a = 0; a < 3; a++)
        p[a] = o[a] + t * d[a];
}

static double distance_to_tube(const tube *t, const double p[3])
{
    double q[3];
    lr_sub(p, t->o, q);
    const double at = fmin(fmax(lr_dot(q, t->d) / t->square, t->t0), t->t1);
    for (int a = 0; a < 3; a++)
        q[a] -= at * t->d[a];
    return sqrt(lr_dot(q, q));
}

/* How far along the ray, from the cursor on, the tube may show it empty, and how far from the
 * middle of the tube the ray comes on the way: voxels. */
static double along_tube(const lr_ray *r, const lr_pace *p, const lr_cursor *u, const tube *t,
                         double *apart)
{
    double end, q[3];
    if (t->t1 < INFINITY) {
        point_on(t->o, t->d, t->t1, q);
        lr_sub(q, r->o, q);
        end = lr_dot(q, r->d) * p->per_voxel * p->per_voxel;
    } else {
        int axis;
        end = lr_exit_t(r, LR_REGULAR, r->lo, r->hi, &axis);
    }
    point_on(r->o, r->d, u->t, q);
    *apart = distance_to_tube(t, q);
    point_on(r->o, r->d, end, q);
    *apart = fmax(*apart, distance_to_tube(t, q)) + 4.0 * p->slack;
    return end;
}

/* ---- walks ------------------------------------------------------------------ */

/* Lengthen a tube by what is empty for its clearance around the ray, from the cursor on; false
 * where the ray leaves the box of the surface cells. */
static bool lengthen(job *j, const lr_ray *r, const lr_pace *p, lr_cursor *u, double clearance)
{
    for (;;) {
        const double radius = lr_radius_at(j->made->radii, u->c);
        j->counters.cells++;
        if (!(radius >= clearance && radius > 0.0))
            return true;
        bool jump;
        if (!lr_next_sphere(r, u, radius - clearance, p, &jump))
            return false;
        j->counters.jumps += jump;
    }
}

/* To the first surface cell; false at the ray's end. */
static bool walk_to_surface(job *j, const lr_ray *r, const lr_pace *p, lr_cursor *u)
{
    const bool by_spheres = j->made->walk == BY_SPHERES;
    for (;;) {
        j->counters.cells++;
        if (lr_is_surface_cell(j->view->volume, u->c))
            return true;
        bool jump = false;
        if (!(by_spheres ? lr_next_sphere(r, u, lr_radius_at(j->made->radii, u->c), p, &jump)
                         : lr_step(r, LR_REGULAR, u)))
            return false;
        j->counters.jumps += jump;
    }
}

/* What of a tube that has left the box holds behind it. */
static double clearance_behind(const job *j, const lr_ray *r, const lr_pace *p)
{
    double t;
    int32_t c[3];
    const int axis = lr_last_cell_of_ray(r, &t, c);
    if (!(t <= r->t_max)) /* cut off in the box: what lies behind is unknown */
        return 0.0;
    return lr_clearance_outside(r, p, axis, lr_radius_at(j->made->radii, c));
}

/* ---- pixels ----------------------------------------------------------------- */

/* Set up the ray of a pixel and stand it on its first cell, as lr_start_pixel does. */
static lr_pixel_start start_ray(const job *j, int32_t x, int32_t y, lr_ray *r, lr_cursor *u)
{
    const lr_view *view = j->view;
    const lr_volume *v = view->volume;
    if (j->starts_inside)
        return lr_start_pixel(view, x, y, r, u);
    if (view->camera->projection == LR_PERSPECTIVE) {
        if (!lr_pixel_ray(view, x, y, r))
            return LR_START_NOWHERE;
    } else {
        double o[3], d[3];
        lr_camera_ray(view->camera, view->image->x + x + 0.5, view->image->y + y + 0.5, o, d);
        *r = j->parallel;
        lr_map_point(v->storage_from_object, o, r->o);
    }
    return lr_enter(r, LR_REGULAR, u, v->surface_lo, v->surface_hi, view->camera->clip_start)
               ? LR_START_AHEAD
               : LR_START_NOWHERE;
}

/* Hold the ray against the tube of a pixel of the frame before. True where it shows some of the ray
 * empty: *clearance is what is left of its own around the ray up to *end; else *apart, if there is
 * a tube, is how far the ray lies from it. */
static bool leap_by(const job *j, const int32_t pixel[2], const lr_ray *r, const lr_pace *p,
                    const lr_cursor *u, double *end, double *clearance, double *apart)
{
    tube t;
    if (!tube_of(j, pixel[0], pixel[1], &t))
        return false;
    *end = along_tube(r, p, u, &t, apart);
    *clearance = t.clearance - *apart;
    if (t.t1 == INFINITY)
        *end = INFINITY;
    return *clearance > 0.0 && *end > u->t;
}

/* The same for the pixel that looked where the ray goes: as a first guess, that of the same place,
 * then that in which the end of its tube was seen. */
static bool leap(const job *j, int32_t x, int32_t y, const lr_ray *r, const lr_pace *p,
                 const lr_cursor *u, double *end, double *clearance, double *apart)
{
    const lr_frame_before *before = j->view->before;
    const lr_image *image = j->view->image;
    const int32_t same[2] = {lr_min_i(image->x + x, before->width - 1),
                             lr_min_i(image->y + y, before->height - 1)};
    double q[3];
    int32_t pixel[2];
    int axis;
    if (leap_by(j, same, r, p, u, end, clearance, apart))
        return true;
    const double out = lr_exit_t(r, LR_REGULAR, r->lo, r->hi, &axis);
    point_on(r->o, r->d, *end > u->t && *end < out ? *end : 0.5 * (u->t + out), q);
    pixel_before(j, q, pixel);
    return (pixel[0] != same[0] || pixel[1] != same[1]) &&
           leap_by(j, pixel, r, p, u, end, clearance, apart);
}

static double width_of_tubes(double apart)
{
    return apart >= 0.0 ? lr_clamp(FRAMES * apart, LEAST_WIDTH, MOST_WIDTH) : FIRST_WIDTH;
}

/* See tube_of. */
static void keep_tube(double *kept, double end, double clearance, bool whole)
{
    kept[0] = end;
    kept[1] = whole ? clearance : -clearance;
}

/* Does the ray hit? Then the cursor is on the cell. kept: its tube, see tube_of; or NULL. */
static bool trace_pixel(job *j, int32_t x, int32_t y, const lr_ray *r, lr_cursor *u, double *kept,
                        bool *skipped)
{
    const bool whole = u->axis >= 0;
    double end = 0.0, clearance = 0.0, apart = -1.0;
    lr_pace p = j->pace;
    if (j->view->camera->projection == LR_PERSPECTIVE)
        p.per_voxel = 1.0 / sqrt(lr_dot(r->d, r->d));
    const double outside =
        whole ? lr_clearance_outside(r, &p, u->axis, lr_radius_at(j->made->radii, u->c)) : INFINITY;
    if (j->view->before != NULL && leap(j, x, y, r, &p, u, &end, &clearance, &apart)) {
        const double t = end - 2.0 * p.slack * p.per_voxel;
        if (end == INFINITY || (t > u->t && (t > r->t_max || !lr_cell_along(r, t, u->c)))) {
            if (kept != NULL)
                keep_tube(kept, end, fmin(clearance, fmin(outside, clearance_behind(j, r, &p))),
                          whole);
            *skipped = true;
            return false;
        }
        if (t > u->t) {
            u->t = t;
            u->axis = -1;
        }
    } else
        clearance = width_of_tubes(apart);
    clearance = fmin(clearance, outside);
    if (kept == NULL)
        return walk_to_surface(j, r, &p, u);
    const bool inside = lengthen(j, r, &p, u, clearance);
    keep_tube(kept, inside ? u->t : INFINITY,
              inside ? clearance : fmin(clearance, clearance_behind(j, r, &p)), whole);
    return inside && walk_to_surface(j, r, &p, u);
}

static void render_pixel(job *j, int32_t x, int32_t y)
{
    const lr_image *image = j->view->image;
    const size_t at = lr_pixel_at(image, x, y);
    double *kept = image->empty != NULL ? image->empty + 2 * at : NULL;
    lr_ray r;
    lr_cursor u;
    bool skipped = false;
    if (kept != NULL)
        kept[0] = kept[1] = 0.0;
    const lr_pixel_start start = start_ray(j, x, y, &r, &u);
    const bool hit = start == LR_START_INSIDE ||
                     (start == LR_START_AHEAD && trace_pixel(j, x, y, &r, &u, kept, &skipped));
    j->counters.rays += !skipped;
    if (skipped)
        image->pixel[at] = LR_PIXEL_SKIPPED;
    if (!hit)
        return;
    j->counters.hits++;
    lr_put_pixel(image, at, &u);
}

/* May a ray start in the lattice, where it may be in an object cell? */
static bool may_start_inside(const lr_view *view)
{
    const lr_volume *v = view->volume;
    lr_film_map map;
    lr_film_map_setup(&map, v, view->camera, view->image);
    double least = INFINITY;
    for (int n = 0; n < 8; n++) {
        const double p[3] = {n & 1 ? v->desc.nx + 2.0 : 1.0, n & 2 ? v->desc.ny + 2.0 : 1.0,
                             n & 4 ? v->desc.nz + 2.0 : 1.0};
        least = fmin(least, lr_film_factor(&map, 0, p));
    }
    return !(least > view->camera->clip_start + map.error[0]);
}

lr_status lr_leaping_render(const void *data, const lr_view *view, lr_counters *counters,
                            const lr_watch *watch, lr_error *error)
{
    const lr_image *image = view->image;
    job j = {.made = data, .view = view, .starts_inside = may_start_inside(view)};
    if (view->before != NULL)
        lr_film_map_setup(&j.then, view->volume, &view->before->camera, image);
    lr_pixel_ray(view, 0, 0, &j.parallel);
    j.pace.per_voxel = 1.0 / sqrt(lr_dot(j.parallel.d, j.parallel.d));
    j.pace.slack = lr_extent_of(view->volume, view->camera, image) * 0x1p-49;
    for (int32_t y = 0; y < image->height; y++) {
        if (lr_stopped(watch))
            return lr_fail_stopped(error);
        lr_progress(watch, (double)y / image->height);
        for (int32_t x = 0; x < image->width; x++)
            render_pixel(&j, x, y);
    }
    *counters = j.counters;
    return LR_OK;
}
