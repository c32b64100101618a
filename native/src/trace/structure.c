/* Structures of traversers that need little or nothing beside the volume, and choices of options.
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

lr_status lr_check_choices(const char *owner, const char *options, const int32_t *choices,
                           int32_t chosen[LR_MAX_OPTIONS], lr_error *error)
{
    memset(chosen, 0, LR_MAX_OPTIONS * sizeof *chosen);
    int option = 0;
    for (const char *c = options; choices != NULL && *c != 0; option++) {
        assert(option < LR_MAX_OPTIONS);
        int32_t count = 1;
        for (; *c != 0 && *c != ' '; c++)
            count += *c == '|';
        c += *c == ' ';
        if (choices[option] < 0 || choices[option] >= count)
            return lr_fail(error, LR_E_ARGUMENT, "option %d of %s has %d choices; %d was wanted",
                           option, owner, count, choices[option]);
        chosen[option] = choices[option];
    }
    return LR_OK;
}
