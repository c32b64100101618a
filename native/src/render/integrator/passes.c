/* The passes beside the picture.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/passes.h"

#include "trace/structure.h"

static const float FAR_AWAY = 1e10f; /* the depth of nothing, as in Blender */

static void put(float *pass, uint64_t pixel, double value)
{
    if (pass != NULL)
        pass[pixel] = (float)value;
}

static void put_triple(float *pass, uint64_t pixel, const double value[3], double scale)
{
    for (uint64_t a = 0; a < 3 && pass != NULL; a++)
        pass[3 * pixel + a] = (float)(value[a] * scale);
}

void lr_write_nothing(const lr_job *job, uint64_t first, uint32_t n)
{
    static const double zero[3] = {0, 0, 0};
    const lr_passes *passes = job->passes;
    for (uint64_t p = first; p < first + n; p++) {
        put(passes->depth, p, FAR_AWAY);
        put(passes->object_index, p, 0);
        put(passes->material_index, p, 0);
        put(passes->error, p, 0);
        put(passes->volume, p, 0);
        put_triple(passes->normal, p, zero, 1);
        put_triple(passes->position, p, zero, 1);
    }
}

/* Width of a pixel across the ray at a depth. */
static double footprint(const lr_camera *camera, double depth)
{
    const double width = sqrt(lr_dot(camera->dx, camera->dx));
    return camera->projection == LR_PERSPECTIVE ? width * depth : width;
}

void lr_write_geometry(const lr_job *job, uint32_t n, uint64_t first)
{
    const lr_passes *passes = job->passes;
    for (uint32_t k = 0; k < n; k++) {
        const lr_shading_point *s = &job->workspace->shading_points[k];
        const lr_placed *placed = &job->scene->instances[s->instance];
        const double depth = job->workspace->wave.t[s->ray];
        const uint64_t p = first + s->path->pixel;
        put(passes->depth, p, depth);
        put(passes->object_index, p, s->object_index);
        put(passes->material_index, p, s->material->index);
        put(passes->error, p, placed->error / footprint(&job->scene->camera, depth));
        put(passes->volume, p, placed->volume_index);
        double normal[3];
        lr_bsdf_normal(&s->bsdf, normal);
        put_triple(passes->normal, p, normal, 1);
        put_triple(passes->position, p, s->position, 1);
    }
}

void lr_write_steps(const lr_job *job, uint32_t n, uint64_t first)
{
    const lr_workspace *w = job->workspace;
    for (uint32_t i = 0; i < n; i++)
        put(job->passes->steps, first + w->traced[i]->pixel, w->wave.hit.steps[i]);
}

/* As Cycles: by the distance from the camera, in a perspective view from its eye. */
void lr_add_mist(const lr_job *job, const lr_shading_point *s)
{
    const lr_scene *scene = job->scene;
    const lr_camera *camera = &scene->camera;
    if (job->passes->mist == NULL || !s->path->seen)
        return;
    double way[3], opaque = 0;
    for (int a = 0; a < 3; a++) {
        way[a] = s->position[a] - camera->eye[a];
        opaque += s->path->throughput[a] * (1 - s->bsdf.transparency[a]) / 3;
    }
    const double distance =
        camera->projection == LR_PERSPECTIVE
            ? sqrt(lr_dot(way, way))
            : lr_dot(way, camera->forward) / sqrt(lr_dot(camera->forward, camera->forward));
    const double reach = scene->mist_depth > 0 ? (distance - scene->mist_start) / scene->mist_depth
                                               : (distance > scene->mist_start);
    const double mist = pow(lr_clamp(reach, 0, 1), scene->mist_power);
    job->workspace->pixels[s->path->pixel].mist += (1 - mist) * opaque;
}

void lr_write_sums(const lr_job *job, uint64_t first, uint32_t n)
{
    const lr_workspace *w = job->workspace;
    const lr_passes *passes = job->passes;
    for (uint32_t i = 0; i < n; i++) {
        const lr_sum *pixel = &w->pixels[i];
        const uint64_t p = first + i;
        const double samples = w->sampled[i];
        for (uint64_t a = 0; a < 3; a++) {
            double sum = 0;
            for (int part = 0; part < LR_PARTS; part++)
                sum += pixel->part[part][a];
            passes->combined[4 * p + a] = (float)(sum / samples);
        }
        passes->combined[4 * p + 3] = (float)(1 + pixel->alpha / samples);
        put(passes->mist, p, 1 - pixel->mist / samples);
        put(passes->ao, p, pixel->ao / samples);
        put_triple(passes->emission, p, pixel->emission, 1 / samples);
        put_triple(passes->environment, p, pixel->environment, 1 / samples);
    }
}
