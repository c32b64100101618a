/* Large arrays that go back to the system as soon as they are freed.
 *
 * malloc keeps what a thread frees, up to 64 MB, for that thread; and every call into the core
 * may come from another one.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_BASE_PAGES_H
#define LR_BASE_PAGES_H

#include "base/base.h"

/* n elements of so many bytes, all zero, aligned to 64 bytes; NULL without memory. Freed by
 * lr_pages_free alone. */
void *lr_pages_new(uint64_t n, size_t element_nbytes);
void lr_pages_free(void *pages); /* NULL is fine */

#endif
