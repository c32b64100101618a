/* Large arrays by mmap, small ones by malloc, each behind a header that tells.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#define _DEFAULT_SOURCE /* MAP_ANONYMOUS */
#include "base/pages.h"

#include <sys/mman.h>

enum { HEADER = 64, LEAST = 1 << 19 /* bytes that are worth a call to the system */ };

void *(lr_pages_new)(uint64_t n, size_t element_nbytes)
{
    if (n > (UINT64_MAX >> 1) / element_nbytes)
        return NULL;
    const uint64_t nbytes = (HEADER + n * element_nbytes + HEADER - 1) / HEADER * HEADER;
    uint64_t mapped = 0;
    unsigned char *block;
    if (nbytes >= LEAST) {
        block = mmap(NULL, nbytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        mapped = nbytes;
        if (block == MAP_FAILED)
            return NULL;
        madvise(block, nbytes, MADV_HUGEPAGE); /* fewer faults, where the system has such pages */
    } else {
        block = aligned_alloc(HEADER, nbytes);
        if (block == NULL)
            return NULL;
        memset(block, 0, nbytes);
    }
    memcpy(block, &mapped, sizeof mapped);
    return block + HEADER;
}

void lr_pages_free(void *pages)
{
    if (pages == NULL)
        return;
    unsigned char *block = (unsigned char *)pages - HEADER;
    uint64_t mapped;
    memcpy(&mapped, block, sizeof mapped);
    if (mapped != 0)
        munmap(block, mapped);
    else
        free(block);
}
