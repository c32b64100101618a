/* Makes a scene: checks everything once.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/scene/scene.h"

#include "base/affine.h"
#include "base/cpu.h"
#include "base/error.h"
#include "base/pages.h"
#include "grid/brick_grid.h"
#include "grid/transfer_function.h"
#include "render/lights/light.h"
#include "trace/structure.h"
#include "trace/triangle_tree.h"

enum {
    VISIBILITY_ALL = LR_VISIBLE_CAMERA | LR_VISIBLE_SHADOW | LR_VISIBLE_DIFFUSE |
    LR_VISIBLE_GLOSSY | LR_VISIBLE_TRANSMISSION | LR_VISIBLE_VOLUME_SCATTER
};

static const lr_box EMPTY = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static lr_status check_camera(const lr_camera *c, lr_error *error)
{
    if (c->projection != LR_PERSPECTIVE && c->projection != LR_ORTHOGRAPHIC)
        return lr_fail(error, LR_E_ARGUMENT, "the camera's projection must be %d or %d, it is %d",
                       LR_PERSPECTIVE, LR_ORTHOGRAPHIC, c->projection);
    if (!lr_all_finite(c->eye, 3) || !lr_all_finite(c->forward, 3) ||
        !lr_all_finite(c->corner, 3) || !lr_all_finite(c->dx, 3) || !lr_all_finite(c->dy, 3))
        return lr_fail(error, LR_E_ARGUMENT, "the camera's vectors must be finite, one is not");
    if (lr_dot(c->forward, c->forward) == 0)
        return lr_fail(error, LR_E_ARGUMENT, "the camera must look forward, its axis is zero");
    if (!(c->clip_start < c->clip_end) || !isfinite(c->clip_start))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the camera must clip from a finite depth to a larger one, it clips from "
                       "%g to %g",
                       c->clip_start, c->clip_end);
    return LR_OK;
}

static lr_status check_gradient_shading(const lr_instance *instance, uint64_t i, lr_error *error)
{
    const double shares[] = {instance->gradient_shading, instance->roughness, instance->specular};
    static const char *const names[] = {"gradient shading", "roughness", "specular level"};
    for (int k = 0; k < 3; k++)
        if (!(shares[k] >= 0 && shares[k] <= 1))
            return lr_fail(error, LR_E_ARGUMENT,
                           "the %s of instance %llu must lie between 0 and 1, it is %g", names[k],
                           (unsigned long long)i, shares[k]);
    if (!(instance->gradient_scale >= 0 && instance->gradient_scale < INFINITY))
        return lr_fail(
            error, LR_E_ARGUMENT,
            "the gradient scale of instance %llu must be finite and not negative, it is %g",
            (unsigned long long)i, instance->gradient_scale);
    return LR_OK;
}

static lr_status check_instance(const lr_scene_desc *desc, uint64_t i, lr_error *error)
{
    const lr_instance *instance = &desc->instances[i];
    const uint64_t first = instance->first_material, n = instance->n_materials;
    if (instance->structure != NULL && lr_structure_volume(instance->structure)->planes[0] != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "instance %llu has a rectilinear volume, which scenes do not take",
                       (unsigned long long)i);
    if (instance->structure == NULL)
        return lr_fail(error, LR_E_ARGUMENT, "instance %llu has no structure",
                       (unsigned long long)i);
    if (lr_structure_volume(instance->structure)->transfer != NULL &&
        (instance->n_clips > 0 || instance->holdout != 0))
        return lr_fail(error, LR_E_ARGUMENT,
                       "instance %llu has a transfer function, and no surface that could be cut "
                       "or held out",
                       (unsigned long long)i);
    if (!(instance->volume_unit >= 0 && instance->volume_unit < INFINITY))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the volume unit of instance %llu must be finite and not negative, it is %g",
                       (unsigned long long)i, instance->volume_unit);
    if (instance->phase != LR_PHASE_HENYEY_GREENSTEIN && instance->phase != LR_PHASE_RAYLEIGH)
        return lr_fail(
            error, LR_E_ARGUMENT, "the phase function of instance %llu must be %d or %d, it is %d",
            (unsigned long long)i, LR_PHASE_HENYEY_GREENSTEIN, LR_PHASE_RAYLEIGH, instance->phase);
    if (!(fabs(instance->anisotropy) <= 1))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the anisotropy of instance %llu must lie between -1 and 1, it is %g",
                       (unsigned long long)i, instance->anisotropy);
    const lr_status status = check_gradient_shading(instance, i, error);
    if (status != LR_OK)
        return status;
    if (instance->clips == NULL && instance->n_clips > 0)
        return lr_fail(error, LR_E_ARGUMENT, "the clips of instance %llu are NULL but not empty",
                       (unsigned long long)i);
    if ((instance->visibility & ~(uint32_t)VISIBILITY_ALL) != 0)
        return lr_fail(error, LR_E_ARGUMENT,
                       "instance %llu has visibility %u, the flags go up to %d",
                       (unsigned long long)i, instance->visibility, VISIBILITY_ALL);
    if (n < 1 || first + n > desc->n_slots)
        return lr_fail(error, LR_E_ARGUMENT,
                       "instance %llu must have 1 or more of the %llu material slots, it has %llu "
                       "from %llu on",
                       (unsigned long long)i, (unsigned long long)desc->n_slots,
                       (unsigned long long)n, (unsigned long long)first);
    return LR_OK;
}

static lr_status check_materials(const lr_scene_desc *desc, lr_error *error)
{
    for (uint64_t i = 0; i < desc->n_materials; i++) {
        const lr_status status = lr_material_check(&desc->materials[i], i, error);
        if (status != LR_OK)
            return status;
    }
    for (uint64_t i = 0; i < desc->n_slots; i++)
        if (desc->slots[i] >= desc->n_materials)
            return lr_fail(
                error, LR_E_ARGUMENT, "slot %llu holds material %u, there are %llu materials",
                (unsigned long long)i, desc->slots[i], (unsigned long long)desc->n_materials);
    return LR_OK;
}

static lr_status check(const lr_scene_desc *desc, lr_error *error)
{
    lr_status status = check_camera(&desc->camera, error);
    if (status != LR_OK)
        return status;
    if ((desc->n_instances > 0 && desc->instances == NULL) ||
        (desc->n_lights > 0 && desc->lights == NULL) ||
        (desc->n_materials > 0 && desc->materials == NULL) ||
        (desc->n_slots > 0 && desc->slots == NULL))
        return lr_fail(error, LR_E_ARGUMENT, "a list of the scene is NULL but not empty");
    if (!isfinite(desc->mist_start) || !(desc->mist_depth >= 0) || !(desc->mist_power > 0))
        return lr_fail(
            error, LR_E_ARGUMENT,
            "mist must have a finite start, a depth of 0 or more and a power above 0, it "
            "has %g, %g and %g",
            desc->mist_start, desc->mist_depth, desc->mist_power);
    if (desc->n_instances > INT32_MAX)
        return lr_fail(error, LR_E_SIZE, "a scene holds up to %d instances, there are %llu",
                       INT32_MAX, (unsigned long long)desc->n_instances);
    status = lr_environment_check(&desc->world, error);
    for (uint64_t i = 0; i < desc->n_lights && status == LR_OK; i++)
        status = lr_light_check(&desc->lights[i], i, error);
    if (status == LR_OK)
        status = check_materials(desc, error);
    for (uint64_t i = 0; i < desc->n_instances && status == LR_OK; i++)
        status = check_instance(desc, i, error);
    return status;
}

/* The world box of what rays can hit; empty where there is nothing. */
static void bound(const lr_instance *instance, lr_box *box)
{
    const lr_structure *structure = instance->structure;
    double m[16];
    lr_affine_multiply(instance->world_from_object,
                       lr_structure_volume(structure)->object_from_storage, m);
    *box = structure->lo[0] <= structure->hi[0] ? lr_world_box(m, structure->lo, structure->hi)
                                                : EMPTY;
}

