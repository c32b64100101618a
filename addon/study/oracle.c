/* The integer oracle: the cells that a ray pierces, by exact rational arithmetic.
 *
 * A ray starts at O / 2^SHIFT and runs along the integer direction D; all
 * parameters are fractions of integers and are compared by cross multiplication
 * in 128 bits. Nothing is rounded, and no code is shared with the core.
 *
 * What counts as sound: the claimed cell is an object cell and the ray touches
 * it (its closed cube), and no surface cell whose open interior the ray pierces is
 * entered earlier; a miss is sound where no surface cell is pierced. At ties, on
 * faces, edges and corners, any such cell will do.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <stdint.h>

typedef __int128 big;

enum { SOUND = 0, MISSED = 1, LATE = 2, NO_OBJECT = 3, NOT_TOUCHED = 4 };

typedef struct {
    big n, d;
} fraction; /* d > 0 */

static int less(fraction a, fraction b)
{
    return a.n * b.d < b.n * a.d;
}

/* Where plane k of axis a lies, in units of 2^-shift: at k, or where the table of a
 * rectilinear volume says, whose first entry is plane -1. */
typedef struct {
    const int64_t *at[3];
    int shift;
} planes;

static int64_t place(const planes *p, int a, int64_t k)
{
    return p->at[a] ? p->at[a][k + 1] : k * ((int64_t)1 << p->shift);
}

/* t at which the ray is at plane k of an axis that it moves along. */
static fraction plane(const planes *p, const int64_t O[3], const int64_t D[3], int a, int64_t k)
{
    fraction t = {(big)place(p, a, k) - O[a], (big)D[a] << p->shift};
    if (t.d < 0) {
        t.n = -t.n;
        t.d = -t.d;
    }
    return t;
}

/* When does the ray touch the closed box lo..hi (planes)? 0: never from t = 0 on. */
static int touch(const planes *p, const int64_t O[3], const int64_t D[3], const int64_t lo[3],
                 const int64_t hi[3], fraction *from)
{
    fraction in = {0, 1}, out = {1, 0};
    for (int a = 0; a < 3; a++) {
        if (D[a] == 0) {
            if (O[a] < place(p, a, lo[a]) || O[a] > place(p, a, hi[a]))
                return 0;
            continue;
        }
        fraction near = plane(p, O, D, a, D[a] > 0 ? lo[a] : hi[a]);
        fraction far = plane(p, O, D, a, D[a] > 0 ? hi[a] : lo[a]);
        if (less(in, near))
            in = near;
        if (out.d == 0 || less(far, out))
            out = far;
    }
    *from = in;
    return out.d == 0 || !less(out, in);
}

/* The cell from lo on, hi exclusive, that the ray is in just after t, along axis a; lo - 1
 * or hi where it is in none. */
static int64_t cell_after(const planes *p, const int64_t O[3], const int64_t D[3], int a,
                          fraction t, int64_t lo, int64_t hi)
{
    big numerator = (big)O[a] * t.d + (t.n * D[a] << p->shift);
    int64_t below = lo - 1, above = hi; /* the last plane that the ray has reached */
    while (below < above) {
        int64_t k = above - (above - below) / 2;
        big there = place(p, a, k) * t.d;
        if (D[a] < 0 ? there < numerator : there <= numerator)
            below = k;
        else
            above = k - 1;
    }
    return below;
}

static int within(const int64_t cell[3], const int64_t lo[3], const int64_t hi[3])
{
    int in = 1;
    for (int a = 0; a < 3; a++)
        in = in && cell[a] >= lo[a] && cell[a] < hi[a];
    return in;
}

/* Into the next cell, through an edge or a corner along several axes at once; t of the
 * crossing. next is scratch. */
static fraction step(const planes *p, const int64_t O[3], const int64_t D[3], int64_t cell[3],
                     fraction next[3])
{
    fraction soonest = {1, 0};
    for (int a = 0; a < 3; a++) {
        if (D[a] == 0)
            continue;
        next[a] = plane(p, O, D, a, D[a] > 0 ? cell[a] + 1 : cell[a]);
        if (soonest.d == 0 || less(next[a], soonest))
            soonest = next[a];
    }
    for (int a = 0; a < 3; a++)
        if (D[a] != 0 && !less(soonest, next[a]))
            cell[a] += D[a] > 0 ? 1 : -1;
    return soonest;
}

