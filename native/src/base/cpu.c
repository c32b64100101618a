/* Which vector instructions the processor and the system offer.
 *
 * Departure from the compilers' builtin: __builtin_cpu_supports answers 0 for
 * everything under ziglang, so cpuid and xgetbv are asked. An instruction set
 * counts only where the system also saves its registers.
 *
 * Source: Intel SDM, volume 1, chapters 14.3 and 15.2.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "base/cpu.h"

#ifdef LR_X86
#include <cpuid.h>

enum {
    OSXSAVE = 1 << 27,
    AVX = 1 << 28, /* leaf 1, ecx */
    AVX2 = 1 << 5, /* leaf 7, ebx, as all below */
    AVX512F = 1 << 16,
    AVX512DQ = 1 << 17,
    AVX512BW = 1 << 30,
    YMM_STATE = 0x06,
    ZMM_STATE = 0xe6
};
#define AVX512VL (1u << 31)

static uint32_t saved_state(void)
{
    uint32_t low, high;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return low;
}

int32_t lr_cpu_simd(void)
{
    uint32_t a, b, c, d;
    const uint32_t wide = AVX512F | AVX512DQ | AVX512BW | AVX512VL;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & OSXSAVE) || !(c & AVX))
        return LR_SIMD_PORTABLE;
    uint32_t state = saved_state();
    if ((state & YMM_STATE) != YMM_STATE || !__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & AVX2))
        return LR_SIMD_PORTABLE;
    return (state & ZMM_STATE) == ZMM_STATE && (b & wide) == wide ? LR_SIMD_AVX512 : LR_SIMD_AVX2;
}
#else
int32_t lr_cpu_simd(void)
{
    return LR_SIMD_PORTABLE;
}
#endif

lr_status lr_cpu_choose(int32_t requested, int32_t *simd, lr_error *error)
{
    const lr_status known = lr_check_choice("simd", requested, LR_SIMD_AVX512, error);
    if (known != LR_OK)
        return known;
    int32_t best = lr_cpu_simd();
    if (requested > best)
        return lr_fail(error, LR_E_ARGUMENT, "simd %s is not offered by this processor",
                       requested == LR_SIMD_AVX2 ? "avx2" : "avx512");
    *simd = requested == LR_SIMD_AUTO ? best : requested;
    return LR_OK;
}