static lr_status place(const lr_instance *instance, uint64_t i, lr_placed *placed, lr_box *box,
                       lr_error *error)
{
    *placed = (lr_placed){
        .structure = instance->structure,
        .visibility = instance->visibility,
        .object_index = instance->object_index,
        .first_material = instance->first_material,
        .n_materials = instance->n_materials,
        .volume_index = instance->volume_index,
        .error = instance->error,
        .volume_unit = instance->volume_unit,
        .phase = {instance->phase,
                  lr_clamp(instance->anisotropy, -LR_ANISOTROPY_MAX, LR_ANISOTROPY_MAX)},
        .gradient = {instance->gradient_shading, instance->gradient_scale, instance->roughness,
                     instance->specular},
        .holdout = instance->holdout != 0,
    };
    if (!lr_affine_invert(instance->world_from_object, placed->object_from_world))
        return lr_fail(error, LR_E_ARGUMENT,
                       "instance %llu must have a finite, affine and invertible matrix",
                       (unsigned long long)i);
    if (lr_structure_volume(instance->structure)->transfer == NULL)
        placed->gradient.amount = 0; /* what fills a solid is homogeneous */
    memcpy(placed->world_from_object, instance->world_from_object,
           sizeof placed->world_from_object);
    bound(instance, box);
    if (box->lo[0] <= box->hi[0] && !(lr_all_finite(box->lo, 3) && lr_all_finite(box->hi, 3)))
        return lr_fail(error, LR_E_SIZE, "instance %llu extends beyond all numbers",
                       (unsigned long long)i);
    return LR_OK;
}

