/* Renders a tile: ranges of pixels, one sample of each at a time.
 *
 * Sample 0 goes through the pixel's centre, so the geometry passes need no rays of their
 * own. Pixels are independent of each other, so that the picture does not depend on the
 * tiles.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/error.h"
#include "render/film/camera.h"
#include "render/film/film.h"
#include "render/film/pixel_filter.h"
#include "render/film/sampling.h"
#include "render/integrator/medium_stack.h"
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
    const int32_t bounces[] = {tile->max_bounces,         tile->diffuse_bounces,
                               tile->glossy_bounces,      tile->transmission_bounces,
                               tile->transparent_bounces, tile->volume_bounces};
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
        return lr_fail(
            error, LR_E_ARGUMENT,
            "the noise threshold must be 0 or more and the distance of ambient occlusion "
            "above 0, they are %g and %g",
            tile->noise_threshold, tile->ao_distance);
    if (!(tile->ambient_distance >= 0 && tile->clamp_direct >= 0 && tile->clamp_indirect >= 0))
        return lr_fail(
            error, LR_E_ARGUMENT,
            "the distance of the ambient light and the clamps must be 0 or more, they are %g, %g "
            "and %g",
            tile->ambient_distance, tile->clamp_direct, tile->clamp_indirect);
    if (tile->trace.mode != LR_MODE_SURFACE)
        return lr_fail(error, LR_E_ARGUMENT, "rendering needs surface mode (%d), the mode is %d",
                       LR_MODE_SURFACE, tile->trace.mode);
    if (tile->trace.phong != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "scenes are lit by their lights, not as samples of rays by themselves are");
    if (tile->record != NULL && (tile->width != 1 || tile->height != 1))
        return lr_fail(error, LR_E_ARGUMENT,
                       "a tile with a record must be one pixel, it is %d x %d", tile->width,
                       tile->height);
    const uint64_t needed = lr_render_nbytes(scene, tile->width, tile->height, tile->branches);
    if (workspace == NULL || nbytes < needed)
        return lr_fail(error, LR_E_SIZE,
                       "a tile of %d x %d pixels needs a workspace of %llu bytes, it has %llu",
                       tile->width, tile->height, (unsigned long long)needed,
                       (unsigned long long)(workspace != NULL ? nbytes : 0));
    return LR_OK;
}

/* The camera's ray through film point (x, y), and the solids that it begins in. */
static void start_path(const lr_context *context, double x, double y, lr_path *path)
{
    const lr_scene *scene = context->scene;
    lr_camera_ray(&scene->camera, x, y, path->origin, path->direction);
    if (!scene->has_media)
        return;
    double p[3];
    for (int a = 0; a < 3; a++)
        p[a] = path->origin[a] + scene->camera.clip_start * path->direction[a];
    const uint32_t forgotten = lr_medium_stack_find(scene, p, path->visibility, &path->media);
    if (context->counters != NULL)
        context->counters->forgotten += forgotten;
}

/* Start one sample of every pixel that is not settled: reads the film; writes paths, and counts
 * the samples on the film. */
static void start_paths(const lr_context *context, uint32_t sample_bits, lr_film *film,
                        lr_path_queue *paths)
{
    for (uint32_t pixel = 0; pixel < film->n_pixels; pixel++) {
        double x, y;
        paths->n[pixel] = 0;
        if (lr_stopped(context->watch) || !lr_film_next(film, pixel, &x, &y))
            continue;
        const int32_t *place = film->place[pixel];
        const lr_turn turn = lr_pixel_turn(place[0], place[1], film->tile->seed, sample_bits);
        lr_path *path = &paths->paths[lr_slot_of(paths, pixel)];
        *path = (lr_path){
            .throughput = {1, 1, 1},
            .pdf = INFINITY,
            .t_max = context->scene->camera.clip_end,
            .from = LR_NOWHERE,
            .pixel = pixel,
            .key = turn.key,
            .sample = turn.first + film->sample,
            .visibility = LR_VISIBLE_CAMERA,
            .seen = true,
            .primary = true,
        };
        start_path(context, x, y, path);
        paths->n[pixel] = 1;
        lr_record_ray(path, NULL, LR_RAY_CAMERA, film->tile->record);
    }
}

