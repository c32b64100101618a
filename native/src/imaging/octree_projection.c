/* An octree of the surface projected to the film, node after node, in order of depth.
 *
 * Of a node's eight children the one nearest to the eye comes first, then its three neighbours by
 * a face, then the three by an edge, then the last: whatever ray goes through several of them
 * meets them in this order. Front to back, a node is left out where all pixels of its footprint
 * are filled, which a quadtree of open pixels tells; back to front, the nearer overwrites.
 *
 * A footprint is the rectangle around the node's projection, hence never too small. Which of a
 * leaf's pixels it fills is decided by the rays through their centres, with the planes and the
 * order of the walk cell by cell: the image is that of these rays, whether a leaf is larger than
 * a pixel or smaller, and depth is where the ray enters the leaf.
 *
 * Source: Meagher 1982. Departures: 1. rectangles in place of hexagons, and rays at the leaves;
 * 2. in perspective the first child is that on the eye's side of the node's planes, node by node;
 * 3. only surface cells are leaves: none of the others can be seen, but by a ray that starts in
 * one, and these are found first.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/surface_octree.h"
#include "imaging/film_map.h"
#include "imaging/open_pixels.h"
#include "imaging/pixel_ray.h"

enum {
    FRONT_TO_BACK = 0,
    BACK_TO_FRONT = 1,
    POLL = 256 /* nodes between looks at the stop word */
};

typedef struct projection {
    int32_t order;
    lr_octree *tree;
} projection;

/* One image. */
typedef struct job {
    const projection *made;
    const lr_view *view;
    lr_film_map map;
    lr_open_pixels pixels;
    double half[LR_OCTREE_LEVELS][3]; /* of the extents of a node's factors, by level */
    int nearest;                      /* child of a node that parallel rays meet first */
    lr_counters counters;
    const lr_watch *watch;
    bool stopped;
} job;

void lr_octree_projection_free(void *data)
{
    projection *p = data;
    lr_octree_free(p->tree);
    free(p);
}

lr_status lr_octree_projection_prepare(const lr_volume *v, const int32_t *choices,
                                       const lr_watch *watch, void **data, uint64_t *nbytes,
                                       lr_error *error)
{
    projection *p = calloc(1, sizeof *p);
    if (p == NULL)
        return lr_fail_memory(error, sizeof *p, "an octree projection");
    p->order = choices[0];
    const lr_status status = lr_octree_build(v, watch, &p->tree, nbytes, error);
    if (status != LR_OK) {
        free(p);
        return status;
    }
    *nbytes += sizeof *p;
    *data = p;
    return LR_OK;
}

/* ---- footprints ----------------------------------------------------------- */

/* The pixels whose centres lie in lo..hi of film coordinates; false: none of the image. NaN, and
 * what is beyond all pixels, is taken for the image's edge. */
static bool to_pixels(const lr_image *image, const double lo[2], const double hi[2], lr_rect *r)
{
    const double x0 = ceil(lo[0] - image->x - 0.5), x1 = floor(hi[0] - image->x - 0.5);
    const double y0 = ceil(lo[1] - image->y - 0.5), y1 = floor(hi[1] - image->y - 0.5);
    if (x0 >= image->width || x1 < 0.0 || y0 >= image->height || y1 < 0.0)
        return false;
    r->x0 = x0 > 0.0 ? (int32_t)x0 : 0;
    r->y0 = y0 > 0.0 ? (int32_t)y0 : 0;
    r->x1 = x1 < image->width - 1 ? (int32_t)x1 : image->width - 1;
    r->y1 = y1 < image->height - 1 ? (int32_t)y1 : image->height - 1;
    return r->x0 <= r->x1 && r->y0 <= r->y1;
}

/* Of a node whose factors (see film_map.h) are `middle` in its centre, in perspective. Before the
 * eye's plane, the bounds are those of the corners; where the node crosses it, x / t is bounded by
 * the bounds of x and of t. */
