/* A tile: stretches of pixels, one sample of each at a time.
 *
 * Sample 0 goes through the pixel's centre, so the geometry passes cost no rays
 * of their own. Sums are kept in f64 and in the order of the samples; no pixel
 * knows of its neighbours, so that the picture does not depend on the tiles.
 *
 * Where a noise threshold is given, a pixel is settled when its noise is below it.
 * The noise is told by how far the means of its samples' interleaved quarters lie
 * apart, which sees that even samples are better than random ones.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "render/film/camera.h"
#include "render/film/pixel_filter.h"
#include "render/film/sampling.h"
#include "render/integrator/medium_stack.h"
#include "render/integrator/passes.h"
#include "render/integrator/path_record.h"
#include "render/integrator/path_trace.h"

enum {
    SIDE_MAX = 1 << 16,   /* pixels of a tile's side and */
    PLACE_MAX = 1 << 24,  /* of its place in the image: f64 film points stay exact */
    SAMPLES_MAX = 1 << 20 /* sums of f64 keep more than 30 bits */
};

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
    if (lr_min_i(tile->x, tile->y) < -PLACE_MAX || lr_max_i(tile->x, tile->y) > PLACE_MAX)
        return lr_fail(error, LR_E_ARGUMENT,
                       "a tile must lie within %d pixels of the origin, it lies at (%d, %d)",
                       PLACE_MAX, tile->x, tile->y);
    if (tile->samples < 1 || tile->samples > SAMPLES_MAX)
        return lr_fail(error, LR_E_ARGUMENT, "samples per pixel must be 1 to %d, they are %d",
                       SAMPLES_MAX, tile->samples);
    if (tile->branches < 1 || tile->branches > LR_BRANCHES_MAX)
        return lr_fail(error, LR_E_ARGUMENT, "branches per pixel must be 1 to %d, they are %d",
                       LR_BRANCHES_MAX, tile->branches);
    const int32_t bounces[] = {tile->max_bounces, tile->diffuse_bounces, tile->glossy_bounces,
                               tile->transmission_bounces, tile->transparent_bounces};
    for (size_t k = 0; k < sizeof bounces / sizeof *bounces; k++)
        if (bounces[k] < 0 || bounces[k] > LR_BOUNCES_MAX)
            return lr_fail(error, LR_E_ARGUMENT, "limits of bounces must be 0 to %d, one is %d",
                           LR_BOUNCES_MAX, bounces[k]);
    if (tile->filter != LR_FILM_BOX && tile->filter != LR_FILM_BLACKMAN_HARRIS)
        return lr_fail(error, LR_E_ARGUMENT, "the pixel's filter must be %d or %d, it is %d",
                       LR_FILM_BOX, LR_FILM_BLACKMAN_HARRIS, tile->filter);
    if (!(tile->filter_width > 0 && tile->filter_width <= 100))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the filter's width must be above 0 and up to 100 pixels, it is %g",
                       tile->filter_width);
    if (!(tile->noise_threshold >= 0) || !(tile->ao_distance > 0))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the noise threshold must be 0 or more and the reach of ambient occlusion "
                       "above 0, they are %g and %g",
                       tile->noise_threshold, tile->ao_distance);
    if (!(tile->ambient_distance >= 0 && tile->clamp_direct >= 0 && tile->clamp_indirect >= 0))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the reach of the ambient and the clamps must be 0 or more, they are %g, %g "
                       "and %g",
                       tile->ambient_distance, tile->clamp_direct, tile->clamp_indirect);
    if (tile->trace.mode != LR_MODE_SURFACE)
        return lr_fail(error, LR_E_ARGUMENT, "rendering needs surface mode (%d), the mode is %d",
                       LR_MODE_SURFACE, tile->trace.mode);
    if (tile->record != NULL && (tile->width != 1 || tile->height != 1))
        return lr_fail(error, LR_E_ARGUMENT,
                       "a tile with a record must be one pixel, it is %d x %d", tile->width,
                       tile->height);
    const uint64_t wanted = lr_render_nbytes(scene, tile->width, tile->height, tile->branches);
    if (workspace == NULL || nbytes < wanted)
        return lr_fail(error, LR_E_SIZE,
                       "a tile of %d x %d pixels needs a workspace of %llu bytes, it has %llu",
                       tile->width, tile->height, (unsigned long long)wanted,
                       (unsigned long long)(workspace != NULL ? nbytes : 0));
    return LR_OK;
}

