/* A structure: the volume, what its traverser built beside it, and how that
 * traverser is run.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TRACE_STRUCTURE_H
#define LR_TRACE_STRUCTURE_H

#include "base/base.h"
#include "base/error.h"

/* What a traverser's file gives. data may stay NULL where nothing is needed. */
typedef struct lr_traverser_ops {
    lr_status (*build)(const lr_volume *volume, const int32_t *choices, const lr_watch *watch,
                       void **data, uint64_t *nbytes, lr_error *error);
    void (*free)(void *data);
    lr_status (*trace)(const lr_volume *volume, const void *data, const lr_rays *rays, uint64_t n,
                       const lr_trace_options *options, const lr_hits *hits, lr_counters *counters,
                       const lr_watch *watch, lr_error *error);
} lr_traverser_ops;

struct lr_structure {
    const lr_volume *volume;
    const lr_traverser_ops *ops;
    void *data;
    uint64_t nbytes;
    double lo[3], hi[3];           /* the box of the surface, see lr_surface_bounds */
    struct lr_triangle_tree *tree; /* all that there is to meet; NULL: no tree can tell */
};

LR_INLINE const lr_volume *lr_structure_volume(const lr_structure *structure)
{
    return structure->volume;
}

enum { LR_MAX_OPTIONS = 4 };

/* Check choices, NULL: 0 for all, against "name=a|b name=a|b|c", of which `owner` is said to be the
 * one who has these options, and copy them to chosen. */
lr_status lr_check_choices(const char *owner, const char *options, const int32_t *choices,
                           int32_t chosen[LR_MAX_OPTIONS], lr_error *error);

/* For a traverser that needs nothing beside the volume. */
lr_status lr_build_nothing(void **data, uint64_t *nbytes);

/* For one that only has to know its n choices: *data is a copy, as int32_t. */
lr_status lr_build_choices(const int32_t *choices, int n, void **data, uint64_t *nbytes,
                           lr_error *error);

#endif
