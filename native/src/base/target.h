/* Functions for an instruction set that not all processors have: those between one of these lines
 * and LR_TARGET_END. Whoever calls them asks lr_cpu_simd first.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_BASE_TARGET_H
#define LR_BASE_TARGET_H

#define LR_PRAGMA_(text) _Pragma(#text)

#ifdef __clang__
#define LR_TARGET_(sets)                                                                           \
    LR_PRAGMA_(clang attribute push(__attribute__((target(sets))), apply_to = function))
#define LR_TARGET_END _Pragma("clang attribute pop")
#else
#define LR_TARGET_(sets) _Pragma("GCC push_options") LR_PRAGMA_(GCC target(sets))
#define LR_TARGET_END    _Pragma("GCC pop_options")
#endif

#define LR_TARGET_AVX2   LR_TARGET_("avx2")
#define LR_TARGET_AVX512 LR_TARGET_("avx512f,avx512bw,avx512dq,avx512vl")

#endif