/* The camera's ray through film point (x, y) as a path. */
static void start(const lr_job *job, uint32_t pixel, lr_turn turn, double x, double y)
{
    const lr_scene *scene = job->scene;
    lr_workspace *w = job->workspace;
    lr_path *path = &w->now.paths[(size_t)pixel * job->branches];
    *path = (lr_path){
        .throughput = {1, 1, 1},
        .pdf = INFINITY,
        .t_max = scene->camera.clip_end,
        .from = LR_NOWHERE,
        .pixel = pixel,
        .key = turn.key,
        .sample = turn.first + job->sample,
        .visibility = LR_VISIBLE_CAMERA,
        .seen = true,
    };
    lr_camera_ray(&scene->camera, x, y, path->origin, path->direction);
    w->now.n[pixel] = 1;
    if (scene->has_media) {
        double p[3];
        for (int a = 0; a < 3; a++)
            p[a] = path->origin[a] + scene->camera.clip_start * path->direction[a];
        const uint32_t forgotten = lr_medium_stack_find(scene, p, &path->media);
        if (job->counters != NULL)
            job->counters->forgotten += forgotten;
    }
    lr_record_ray(job, path, NULL, LR_RAY_CAMERA);
}

/* Start one sample of every pixel of the stretch that is not settled; it begins
 * at pixel `first` of the tile. */
static void aim(const lr_job *job, uint64_t first, uint32_t n)
{
    lr_workspace *w = job->workspace;
    const lr_tile *tile = job->tile;
    for (uint32_t i = 0; i < n; i++) {
        double u, v;
        w->now.n[i] = 0;
        if (w->settled[i] || lr_stopped(job->watch))
            continue;
        const int32_t x = tile->x + (int32_t)((first + i) % (uint64_t)tile->width);
        const int32_t y = tile->y + (int32_t)((first + i) / (uint64_t)tile->width);
        lr_film_sample(w->hash[i], job->sample, &u, &v);
        start(job, i, lr_pixel_turn(x, y, tile->seed, job->sample_bits),
              x + 0.5 + lr_filter_offset(w->filter, u), y + 0.5 + lr_filter_offset(w->filter, v));
        w->sampled[i]++;
    }
}

static void begin(const lr_job *job, uint64_t first, uint32_t n)
{
    lr_workspace *w = job->workspace;
    const lr_tile *tile = job->tile;
    memset(w->pixels, 0, n * sizeof *w->pixels);
    for (uint32_t i = 0; i < n; i++) {
        const int32_t x = tile->x + (int32_t)((first + i) % (uint64_t)tile->width);
        const int32_t y = tile->y + (int32_t)((first + i) / (uint64_t)tile->width);
        w->hash[i] = lr_pixel_hash(x, y, tile->seed);
        w->sampled[i] = 0;
        w->settled[i] = false;
    }
    lr_write_nothing(job, first, n);
}

/* The noise of a pixel's mean after n samples, relative to the root of its
 * brightness, as Cycles weighs it. */
static double noise(const lr_sum *pixel, uint32_t n)
{
    double sum = 0, error = 0;
    for (int a = 0; a < 3; a++) {
        double mean = 0, spread = 0;
        for (int k = 0; k < LR_PARTS; k++)
            mean += pixel->part[k][a];
        for (int k = 0; k < LR_PARTS; k++) {
            const double off = LR_PARTS * pixel->part[k][a] - mean;
            spread += off * off;
        }
        sum += mean / n;
        error += sqrt(spread / (LR_PARTS * (LR_PARTS - 1))) / n;
    }
    return error / (1e-4 + sqrt(fabs(sum))); /* Cycles' guard against black */
}

