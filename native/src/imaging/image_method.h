/* What the file of a whole-image method includes first: the prototypes of the three functions that
 * every line of the registry stands for.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_IMAGING_IMAGE_METHOD_H
#define LR_IMAGING_IMAGE_METHOD_H

#include "base/base.h"
#include "base/error.h"

/* What is to be rendered; the camera has been checked, and the image been cleared to misses. */
typedef struct lr_view {
    const lr_volume *volume;
    const lr_camera *camera;
    const lr_frame_before *before; /* or NULL */
    const lr_image *image;
} lr_view;

#define LR_IMAGE_METHOD(name, label, source, about, options, flags)                                \
    lr_status lr_##name##_prepare(const lr_volume *, const int32_t *choices, const lr_watch *,     \
                                  void **data, uint64_t *nbytes, lr_error *);                      \
    void lr_##name##_free(void *data);                                                             \
    lr_status lr_##name##_render(const void *data, const lr_view *, lr_counters *,                 \
                                 const lr_watch *, lr_error *);
#include "imaging/image_methods.def"
#undef LR_IMAGE_METHOD

#endif
