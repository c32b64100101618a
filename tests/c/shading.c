/* Entry points for tests of the renderer's closures, lights and environment, each on
 * whole arrays. Compiled by tests/shading.py together with the core's own files.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/bsdf/gradient_shading.h"
#include "render/lights/light.h"
#include "render/lights/light_tree.h"

static _Thread_local lr_closure closures[LR_CLOSURES_MAX];

static lr_bsdf seen(const lr_material_desc *desc, const lr_point *point)
{
    static _Thread_local lr_lobe lobes[LR_LOBES_MAX];
    lr_material material;
    lr_bsdf bsdf = {.closures = closures};
    lr_material_make(desc, lobes, &material);
    lr_bsdf_at(&material, point, &bsdf);
    return bsdf;
}

LR_API uint32_t shading_flags(const lr_material_desc *desc)
{
    lr_lobe lobes[LR_LOBES_MAX];
    lr_material material;
    lr_material_make(desc, lobes, &material);
    return material.flags;
}

LR_API void shading_look(const lr_material_desc *desc, const lr_point *point,
                         double albedo[LR_RAY_VOLUME + 1], double emission[3],
                         double transparency[3])
{
    const lr_bsdf bsdf = seen(desc, point);
    memcpy(albedo, bsdf.albedo, sizeof bsdf.albedo);
    memcpy(emission, bsdf.emission, sizeof bsdf.emission);
    memcpy(transparency, bsdf.transparency, sizeof bsdf.transparency);
}

LR_API void shading_sample(const lr_material_desc *desc, const lr_point *point, int32_t kind,
                           int64_t n, const double (*u)[3], lr_scatter *scatter)
{
    const lr_bsdf bsdf = seen(desc, point);
    for (int64_t i = 0; i < n; i++)
        if (!lr_bsdf_sample(&bsdf, kind, u[i], &scatter[i]))
            scatter[i] = (lr_scatter){.pdf = 0};
}

LR_API void shading_eval(const lr_material_desc *desc, const lr_point *point, int64_t n,
                         const double (*light)[3], lr_response (*response)[LR_GROUPS])
{
    const lr_bsdf bsdf = seen(desc, point);
    for (int64_t i = 0; i < n; i++)
        lr_bsdf_eval(&bsdf, light[i], response[i]);
}

LR_API void shading_phase_sample(int32_t kind, double g, const double view[3], int64_t n,
                                 const double (*u)[2], lr_scatter *scatter)
{
    for (int64_t i = 0; i < n; i++)
        scatter[i] = lr_phase_sample((lr_phase){kind, g}, view, u[i]);
}

LR_API void shading_phase_eval(int32_t kind, double g, const double view[3], int64_t n,
                               const double (*light)[3], lr_response *response)
{
    for (int64_t i = 0; i < n; i++)
        response[i] = lr_phase_eval((lr_phase){kind, g}, view, light[i]);
}

/* Of numbers: the share, the surface's roughness and specular level, and the colour. */
static lr_hybrid hybrid(int32_t kind, double g, const double view[3], const double numbers[6],
                        lr_bsdf *surface)
{
    lr_point point = {.normal = {0, 0, 1}, .facing = {0, 0, 1}};
    lr_hybrid h = {.phase = {kind, g}, .share = numbers[0]};
    memcpy(point.view, view, sizeof point.view);
    memcpy(h.color, numbers + 3, sizeof h.color);
    lr_gradient_surface(&(lr_gradient_shading){1, 1, numbers[1], numbers[2]}, h.color, &point,
                        surface);
    return h;
}

LR_API void shading_hybrid_sample(int32_t kind, double g, const double view[3],
                                  const double numbers[6], int64_t n, const double (*u)[3],
                                  lr_scatter *scatter)
{
    lr_bsdf surface = {.closures = closures};
    const lr_hybrid h = hybrid(kind, g, view, numbers, &surface);
    for (int64_t i = 0; i < n; i++)
        if (!lr_hybrid_sample(&h, &surface, view, u[i], &scatter[i]))
            scatter[i] = (lr_scatter){.pdf = 0};
}

