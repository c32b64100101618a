/* Errors are sentences: lr_fail writes one and hands its status on.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_BASE_ERROR_H
#define LR_BASE_ERROR_H

#include "leapray.h"

__attribute__((format(printf, 3, 4))) lr_status lr_fail(lr_error *error, lr_status status,
                                                        const char *format, ...);
lr_status lr_fail_memory(lr_error *error, uint64_t nbytes, const char *what);
/* LR_E_ARGUMENT unless value is a member of an enum of leapray.h whose last one is `last`. */
lr_status lr_check_choice(const char *what, int32_t value, int32_t last, lr_error *error);
lr_status lr_fail_stopped(lr_error *error);

#endif