/* Place the clips and field colours of the instances. */
static lr_status place_fields(const lr_scene_desc *desc, lr_scene *scene, lr_error *error)
{
    uint64_t n = 0;
    for (uint64_t i = 0; i < desc->n_instances; i++)
        n += desc->instances[i].n_clips;
    if (n > INT32_MAX)
        return lr_fail(error, LR_E_SIZE, "a scene holds up to %d clips, there are %llu", INT32_MAX,
                       (unsigned long long)n);
    scene->clips = calloc((size_t)n + 1, sizeof *scene->clips);
    if (scene->clips == NULL)
        return lr_fail_memory(error, n * sizeof *scene->clips, "the clips of the instances");
    lr_placed_clip *next = scene->clips;
    lr_status status = LR_OK;
    for (uint64_t i = 0; i < desc->n_instances && status == LR_OK; i++) {
        const lr_instance *instance = &desc->instances[i];
        lr_placed *placed = &scene->instances[i];
        placed->clips = next;
        placed->n_clips = instance->n_clips;
        placed->has_tree = placed->structure->tree != NULL && placed->n_clips == 0;
        for (uint64_t k = 0; k < instance->n_clips && status == LR_OK; k++)
            status = lr_clip_place(&instance->clips[k], i, next++, error);
        if (instance->field_color != NULL && status == LR_OK)
            status = lr_field_color_place(instance->field_color, i, &placed->color, error);
    }
    return status;
}

/* Take instances without a surface out of the hierarchy, as participants. */
static void part(lr_scene *scene, lr_box *boxes)
{
    for (uint32_t i = 0; i < scene->n_instances; i++) {
        const bool visible = boxes[i].lo[0] <= boxes[i].hi[0];
        const lr_transfer *transfer = lr_structure_volume(scene->instances[i].structure)->transfer;
        if (transfer == NULL)
            continue;
        if (visible) {
            scene->participants[scene->n_participants++] =
                (lr_participant){i, boxes[i], transfer->scatters};
            scene->scatters |= transfer->scatters;
        }
        boxes[i] = EMPTY;
    }
}

/* Flags of the scene by what fills a solid. */
static void add_media(const lr_placed *placed, lr_scene *scene)
{
    for (uint32_t k = 0; k < placed->n_materials; k++) {
        const lr_material *m = &scene->materials[scene->slots[placed->first_material + k]];
        for (int a = 0; a < 3; a++) {
            scene->has_fog |= m->medium.scattering[a] > 0 || m->medium.glow[a] != 0;
            scene->scatters |= m->medium.scattering[a] > 0;
            scene->emits |= m->medium.glow[a] != 0;
        }
    }
}

/* Flags of the scene by what instances do to rays. */
static void set_flags(lr_scene *scene)
{
    const uint32_t media = LR_MATERIAL_REFRACTS | LR_MATERIAL_FILLS;
    for (uint32_t i = 0; i < scene->n_instances; i++) {
        lr_placed *placed = &scene->instances[i];
        uint32_t flags = 0;
        for (uint32_t k = 0; k < placed->n_materials; k++)
            flags |= scene->materials[scene->slots[placed->first_material + k]].flags;
        const lr_volume *volume = lr_structure_volume(placed->structure);
        const bool solid = volume->desc.kind != LR_KIND_SHEET && volume->transfer == NULL;
        if (volume->transfer != NULL)
            flags = 0;
        placed->clear = (flags & LR_MATERIAL_CLEAR) != 0;
        placed->enterable = solid && (flags & media) != 0 && placed->n_clips == 0;
        scene->has_clear |= placed->clear;
        scene->has_media |= placed->enterable;
        scene->emits |= (flags & LR_MATERIAL_EMITS) != 0;
        if (placed->enterable)
            add_media(placed, scene);
    }
    for (uint64_t k = 0; k < scene->n_lights; k++)
        scene->has_lights |= lr_light_has_extent(&scene->lights[k]);
}

/* The hierarchy and the trees over the boxes of the instances. */
static lr_status gather(const lr_box *boxes, lr_scene *scene, lr_error *error)
{
    scene->tree_ops = lr_tree_ops_of(lr_cpu_simd());
    lr_status status = lr_hierarchy_build(boxes, scene->n_instances, 1, &scene->hierarchy, error);
    if (status == LR_OK)
        status = lr_wide_build(&scene->hierarchy, &LR_ONE_BOX, &scene->boxes, error);
    if (status == LR_OK)
        status = lr_rebraid(scene->instances, scene->n_instances, boxes, &scene->opened, error);
    const uint32_t opened = scene->opened.boxes.n_branches, whole = scene->boxes.n_branches;
    scene->n_branches = opened > whole ? opened : whole;
    return status;
}

