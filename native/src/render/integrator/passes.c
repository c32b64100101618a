/* The passes beside the combined one.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/passes.h"

/* Width of a pixel across the ray at a depth. */
static double footprint(const lr_camera *camera, double depth)
{
    const double width = sqrt(lr_dot(camera->dx, camera->dx));
    return camera->projection == LR_PERSPECTIVE ? width * depth : width;
}

/* Of a point behind something without a surface: as t of the camera's ray. */
static double depth_of(const lr_camera *camera, const double p[3])
{
    double to_point[3];
    for (int a = 0; a < 3; a++)
        to_point[a] = p[a] - camera->eye[a];
    const double depth = lr_dot(to_point, camera->forward);
    return depth / lr_dot(camera->forward, camera->forward);
}

void lr_write_geometry(const lr_scene *scene, const lr_shading_queue *shading_points, lr_film *film)
{
    const lr_passes *passes = film->passes;
    for (uint32_t k = 0; k < shading_points->n; k++) {
        const lr_shading_point *s = &shading_points->points[k];
        const lr_placed *placed = &scene->instances[s->instance];
        const uint64_t p = film->first + s->path->pixel;
        if (!s->path->primary || (s->material->flags & LR_MATERIAL_BARE) != 0)
            continue;
        const double depth = s->path->travelled > 0 ? depth_of(&scene->camera, s->position) : s->t;
        lr_pass_put(passes->depth, p, depth);
        lr_pass_put(passes->object_index, p, s->object_index);
        lr_pass_put(passes->material_index, p, s->material->index);
        lr_pass_put(passes->error, p, placed->error / footprint(&scene->camera, depth));
        lr_pass_put(passes->volume, p, placed->volume_index);
        double normal[3];
        lr_bsdf_normal(&s->bsdf, normal);
        lr_pass_put_triple(passes->normal, p, normal, 1);
        lr_pass_put_triple(passes->position, p, s->position, 1);
    }
}

void lr_write_steps(const lr_path *paths, const lr_ray_queue *rays, const lr_hit_queue *hits,
                    lr_film *film)
{
    for (uint32_t i = 0; i < rays->n; i++)
        lr_pass_put(film->passes->steps, film->first + paths[rays->owner[i]].pixel,
                    hits->hit.steps[i]);
}

/* As in Cycles: by the depth, in a perspective view by the distance from the eye. */
void lr_add_mist(const lr_scene *scene, const lr_shading_point *s, lr_film *film)
{
    const lr_camera *camera = &scene->camera;
    if (film->passes->mist == NULL || !s->path->seen)
        return;
    double to_point[3], opaque = 0;
    for (int a = 0; a < 3; a++) {
        to_point[a] = s->position[a] - camera->eye[a];
        opaque += s->path->throughput[a] * (1 - s->bsdf.transparency[a]) / 3;
    }
    const double distance =
        camera->projection == LR_PERSPECTIVE
            ? sqrt(lr_dot(to_point, to_point))
            : lr_dot(to_point, camera->forward) / sqrt(lr_dot(camera->forward, camera->forward));
    const double fraction = scene->mist_depth > 0
                                ? (distance - scene->mist_start) / scene->mist_depth
                                : (distance > scene->mist_start);
    const double mist = pow(lr_clamp(fraction, 0, 1), scene->mist_power);
    film->pixels[s->path->pixel].mist += (1 - mist) * opaque;
}
