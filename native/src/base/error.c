/* Version, interface number and the way errors are told.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <stdarg.h>
#include <stdio.h>

#include "base/error.h"

int32_t lr_abi(void)
{
    return LR_ABI;
}

const char *lr_version(void)
{
    return LR_VERSION;
}

lr_status lr_fail(lr_error *error, lr_status status, const char *format, ...)
{
    if (error != NULL) {
        va_list args;
        va_start(args, format);
        vsnprintf(error->text, sizeof error->text, format, args);
        va_end(args);
    }
    return status;
}

lr_status lr_fail_memory(lr_error *error, uint64_t nbytes, const char *what)
{
    return lr_fail(error, LR_E_MEMORY, "no memory for %s: %.1f MB are needed", what,
                   (double)nbytes / 1e6);
}

lr_status lr_check_choice(const char *what, int32_t value, int32_t last, lr_error *error)
{
    if (value >= 0 && value <= last)
        return LR_OK;
    return lr_fail(error, LR_E_ARGUMENT, "%s must be 0 to %d, it is %d", what, last, value);
}

lr_status lr_fail_stopped(lr_error *error)
{
    return lr_fail(error, LR_E_STOPPED, "stopped");
}