/* The first surface cell whose open interior is pierced; cells start at -1. */
static int first_pierced(const uint8_t *objects, const planes *p, const int64_t n[3],
                         const int64_t O[3], const int64_t D[3], int64_t cell[3], fraction *from)
{
    int64_t lo[3], hi[3];
    for (int a = 0; a < 3; a++) {
        lo[a] = -1;
        hi[a] = n[a] - 1;
        for (int64_t k = lo[a]; D[a] == 0 && k <= hi[a]; k++)
            if (O[a] == place(p, a, k))
                return 0; /* inside a plane: it pierces no interior */
    }
    fraction t, next[3];
    if (!touch(p, O, D, lo, hi, &t))
        return 0;
    for (int a = 0; a < 3; a++)
        cell[a] = cell_after(p, O, D, a, t, lo[a], hi[a]);
    while (within(cell, lo, hi)) {
        int64_t at = ((cell[2] + 1) * n[1] + cell[1] + 1) * n[0] + cell[0] + 1;
        if (objects[at]) {
            *from = t;
            return 1;
        }
        t = step(p, O, D, cell, next);
    }
    return 0;
}

/* objects[nz][ny][nx], n = x, y, z; the first is cell (-1, -1, -1). cells[rays][3]
 * are the claims, read where hit[ray]; x, y, z: the planes -1..n-1 of a rectilinear
 * volume in units of 2^-shift, or NULL; verdict[ray] is one of the above, and
 * exact[ray] tells whether a surface cell is pierced. */
void oracle_judge(const uint8_t *objects, const int64_t n[3], const int64_t *O, const int64_t *D,
                  int64_t rays, int shift, const int64_t *x, const int64_t *y, const int64_t *z,
                  const uint8_t *hit, const int32_t *cells, uint8_t *verdict, uint8_t *exact)
{
    const planes p = {{x, y, z}, shift};
    for (int64_t i = 0; i < rays; i++) {
        int64_t size[3] = {n[0], n[1], n[2]}, first[3], claim[3], above[3];
        fraction pierced, touched;
        exact[i] = (uint8_t)first_pierced(objects, &p, size, O + 3 * i, D + 3 * i, first, &pierced);
        verdict[i] = SOUND;
        if (!hit[i]) {
            verdict[i] = exact[i] ? MISSED : SOUND;
            continue;
        }
        int inside = 1;
        for (int a = 0; a < 3; a++) {
            claim[a] = cells[3 * i + a];
            above[a] = claim[a] + 1;
            inside = inside && claim[a] >= -1 && claim[a] < n[a] - 1;
        }
        if (!inside || !objects[((claim[2] + 1) * n[1] + claim[1] + 1) * n[0] + claim[0] + 1])
            verdict[i] = NO_OBJECT;
        else if (!touch(&p, O + 3 * i, D + 3 * i, claim, above, &touched))
            verdict[i] = NOT_TOUCHED;
        else if (exact[i] && less(pierced, touched))
            verdict[i] = LATE;
    }
}

/* The cells that the ray pierces inside the box of cells lo..hi (exclusive), in order;
 * their number, at most room. Through an edge or a corner it goes at once. */
int64_t oracle_path(const int64_t O[3], const int64_t D[3], int shift, const int64_t lo[3],
                    const int64_t hi[3], int32_t *cells, int64_t room)
{
    const planes uniform = {{0}, shift}, *p = &uniform;
    fraction t, next[3];
    int64_t cell[3];
    if (!touch(p, O, D, lo, hi, &t))
        return 0;
    for (int a = 0; a < 3; a++)
        cell[a] = cell_after(p, O, D, a, t, lo[a], hi[a]);
    int64_t n = 0;
    while (n < room && within(cell, lo, hi)) {
        for (int a = 0; a < 3; a++)
            cells[3 * n + a] = (int32_t)cell[a];
        n++;
        t = step(p, O, D, cell, next);
    }
    return n;
}