LR_API void shading_hybrid_eval(int32_t kind, double g, const double view[3],
                                const double numbers[6], int64_t n, const double (*light)[3],
                                lr_response *response)
{
    lr_bsdf surface = {.closures = closures};
    const lr_hybrid h = hybrid(kind, g, view, numbers, &surface);
    for (int64_t i = 0; i < n; i++)
        response[i] = lr_hybrid_eval(&h, &surface, view, light[i]);
}

LR_API void shading_light_sample(const lr_light *light, const double p[3], int64_t n,
                                 const double (*u)[2], lr_light_ray *ray)
{
    for (int64_t i = 0; i < n; i++)
        if (!lr_light_sample(light, p, u[i], &ray[i]))
            ray[i] = (lr_light_ray){.pdf = 0};
}

/* pdf 0 where the light is missed. */
LR_API void shading_light_hit(const lr_light *light, const double o[3], int64_t n,
                              const double (*d)[3], lr_light_ray *ray)
{
    for (int64_t i = 0; i < n; i++) {
        ray[i] = (lr_light_ray){.pdf = 0};
        lr_light_ray r = {.pdf = 0};
        memcpy(r.direction, d[i], sizeof r.direction);
        if (lr_light_hit(light, o, d[i], INFINITY, &r.distance, r.color, &r.pdf))
            ray[i] = r;
    }
}

/* Sampled directions with u, or the given ones without. */
LR_API int32_t shading_environment(const lr_world *world, int64_t n, const double (*u)[2],
                                   lr_light_ray *ray)
{
    lr_environment e;
    if (lr_environment_check(world, NULL) != LR_OK || lr_environment_make(world, &e, NULL) != LR_OK)
        return 0;
    for (int64_t i = 0; i < n; i++) {
        if (u == NULL) {
            lr_environment_radiance(&e, ray[i].direction, ray[i].color);
            ray[i].pdf = lr_environment_pdf(&e, ray[i].direction);
        } else if (!lr_environment_sample(&e, u[i], &ray[i]))
            ray[i].pdf = 0;
    }
    lr_environment_free(&e);
    return 1;
}

/* For each u a light, -1 for none, and its probability; then the probabilities of all lights,
 * of the world (if it has any brightness) last. */
LR_API int32_t shading_lights(const lr_light *light, int64_t n_lights, double brightness,
                              const double p[3], const double normal[3], int64_t n, const double *u,
                              int64_t *light_index, double *probability, double *probability_of)
{
    lr_light_tree light_tree;
    const lr_environment environment = {.width = brightness > 0, .brightness = brightness};
    if (lr_light_tree_make(light, (uint64_t)n_lights, &environment, &light_tree, NULL) != LR_OK)
        return 0;
    for (int64_t i = 0; i < n; i++)
        light_index[i] =
            (int64_t)lr_light_tree_choose(&light_tree, p, normal, u[i], &probability[i]);
    for (uint64_t k = 0; k < light_tree.n; k++)
        probability_of[k] = lr_light_tree_probability(&light_tree, k, p, normal);
    lr_light_tree_free(&light_tree);
    return 1;
}

/* met[i][k]: how often the walk of ray i from o along d[i] comes to light k. */
LR_API int32_t shading_light_walk(const lr_light *light, int64_t n_lights, const double o[3],
                                  int64_t n, const double (*d)[3], double t_max, uint8_t *met)
{
    lr_light_tree light_tree;
    const lr_environment environment = {.width = 0};
    if (lr_light_tree_make(light, (uint64_t)n_lights, &environment, &light_tree, NULL) != LR_OK)
        return 0;
    for (int64_t i = 0; i < n; i++) {
        lr_light_walk walk;
        lr_light_tree_start(&light_tree, &walk);
        for (uint64_t k;
             (k = lr_light_tree_next(&light_tree, &walk, o, d[i], t_max)) != LR_LIGHT_NONE;)
            met[i * n_lights + (int64_t)k]++;
    }
    lr_light_tree_free(&light_tree);
    return 1;
}
