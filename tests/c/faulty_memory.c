/* The state behind faulty_memory.h, and the functions by which a test sets and reads it.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/types.h>

#define EXPORT __attribute__((visibility("default")))

static atomic_llong turn, fail_at, n_blocks;
static char failed[256]; /* file:line */

bool lr_test_fails(const char *file, int line);
void *__real_malloc(size_t nbytes);
void *__real_calloc(size_t n, size_t nbytes);
void *__real_realloc(void *block, size_t nbytes);
void *__real_aligned_alloc(size_t at, size_t nbytes);
void *__real_mmap(void *where, size_t nbytes, int prot, int flags, int file, off_t from);
int __real_munmap(void *where, size_t nbytes);
void __real_free(void *block);

/* From now on the n-th allocation fails, once; 0: none. */
EXPORT void lr_test_fail_at(int64_t n)
{
    failed[0] = '\0';
    turn = 0;
    fail_at = n;
}

/* Where the allocation that was to fail stands; empty where it has not been reached. */
EXPORT const char *lr_test_failed(void)
{
    return failed;
}

/* Blocks that the core holds. */
EXPORT int64_t lr_test_blocks(void)
{
    return n_blocks;
}

bool lr_test_fails(const char *file, int line)
{
    if (++turn != fail_at)
        return false;
    snprintf(failed, sizeof failed, "%s:%d", file, line);
    return true;
}

static void *counted(void *block)
{
    n_blocks += block != NULL;
    return block;
}

void *__wrap_malloc(size_t nbytes)
{
    return counted(__real_malloc(nbytes));
}

void *__wrap_calloc(size_t n, size_t nbytes)
{
    return counted(__real_calloc(n, nbytes));
}

void *__wrap_realloc(void *block, size_t nbytes)
{
    return block == NULL ? counted(__real_realloc(block, nbytes)) : __real_realloc(block, nbytes);
}

void *__wrap_aligned_alloc(size_t at, size_t nbytes)
{
    return counted(__real_aligned_alloc(at, nbytes));
}

void *__wrap_mmap(void *where, size_t nbytes, int prot, int flags, int file, off_t from)
{
    void *pages = __real_mmap(where, nbytes, prot, flags, file, from);
    n_blocks += pages != (void *)-1;
    return pages;
}

int __wrap_munmap(void *where, size_t nbytes)
{
    n_blocks--;
    return __real_munmap(where, nbytes);
}

void __wrap_free(void *block)
{
    n_blocks -= block != NULL;
    __real_free(block);
}