static lr_status place_all(const lr_scene_desc *desc, lr_scene *scene, lr_error *error)
{
    const size_t nbytes = (size_t)desc->n_instances * sizeof(lr_box) + 1;
    lr_box *boxes = malloc(nbytes);
    if (boxes == NULL)
        return lr_fail_memory(error, nbytes, "the boxes of the instances");
    lr_status status = LR_OK;
    for (uint64_t i = 0; i < desc->n_instances && status == LR_OK; i++)
        status = place(&desc->instances[i], i, &scene->instances[i], &boxes[i], error);
    if (status == LR_OK)
        status = place_fields(desc, scene, error);
    if (status == LR_OK)
        part(scene, boxes);
    if (status == LR_OK)
        status = gather(boxes, scene, error);
    if (status == LR_OK)
        set_flags(scene);
    free(boxes);
    return status;
}

/* A copy of n items, of at least one byte, so that NULL means out of memory. */
static void *copy(const void *from, uint64_t n, size_t size)
{
    void *to = calloc((size_t)n + 1, size);
    if (to != NULL && from != NULL && n > 0)
        memcpy(to, from, (size_t)n * size);
    return to;
}

static lr_status fill(const lr_scene_desc *desc, lr_scene *scene, lr_error *error)
{
    scene->camera = desc->camera;
    scene->n_instances = (uint32_t)desc->n_instances;
    scene->n_lights = desc->n_lights;
    scene->world_visibility = desc->world.visibility;
    scene->world_bounces = desc->world.max_bounces;
    for (int a = 0; a < 3; a++)
        scene->world_emits |= desc->world.color[a] != 0;
    scene->mist_start = desc->mist_start;
    scene->mist_depth = desc->mist_depth;
    scene->mist_power = desc->mist_power;
    scene->film_transparent = desc->film_transparent != 0;
    scene->lone_media = desc->lone_media != 0;
    scene->instances = copy(NULL, desc->n_instances, sizeof *scene->instances);
    scene->participants = copy(NULL, desc->n_instances, sizeof *scene->participants);
    scene->lights = copy(desc->lights, desc->n_lights, sizeof *scene->lights);
    scene->materials = copy(NULL, desc->n_materials, sizeof *scene->materials);
    scene->lobes = copy(NULL, desc->n_materials * LR_LOBES_MAX, sizeof *scene->lobes);
    scene->slots = copy(desc->slots, desc->n_slots, sizeof *scene->slots);
    if (desc->slot_objects != NULL)
        scene->slot_objects = copy(desc->slot_objects, desc->n_slots, sizeof *scene->slot_objects);
    if ((desc->slot_objects != NULL && !scene->slot_objects) || !scene->instances ||
        !scene->participants || !scene->lights || !scene->materials || !scene->lobes ||
        !scene->slots)
        return lr_fail_memory(error, desc->n_instances * sizeof *scene->instances, "the scene");
    for (uint64_t i = 0; i < desc->n_lights; i++) {
        double *d = scene->lights[i].direction;
        const double length = sqrt(lr_dot(d, d));
        for (int a = 0; a < 3 && length > 0; a++) /* not all types have one */
            d[a] /= length;
    }
    for (uint64_t i = 0; i < desc->n_materials; i++)
        lr_material_make(&desc->materials[i], &scene->lobes[LR_LOBES_MAX * i],
                         &scene->materials[i]);
    lr_status status = lr_environment_make(&desc->world, &scene->environment, error);
    if (status == LR_OK)
        status = lr_light_tree_make(scene->lights, scene->n_lights, &scene->environment,
                                    &scene->light_tree, error);
    return status == LR_OK ? place_all(desc, scene, error) : status;
}

lr_status lr_scene_new(const lr_scene_desc *desc, lr_scene **scene, lr_error *error)
{
    if (desc == NULL || scene == NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "a scene needs a description and a place, one is NULL");
    lr_status status = check(desc, error);
    if (status != LR_OK)
        return status;
    lr_scene *s = calloc(1, sizeof *s);
    if (s == NULL)
        return lr_fail_memory(error, sizeof *s, "the scene");
    status = fill(desc, s, error);
    if (status == LR_OK)
        *scene = s;
    else
        lr_scene_free(s);
    return status;
}

void lr_scene_free(lr_scene *scene)
{
    if (scene == NULL)
        return;
    lr_environment_free(&scene->environment);
    lr_light_tree_free(&scene->light_tree);
    free(scene->hierarchy.nodes);
    lr_pages_free(scene->boxes.nodes);
    lr_pages_free(scene->opened.boxes.nodes);
    free(scene->opened.parts);
    free(scene->instances);
    free(scene->participants);
    free(scene->clips);
    free(scene->lights);
    free(scene->materials);
    free(scene->lobes);
    free(scene->slots);
    free(scene->slot_objects);
    free(scene);
}
