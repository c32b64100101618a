/* The table of traversers, and structures built through it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "grid/surface_bounds.h"
#include "trace/traverser.h"
#include "trace/triangle_tree.h"

static const struct {
    lr_traverser about;
    lr_traverser_ops ops;
} registry[] = {
#define LR_TRAVERSER(name, label, source, about, options, flags)                                   \
    {{#name, label, source, about, options, flags},                                                \
     {lr_##name##_build, lr_##name##_free, lr_##name##_trace}},
#include "trace/traversers.def"
#undef LR_TRAVERSER
};

enum { COUNT = sizeof registry / sizeof registry[0] };

int32_t lr_traverser_count(void)
{
    return COUNT;
}

static lr_status check_index(int32_t index, lr_error *error)
{
    if (index < 0 || index >= COUNT)
        return lr_fail(error, LR_E_ARGUMENT, "there is no traverser %d; there are %d", index,
                       (int)COUNT);
    return LR_OK;
}

lr_status lr_traverser_get(int32_t index, lr_traverser *traverser, lr_error *error)
{
    lr_status status = check_index(index, error);
    if (status == LR_OK)
        *traverser = registry[index].about;
    return status;
}

lr_status lr_structure_build(const lr_volume *volume, int32_t traverser, const int32_t *choices,
                             const lr_watch *watch, lr_structure **structure, lr_error *error)
{
    int32_t chosen[LR_MAX_OPTIONS];
    lr_status status = check_index(traverser, error);
    if (status == LR_OK)
        status = lr_check_choices(registry[traverser].about.name, registry[traverser].about.options,
                                  choices, chosen, error);
    if (status != LR_OK)
        return status;
    if (!volume->finished)
        return lr_fail(error, LR_E_ARGUMENT, "the volume is not finished");
    if (volume->planes[0] != NULL && !(registry[traverser].about.flags & LR_TRAVERSER_RECTILINEAR))
        return lr_fail(error, LR_E_ARGUMENT,
                       "%s counts on voxels of one size, and this volume is rectilinear",
                       registry[traverser].about.name);
    lr_structure *s = calloc(1, sizeof *s);
    if (s == NULL)
        return lr_fail_memory(error, sizeof *s, "a structure");
    s->volume = volume;
    s->ops = &registry[traverser].ops;
    status = s->ops->build(volume, chosen, watch, &s->data, &s->nbytes, error);
    if (status != LR_OK) {
        free(s);
        return status;
    }
    if (lr_has_only_triangles(volume)) {
        uint64_t nbytes = 0;
        status = lr_triangle_tree_build(volume, &s->tree, &nbytes, error);
        if (status != LR_OK) {
            lr_structure_free(s);
            return status;
        }
        s->nbytes += nbytes;
    }
    s->nbytes += sizeof *s;
    lr_surface_bounds(volume, s->lo, s->hi);
    lr_progress(watch, 1.0);
    *structure = s;
    return LR_OK;
}

void lr_structure_free(lr_structure *s)
{
    if (s == NULL)
        return;
    s->ops->free(s->data);
    lr_triangle_tree_free(s->tree);
    free(s);
}

uint64_t lr_structure_nbytes(const lr_structure *s)
{
    return s->nbytes;
}

int32_t lr_structure_has_tree(const lr_structure *s)
{
    return s->tree != NULL;
}

void lr_structure_bounds(const lr_structure *s, double lo[3], double hi[3])
{
    for (int a = 0; a < 3; a++) {
        lo[a] = s->lo[a] - LR_PAD;
        hi[a] = s->hi[a] - LR_PAD;
    }
}

/* What cubic volumes do not take. */
static lr_status check_cubic(const lr_trace_options *o, lr_error *error)
{
    if (o->mode == LR_MODE_BINARY)
        return lr_fail(error, LR_E_ARGUMENT,
                       "a cubic volume has no object cells: its field may lie below T where a "
                       "sample does not");
    if (o->hit_test == LR_HIT_UNIFORM)
        return lr_fail(error, LR_E_ARGUMENT,
                       "the uniform hit test takes samples of the trilinear field, and this volume "
                       "is cubic");
    if (o->root == LR_ROOT_CUBIC)
        return lr_fail(error, LR_E_ARGUMENT,
                       "along a ray the field of a cubic volume is of degree 9, whose roots have "
                       "no closed form: its root finder must be newton, bisect or linear");
    return LR_OK;
}

/* Steps of so many voxels, of the uniform hit test and of samples along the ray. */
static lr_status check_step(const lr_trace_options *o, lr_error *error)
{
    if (!(o->step >= 1e-3 && o->step <= 1e3))
        return lr_fail(error, LR_E_ARGUMENT,
                       "step must lie between 0.001 and 1000 voxels; it is %g", o->step);
    return LR_OK;
}