/* Cycles' choice where the user makes none. */
static uint32_t least_samples(const lr_tile *tile)
{
    if (tile->min_samples > 0)
        return (uint32_t)tile->min_samples;
    return (uint32_t)ceil(16 / fmin(pow(tile->noise_threshold, 0.3), 4));
}

/* Which pixels are done; true where all are. Looked at after 4, 8, 12, 16, 32, ... samples. */
static bool settle(const lr_job *job, uint32_t n_pixels)
{
    lr_workspace *w = job->workspace;
    const uint32_t n = job->sample + 1;
    const uint32_t every = n < 16 ? LR_PARTS : 16;
    if (!(job->tile->noise_threshold > 0) || n % every != 0 || n < least_samples(job->tile))
        return false;
    bool all = true;
    for (uint32_t i = 0; i < n_pixels; i++) {
        if (!w->settled[i])
            w->settled[i] = noise(&w->pixels[i], n) < job->tile->noise_threshold;
        all = all && w->settled[i];
    }
    return all;
}

uint64_t lr_render_nbytes(const lr_scene *scene, int32_t width, int32_t height, int32_t branches)
{
    if (scene == NULL || width < 1 || height < 1 || branches < 1 || branches > LR_BRANCHES_MAX)
        return 0;
    lr_workspace workspace;
    return lr_workspace_lay(NULL, (uint64_t)width * (uint64_t)height, (uint32_t)branches,
                            scene->hierarchy.height, &workspace);
}

/* The n pixels from `first` on. */
static lr_status render_stretch(lr_job *job, uint64_t first, uint32_t n)
{
    const lr_tile *tile = job->tile;
    const double n_pixels = (double)tile->width * tile->height;
    begin(job, first, n);
    for (int32_t sample = 0; sample < tile->samples; sample++) {
        job->sample = (uint32_t)sample;
        aim(job, first, n);
        const lr_status status = lr_trace_paths(job, n, first, sample == 0);
        if (status != LR_OK)
            return status;
        lr_progress(job->watch, ((double)first + n * (sample + 1.0) / tile->samples) / n_pixels);
        if (settle(job, n))
            break;
    }
    lr_write_sums(job, first, n);
    return LR_OK;
}

/* How many bits n has. */
static uint32_t bits_of(uint32_t n)
{
    return n > 0 ? 32 - (uint32_t)__builtin_clz(n) : 0;
}

lr_status lr_render_tile(const lr_scene *scene, const lr_tile *tile, const lr_passes *passes,
                         void *workspace, uint64_t nbytes, lr_counters *counters,
                         const lr_watch *watch, lr_error *error)
{
    lr_status status = check(scene, tile, passes, workspace, nbytes, error);
    if (status != LR_OK)
        return status;
    const uint64_t n_pixels = (uint64_t)tile->width * (uint64_t)tile->height;
    const uint32_t branches = (uint32_t)tile->branches;
    lr_workspace w;
    lr_workspace_lay(workspace, n_pixels, branches, scene->hierarchy.height, &w);
    lr_filter_make(tile->filter, tile->filter_width, w.filter);
    lr_job job = {
        .scene = scene,
        .workspace = &w,
        .tile = tile,
        .passes = passes,
        .counters = counters,
        .watch = watch,
        .error = error,
        .branches = branches,
        .sample_bits = bits_of((uint32_t)tile->samples - 1),
        .last_contributes = scene->world_shines || scene->shines || scene->has_lights,
    };
    for (uint64_t first = 0; first < n_pixels && status == LR_OK; first += LR_STRETCH) {
        const uint64_t left = n_pixels - first;
        status = render_stretch(&job, first, left < LR_STRETCH ? (uint32_t)left : LR_STRETCH);
    }
    return status;
}