static bool project_by_eye(const job *j, int level, const double middle[3], lr_rect *r)
{
    const lr_film_map *m = &j->map;
    const double *half = j->half[level];
    const double t0 = fmax(middle[0] - half[0] - m->error[0], j->view->camera->clip_start);
    const double t1 = middle[0] + half[0] + m->error[0];
    double lo[2] = {INFINITY, INFINITY}, hi[2] = {-INFINITY, -INFINITY};
    if (t1 < t0)
        return false;
    if (!(middle[0] - half[0] > 2.0 * m->error[0])) {
        for (int i = 0; i < 2; i++) {
            const double least = middle[i + 1] - half[i + 1] - m->error[i + 1];
            const double most = middle[i + 1] + half[i + 1] + m->error[i + 1];
            lo[i] = least / (least < 0.0 ? t0 : t1);
            hi[i] = most / (most > 0.0 ? t0 : t1);
        }
        return to_pixels(j->view->image, lo, hi, r);
    }
    const double side = 0.5 * (1 << level);
    for (int n = 0; n < 8; n++) {
        double q[3];
        for (int i = 0; i < 3; i++)
            q[i] = middle[i] +
                   side * ((n & 1 ? 1 : -1) * m->row[i][0] + (n & 2 ? 1 : -1) * m->row[i][1] +
                           (n & 4 ? 1 : -1) * m->row[i][2]);
        for (int i = 0; i < 2; i++) {
            const double at = q[i + 1] / q[0];
            const double error = (m->error[i + 1] + fabs(at) * m->error[0]) / (q[0] - m->error[0]);
            lo[i] = fmin(lo[i], at - error);
            hi[i] = fmax(hi[i], at + error);
        }
    }
    return to_pixels(j->view->image, lo, hi, r);
}

/* The rectangle of pixels that a node may be seen in; false where there are none. */
static bool project_node(const job *j, int level, const int32_t c[3], lr_rect *r)
{
    const lr_film_map *m = &j->map;
    const double side = 0.5 * (1 << level), *half = j->half[level];
    const double p[3] = {c[0] + side, c[1] + side, c[2] + side};
    const double middle[3] = {lr_film_factor(m, 0, p), lr_film_factor(m, 1, p),
                              lr_film_factor(m, 2, p)};
    if (m->perspective)
        return project_by_eye(j, level, middle, r);
    double lo[2], hi[2];
    for (int i = 0; i < 2; i++) {
        lo[i] = middle[i + 1] - half[i + 1] - m->error[i + 1];
        hi[i] = middle[i + 1] + half[i + 1] + m->error[i + 1];
    }
    return to_pixels(j->view->image, lo, hi, r);
}

/* ---- nodes ---------------------------------------------------------------- */

static void fill_leaf(job *j, const int32_t c[3], const lr_rect *rect)
{
    const lr_view *view = j->view;
    const lr_volume *v = view->volume;
    j->counters.cells++;
    for (int32_t y = rect->y0; y <= rect->y1; y++)
        for (int32_t x = rect->x0; x <= rect->x1; x++) {
            lr_ray r;
            lr_cursor u, at;
            if (!lr_pixel_is_open(&j->pixels, x, y))
                continue;
            j->counters.tests++;
            if (!lr_pixel_ray(view, x, y, &r) ||
                !lr_enter(&r, LR_REGULAR, &u, v->surface_lo, v->surface_hi,
                          view->camera->clip_start) ||
                !lr_passes_cell(&r, &u, c, &at))
                continue;
            lr_put_pixel(view->image, lr_pixel_at(view->image, x, y), &at);
            if (j->made->order == FRONT_TO_BACK)
                lr_close_pixel(&j->pixels, x, y);
        }
}