static lr_status check_phong(const lr_trace_options *o, lr_error *error)
{
    static const double most = 1e6;
    const lr_phong *p = o->phong;
    const double shares[] = {p->ambient, p->diffuse, p->specular};
    if (o->mode != LR_MODE_VOLUME || o->sampling != LR_SAMPLING_POST)
        return lr_fail(error, LR_E_ARGUMENT,
                       "samples are lit in the mode volume, sampled after interpolation (post)");
    if (o->normal != LR_NORMAL_CENTRAL && o->normal != LR_NORMAL_ANALYTIC)
        return lr_fail(error, LR_E_ARGUMENT,
                       "samples are lit by the normals central and analytic; this is number %d",
                       o->normal);
    for (int i = 0; i < 3; i++)
        if (!(shares[i] >= 0.0 && shares[i] <= most))
            return lr_fail(error, LR_E_ARGUMENT,
                           "ambient, diffuse and specular must lie between 0 and %g; one is %g",
                           most, shares[i]);
    if (!lr_all_finite(p->light, 3))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the direction of the light must be finite; it is %g, %g, %g", p->light[0],
                       p->light[1], p->light[2]);
    if (!(p->power >= 1 && p->power <= 1024))
        return lr_fail(error, LR_E_ARGUMENT,
                       "the power of highlights must lie between 1 and 1024; it is %d", p->power);
    return LR_OK;
}

/* What the modes from LR_MODE_VOLUME on take. */
static lr_status check_along(const lr_volume *volume, const lr_trace_options *o, lr_error *error)
{
    if (volume->transfer == NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "the volume has no transfer function, which this mode needs: "
                       "visible_volume makes one");
    if (o->mode != LR_MODE_VOLUME)
        return LR_OK;
    lr_status status = lr_check_choice("sampling", o->sampling, LR_SAMPLING_PRE, error);
    if (status != LR_OK)
        return status;
    if (!(o->tolerance >= 1e-9 && o->tolerance <= 1.0))
        return lr_fail(error, LR_E_ARGUMENT, "tolerance must lie between 1e-9 and 1; it is %g",
                       o->tolerance);
    if (!(o->stop_opacity > 0.0 && o->stop_opacity <= 1.0))
        return lr_fail(error, LR_E_ARGUMENT,
                       "stop_opacity must lie above 0 and at most at 1; it is %g", o->stop_opacity);
    if (o->sampling == LR_SAMPLING_EXACT)
        return LR_OK;
    status = check_step(o, error);
    if (status == LR_OK && volume->planes[0] != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "samples lie steps of so many voxels apart, and those of a rectilinear "
                       "volume have no one size");
    return status;
}

static lr_status check_options(const lr_volume *volume, const lr_trace_options *o, lr_error *error)
{
    lr_status status = lr_check_choice("mode", o->mode, LR_MODE_MEAN, error);
    if (status == LR_OK && o->phong != NULL)
        status = check_phong(o, error);
    if (status == LR_OK && o->mode >= LR_MODE_VOLUME)
        return check_along(volume, o, error);
    if (status == LR_OK && volume->transfer != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "the volume has a transfer function in the place of a surface: its modes "
                       "are volume, maximum, minimum and mean");
    if (status == LR_OK)
        status = lr_check_choice("hit test", o->hit_test, LR_HIT_UNIFORM, error);
    if (status == LR_OK)
        status = lr_check_choice("root finder", o->root, LR_ROOT_CUBIC, error);
    if (status == LR_OK)
        status = lr_check_choice("normal", o->normal, LR_NORMAL_ZUCKER_HUMMEL, error);
    if (status == LR_OK && lr_is_cubic(volume))
        status = check_cubic(o, error);
    if (status != LR_OK || o->hit_test != LR_HIT_UNIFORM)
        return status;
    if (o->root == LR_ROOT_NEWTON || o->root == LR_ROOT_CUBIC)
        return lr_fail(error, LR_E_ARGUMENT,
                       "the uniform hit test brackets across cells, where the field has no one "
                       "cubic: its root finder must be bisect or linear");
    status = check_step(o, error);
    if (status != LR_OK)
        return status;
    if (volume->planes[0] != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "the uniform hit test takes steps of so many voxels, and those of a "
                       "rectilinear volume have no one size");
    if (volume->desc.kind == LR_KIND_SHEET)
        return lr_fail(error, LR_E_ARGUMENT,
                       "a sheet's field holds only in the cells that it touches: the uniform hit "
                       "test would look beside them");
    if (volume->objects != NULL)
        return lr_fail(error, LR_E_ARGUMENT,
                       "a merged volume has one field per object: the uniform hit test knows none");
    return LR_OK;
}

lr_status lr_trace(const lr_structure *s, const lr_rays *rays, uint64_t n,
                   const lr_trace_options *options, const lr_hits *hits, lr_counters *counters,
                   const lr_watch *watch, lr_error *error)
{
    lr_status status = check_options(s->volume, options, error);
    if (status != LR_OK)
        return status;
    if (rays->stop != NULL &&
        (options->mode != LR_MODE_VOLUME || options->sampling != LR_SAMPLING_EXACT))
        return lr_fail(error, LR_E_ARGUMENT,
                       "rays end at a transmittance only in the mode volume, sampled exactly");
    return s->ops->trace(s->volume, s->data, rays, n, options, hits, counters, watch, error);
}
