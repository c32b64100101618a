/* A tile: stretches of pixels, one sample of each at a time.
 *
 * Sample 0 goes through the pixel's centre, so the geometry passes cost no rays
 * of their own. Sums are kept in f64 and in the order of the samples; no pixel
 * knows of its neighbours, so that the picture does not depend on the tiles.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "error.h"
#include "render/camera.h"
#include "render/cast.h"
#include "render/waves.h"
#include "render/sampling.h"
#include "render/surface.h"

enum {
    SIDE_MAX = 1 << 16,   /* pixels of a tile's side and */
    PLACE_MAX = 1 << 24,  /* of its place in the image: f64 film points stay exact */
    SAMPLES_MAX = 1 << 20 /* sums of f64 keep more than 30 bits */
};

static const float FAR_AWAY = 1e10f; /* the depth of nothing, as in Blender */

static lr_status check(const lr_scene *scene, const lr_tile *tile, const lr_passes *passes,
                       const void *workspace, uint64_t nbytes, lr_error *error)
{
    if (scene == NULL || tile == NULL || passes == NULL || passes->combined == NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "a tile needs a scene, a tile, passes and a combined pass, one is NULL");
    if (tile->width < 1 || tile->height < 1 || tile->width > SIDE_MAX || tile->height > SIDE_MAX)
        return lr_fail(error, LR_E_ARGUMENT,
                       "a tile's sides must be 1 to %d pixels, they are %d and %d", SIDE_MAX,
                       tile->width, tile->height);
    if (abs(tile->x) > PLACE_MAX || abs(tile->y) > PLACE_MAX)
        return lr_fail(error, LR_E_ARGUMENT,
                       "a tile must lie within %d pixels of the origin, it lies at (%d, %d)",
                       PLACE_MAX, tile->x, tile->y);
    if (tile->samples < 1 || tile->samples > SAMPLES_MAX)
        return lr_fail(error, LR_E_ARGUMENT, "samples per pixel must be 1 to %d, they are %d",
                       SAMPLES_MAX, tile->samples);
    if (tile->trace.mode != LR_MODE_SURFACE)
        return lr_fail(error, LR_E_ARGUMENT, "rendering needs surface mode (%d), the mode is %d",
                       LR_MODE_SURFACE, tile->trace.mode);
    const uint64_t wanted = lr_render_nbytes(scene, tile->width, tile->height);
    if (workspace == NULL || nbytes < wanted)
        return lr_fail(error, LR_E_SIZE,
                       "a tile of %d x %d pixels needs a workspace of %llu bytes, it has %llu",
                       tile->width, tile->height, (unsigned long long)wanted,
                       (unsigned long long)(workspace != NULL ? nbytes : 0));
    return LR_OK;
}

/* Aim one sample of every pixel of the stretch that begins at pixel `first`. */
static void aim(const lr_job *job, const lr_tile *tile, uint64_t first, uint32_t n, uint32_t sample)
{
    lr_workspace *w = job->workspace;
    for (uint32_t i = 0; i < n; i++) {
        const int32_t x = tile->x + (int32_t)((first + i) % (uint64_t)tile->width);
        const int32_t y = tile->y + (int32_t)((first + i) / (uint64_t)tile->width);
        double u, v, o[3], d[3];
        w->hash[i] = lr_pixel_hash(x, y, tile->seed);
        lr_film_sample(w->hash[i], sample, &u, &v);
        lr_camera_ray(&job->scene->camera, x + u, y + v, o, d);
        w->wave.ray.ox[i] = o[0];
        w->wave.ray.oy[i] = o[1];
        w->wave.ray.oz[i] = o[2];
        w->wave.ray.dx[i] = d[0];
        w->wave.ray.dy[i] = d[1];
        w->wave.ray.dz[i] = d[2];
    }
}

static void write_nothing(const lr_passes *passes, uint64_t first, uint32_t n)
{
    for (uint64_t p = first; p < first + n; p++) {
        if (passes->depth != NULL)
            passes->depth[p] = FAR_AWAY;
        if (passes->object_index != NULL)
            passes->object_index[p] = 0;
        for (int a = 0; a < 3; a++) {
            if (passes->normal != NULL)
                passes->normal[3 * p + (uint64_t)a] = 0;
            if (passes->position != NULL)
                passes->position[3 * p + (uint64_t)a] = 0;
        }
    }
}

