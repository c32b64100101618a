/* Structures of traversers that need little or nothing beside the volume.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/structure.h"

lr_status lr_build_nothing(void **data, uint64_t *nbytes)
{
    *data = NULL;
    *nbytes = 0;
    return LR_OK;
}

lr_status lr_build_choices(const int32_t *choices, int n, void **data, uint64_t *nbytes,
                           lr_error *error)
{
    *nbytes = (uint64_t)n * sizeof *choices;
    *data = malloc(*nbytes);
    if (*data == NULL)
        return lr_fail_memory(error, *nbytes, "a traverser's choices");
    memcpy(*data, choices, *nbytes);
    return LR_OK;
}
