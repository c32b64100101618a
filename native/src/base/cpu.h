/* Which vector instructions the processor and the system offer.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_BASE_CPU_H
#define LR_BASE_CPU_H

#include "base/base.h"
#include "base/error.h"

/* Whether there are vector instructions, of x86; not under LR_PORTABLE. */
#if defined __x86_64__ && !defined LR_PORTABLE
#define LR_X86 1
#endif

/* Of name_portable, name_avx2 and name_avx512 the one for an lr_simd that the processor has. */
#ifdef LR_X86
#define LR_BY_SIMD(simd, name)                                                                     \
    ((simd) == LR_SIMD_AVX512 ? name##_avx512                                                      \
     : (simd) == LR_SIMD_AVX2 ? name##_avx2                                                        \
                              : name##_portable)
#else
#define LR_BY_SIMD(simd, name) ((void)(simd), name##_portable)
#endif

/* The best of lr_simd. It asks the processor, which takes up to 0.1 ms under a
 * hypervisor: once per call of the interface, not per part. */
int32_t lr_cpu_simd(void);

/* requested, or for LR_SIMD_AUTO the best; LR_E_ARGUMENT where it is not there. */
lr_status lr_cpu_choose(int32_t requested, int32_t *simd, lr_error *error);

#endif
