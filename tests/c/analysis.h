/* Tells gcc's analyser, which reads one file at a time, what failures return: included before
 * every file but base/error.c by native/analyze.py.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TEST_ANALYSIS_H
#define LR_TEST_ANALYSIS_H

#define _DEFAULT_SOURCE /* MAP_ANONYMOUS */
#include "base/error.h"

#define lr_fail(error, status, ...) ((lr_fail)(error, status, __VA_ARGS__), (status))
#define lr_fail_memory(...)         ((lr_fail_memory)(__VA_ARGS__), LR_E_MEMORY)
#define lr_fail_stopped(error)      ((lr_fail_stopped)(error), LR_E_STOPPED)

#endif