/* The geometry of the rays through the pixels' centres; t is the depth. */
static void write_geometry(const lr_job *job, const lr_passes *passes, uint64_t first,
                           uint32_t n_surfels)
{
    for (uint32_t k = 0; k < n_surfels; k++) {
        const lr_surfel *s = &job->workspace->surfels[k];
        const uint64_t p = first + s->pixel;
        if (passes->depth != NULL)
            passes->depth[p] = (float)job->workspace->wave.t[s->pixel];
        if (passes->object_index != NULL)
            passes->object_index[p] = (float)s->object_index;
        for (int a = 0; a < 3; a++) {
            if (passes->normal != NULL)
                passes->normal[3 * p + (uint64_t)a] = (float)s->normal[a];
            if (passes->position != NULL)
                passes->position[3 * p + (uint64_t)a] = (float)s->position[a];
        }
    }
}

/* What the camera's rays have hit becomes surfels; what they have not is the
 * world. Returns the number of surfels. */
static uint32_t see(const lr_job *job, uint32_t n)
{
    lr_workspace *w = job->workspace;
    uint32_t n_surfels = 0;
    for (uint32_t i = 0; i < n; i++) {
        const bool hit = w->wave.instance[i] != LR_NOWHERE;
        if (hit) {
            w->surfels[n_surfels].pixel = i;
            lr_surface_find(job->scene, &w->wave, i, &w->surfels[n_surfels++]);
        } else if (!job->scene->film_transparent) {
            for (int a = 0; a < 3; a++)
                w->sum[i][a] += job->scene->environment.color[a];
        }
        w->sum[i][3] += hit || !job->scene->film_transparent;
    }
    return n_surfels;
}

static lr_status render_sample(const lr_job *job, const lr_tile *tile, const lr_passes *passes,
                               uint64_t first, uint32_t n, uint32_t sample)
{
    const lr_cast_options options = {
        .visibility = LR_VISIBLE_CAMERA,
        .t_min = job->scene->camera.clip_start,
        .t_max = job->scene->camera.clip_end,
        .trace = job->trace,
    };
    aim(job, tile, first, n, sample);
    const lr_status status =
        lr_cast(job->scene, job->workspace, n, &options, job->counters, job->watch, job->error);
    if (status != LR_OK)
        return status;
    const uint32_t n_surfels = see(job, n);
    if (sample == 0) {
        write_nothing(passes, first, n);
        write_geometry(job, passes, first, n_surfels);
    }
    return lr_light_surfels(job, n_surfels, sample);
}

static void write_combined(const lr_workspace *w, float *combined, uint32_t n, int32_t samples)
{
    for (uint32_t i = 0; i < n; i++)
        for (int a = 0; a < 4; a++)
            combined[4 * (size_t)i + (size_t)a] = (float)(w->sum[i][a] / samples);
}

uint64_t lr_render_nbytes(const lr_scene *scene, int32_t width, int32_t height)
{
    if (scene == NULL || width < 1 || height < 1)
        return 0;
    lr_workspace workspace;
    return lr_workspace_lay(NULL, (uint64_t)width * (uint64_t)height, scene->hierarchy.height,
                            &workspace);
}

lr_status lr_render_tile(const lr_scene *scene, const lr_tile *tile, const lr_passes *passes,
                         void *workspace, uint64_t nbytes, lr_counters *counters,
                         const lr_watch *watch, lr_error *error)
{
    lr_status status = check(scene, tile, passes, workspace, nbytes, error);
    if (status != LR_OK)
        return status;
    const uint64_t n_pixels = (uint64_t)tile->width * (uint64_t)tile->height;
    lr_workspace w;
    lr_workspace_lay(workspace, n_pixels, scene->hierarchy.height, &w);
    const lr_job job = {scene, &w, tile->trace, counters, watch, error};
    for (uint64_t first = 0; first < n_pixels; first += LR_STRETCH) {
        const uint32_t n =
            n_pixels - first < LR_STRETCH ? (uint32_t)(n_pixels - first) : LR_STRETCH;
        memset(w.sum, 0, n * sizeof *w.sum);
        for (int32_t sample = 0; sample < tile->samples; sample++) {
            status = render_sample(&job, tile, passes, first, n, (uint32_t)sample);
            if (status != LR_OK)
                return status;
            lr_progress(watch,
                        ((double)first + n * (sample + 1.0) / tile->samples) / (double)n_pixels);
        }
        write_combined(&w, passes->combined + 4 * first, n, tile->samples);
    }
    return LR_OK;
}