/* Lay all working memory out from base, which may be NULL to get the size. Returns the bytes
 * used. */
static uint64_t lay(void *base, uint64_t n_pixels, uint32_t paths_per_pixel, const lr_scene *scene,
                    lr_queues *queues, lr_film *film)
{
    enum { LINE = 64 }; /* arrays begin on cache lines */
    const uint64_t n = n_pixels < LR_STRETCH ? n_pixels : LR_STRETCH;
    const uint64_t skip = (LINE - (uintptr_t)base % LINE) % LINE;
    lr_arena arena = {base != NULL ? (char *)base + skip : NULL, 0};
    lr_queues_lay(&arena, n, paths_per_pixel, scene, queues);
    lr_film_lay(&arena, n, film);
    return arena.used + (base != NULL ? skip : LINE);
}

uint64_t lr_render_nbytes(const lr_scene *scene, int32_t width, int32_t height, int32_t branches)
{
    if (scene == NULL || width < 1 || height < 1 || branches < 1 || branches > LR_BRANCHES_MAX)
        return 0;
    lr_queues queues;
    lr_film film;
    return lay(NULL, (uint64_t)width * (uint64_t)height, (uint32_t)branches, scene, &queues, &film);
}

/* How many bits n has. */
static uint32_t bits_of(uint32_t n)
{
    return n > 0 ? 32 - (uint32_t)__builtin_clz(n) : 0;
}

/* All samples of the film's pixels. */
static lr_status render_stretch(const lr_context *context, lr_queues *queues, lr_film *film)
{
    const lr_tile *tile = context->tile;
    const double n_pixels = (double)tile->width * tile->height;
    const uint32_t samples = (uint32_t)tile->samples, sample_bits = bits_of(samples - 1);
    for (film->sample = 0; film->sample < samples; film->sample++) {
        start_paths(context, sample_bits, film, &queues->now);
        const lr_status status = lr_trace_paths(context, film->sample == 0, queues, film);
        if (status != LR_OK)
            return status;
        const double done = film->n_pixels * (film->sample + 1.0) / samples;
        lr_progress(context->watch, ((double)film->first + done) / n_pixels);
        if (lr_film_settle(film))
            break;
    }
    lr_film_write(film);
    return LR_OK;
}

lr_status lr_render_tile(const lr_scene *scene, const lr_tile *tile, const lr_passes *passes,
                         void *workspace, uint64_t nbytes, lr_counters *counters,
                         const lr_watch *watch, lr_error *error)
{
    lr_status status = check(scene, tile, passes, workspace, nbytes, error);
    if (status != LR_OK)
        return status;
    const uint64_t n_pixels = (uint64_t)tile->width * (uint64_t)tile->height;
    const lr_context context = {
        .scene = scene,
        .tile = tile,
        .last_contributes =
            scene->world_emits || scene->emits || scene->has_lights || scene->n_participants > 0,
        .counters = counters,
        .watch = watch,
        .error = error,
    };
    lr_queues queues;
    lr_film film = {.tile = tile, .passes = passes};
    lay(workspace, n_pixels, (uint32_t)tile->branches, scene, &queues, &film);
    lr_filter_make(tile->filter, tile->filter_width, film.filter);
    for (uint64_t first = 0; first < n_pixels && status == LR_OK; first += LR_STRETCH) {
        const uint64_t left = n_pixels - first;
        lr_film_begin(&film, first, left < LR_STRETCH ? (uint32_t)left : LR_STRETCH);
        status = render_stretch(&context, &queues, &film);
    }
    return status;
}