/* The child that the eye's rays meet first. */
static int nearest_child(const job *j, int level, const int32_t c[3])
{
    if (!j->map.perspective)
        return j->nearest;
    int child = 0;
    for (int a = 0; a < 3; a++)
        child |= (j->map.base[a] >= c[a] + (1 << (level - 1))) << a;
    return child;
}

/* c: the lowest cell of the node, which holds surface. */
static void fill_node(job *j, int level, const int32_t c[3])
{
    static const int in_order[8] = {0, 1, 2, 4, 3, 5, 6, 7};
    const lr_volume *v = j->view->volume;
    lr_rect rect;
    if ((j->counters.nodes++ & (POLL - 1)) == 0)
        j->stopped = j->stopped || lr_stopped(j->watch);
    if (!project_node(j, level, c, &rect) || !lr_rect_is_open(&j->pixels, &rect))
        return;
    if (level == 0) {
        fill_leaf(j, c, &rect);
        return;
    }
    const int nearest = nearest_child(j, level, c);
    for (int n = 0; n < 8 && !j->stopped; n++) {
        const int child = nearest ^ in_order[j->made->order == FRONT_TO_BACK ? n : 7 - n];
        int32_t first[3];
        bool within = true;
        for (int a = 0; a < 3; a++) {
            first[a] = c[a] + ((child >> a & 1) << (level - 1));
            within = within && first[a] < LR_SIDE * v->table_size[a];
        }
        if (within && lr_octree_has(j->made->tree, v, level - 1, first))
            fill_node(j, level - 1, first);
    }
}

/* ---- images --------------------------------------------------------------- */

/* Rays that start in an object cell. */
static void fill_starts(job *j)
{
    const lr_image *image = j->view->image;
    for (int32_t y = 0; y < image->height && !j->stopped; y++) {
        j->stopped = lr_stopped(j->watch);
        for (int32_t x = 0; x < image->width; x++) {
            lr_ray r;
            lr_cursor u;
            if (!lr_pixel_ray(j->view, x, y, &r) ||
                !lr_starts_inside(j->view->volume, &r, LR_REGULAR, j->view->camera->clip_start, &u))
                continue;
            lr_put_pixel(image, lr_pixel_at(image, x, y), &u);
            lr_close_pixel(&j->pixels, x, y);
        }
    }
}

static void begin_projection(job *j)
{
    const lr_film_map *m = &j->map;
    double d[3];
    lr_map_vector(j->view->volume->storage_from_object, j->view->camera->forward, d);
    for (int a = 0; a < 3; a++)
        j->nearest |= (d[a] < 0.0) << a;
    for (int level = 0; level <= j->made->tree->top; level++)
        for (int i = 0; i < 3; i++)
            j->half[level][i] =
                0.5 * (1 << level) * (fabs(m->row[i][0]) + fabs(m->row[i][1]) + fabs(m->row[i][2]));
}

lr_status lr_octree_projection_render(const void *data, const lr_view *view, lr_counters *counters,
                                      const lr_watch *watch, lr_error *error)
{
    const lr_image *image = view->image;
    job j = {.made = data, .view = view, .watch = watch};
    uint64_t nbytes;
    lr_film_map_setup(&j.map, view->volume, view->camera, image);
    if (!lr_open_all_pixels(&j.pixels, image->width, image->height, &nbytes))
        return lr_fail_memory(error, nbytes, "a quadtree of pixels");
    begin_projection(&j);
    fill_starts(&j);
    if (view->volume->n_surface_cells > 0)
        fill_node(&j, j.made->tree->top, (const int32_t[3]){0, 0, 0});
    lr_free_pixels(&j.pixels);
    if (j.stopped)
        return lr_fail_stopped(error);
    const size_t n = (size_t)image->width * (size_t)image->height;
    for (size_t i = 0; i < n; i++)
        j.counters.hits += image->pixel[i] == LR_PIXEL_HIT;
    j.counters.rays = n;
    *counters = j.counters;
    return LR_OK;
}
