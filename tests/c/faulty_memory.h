/* Allocations that fail when a test asks for it: included before every file of the core by
 * native/build_variants.py.
 *
 * Each place in the core that asks for memory first asks lr_test_fails(), which says yes to
 * the one that is to fail. The linker leads all calls through the functions __wrap_ of
 * faulty_memory.c, which count the blocks that are not freed.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_TEST_FAULTY_MEMORY_H
#define LR_TEST_FAULTY_MEMORY_H

#define _DEFAULT_SOURCE /* MAP_ANONYMOUS */
#include <stdbool.h>
#include <stdlib.h>
#include <sys/mman.h>

#include "base/pages.h"

bool lr_test_fails(const char *file, int line);

#define LR_TEST_UNLESS(made, failed) (lr_test_fails(__FILE__, __LINE__) ? (failed) : (made))
#define malloc(nbytes)               LR_TEST_UNLESS(malloc(nbytes), NULL)
#define calloc(n, nbytes)            LR_TEST_UNLESS(calloc(n, nbytes), NULL)
#define realloc(block, nbytes)       LR_TEST_UNLESS(realloc(block, nbytes), NULL)
#define aligned_alloc(at, nbytes)    LR_TEST_UNLESS(aligned_alloc(at, nbytes), NULL)
#define mmap(...)                    LR_TEST_UNLESS(mmap(__VA_ARGS__), MAP_FAILED)
#define lr_pages_new(n, nbytes)      LR_TEST_UNLESS(lr_pages_new(n, nbytes), NULL)

#endif
