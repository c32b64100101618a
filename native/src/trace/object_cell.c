/* Each object's own field, cell by cell.
 *
 * Where all corners are of one object its field is the volume's, and that is most
 * cells; else every object that has a corner at or above T and one below is tested by
 * itself, so that no sample which one object lost to another opens a gap in either.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "trace/object_cell.h"

enum { MOST = 16 }; /* objects at eight corners of two samples */

typedef struct member {
    int32_t object;
    double corner[8];
} member;

/* Add an object in its place, if it is not there. */
static void add_member(member *members, int *n, int32_t object)
{
    int at = 0;
    while (at < *n && members[at].object < object)
        at++;
    if (at < *n && members[at].object == object)
        return;
    memmove(&members[at + 1], &members[at], (size_t)(*n - at) * sizeof *members);
    members[at] = (member){.object = object};
    ++*n;
}

/* The objects of a cell, ascending, with their own corners. */
static int gather(const lr_volume *v, const int32_t c[3], member *members)
{
    int n = 0;
    lr_pair_of_samples pair[8];
    for (int b = 0; b < 8; b++)
        pair[b] = lr_sample_pair(v, c[0] + (b & 1), c[1] + (b >> 1 & 1), c[2] + (b >> 2));
    for (int b = 0; b < 8; b++)
        for (int i = 0; i < 2; i++)
            if (pair[b].object[i] != LR_NO_OBJECT)
                add_member(members, &n, pair[b].object[i]);
    for (int i = 0; i < n; i++)
        for (int b = 0; b < 8; b++)
            members[i].corner[b] = lr_value_of(&pair[b], members[i].object);
    return n;
}

static bool has_surface(const double corner[8], double level)
{
    bool below = false, above = false;
    for (int b = 0; b < 8; b++) {
        below = below || corner[b] < level;
        above = above || corner[b] >= level;
    }
    return below && above;
}

/* Whose surface does a ray leave that starts on one in this cell? */
static int leaver(const lr_volume *v, const lr_ray *r, const lr_cursor *u, const member *members,
                  int n)
{
    double p[3], best = INFINITY;
    int which = -1;
    for (int a = 0; a < 3; a++)
        p[a] = lr_clamp(r->o[a] + (r->s[a] == 0 ? 0.0 : u->t * r->d[a]) - u->c[a], 0.0, 1.0);
    for (int i = 0; i < n; i++) {
        if (!has_surface(members[i].corner, v->threshold))
            continue;
        const double off = fabs(lr_trilinear(members[i].corner, p) - v->threshold);
        if (off < best) {
            best = off;
            which = i;
        }
    }
    return which;
}

bool lr_hit_objects(const lr_volume *v, const lr_ray *r, const lr_cursor *u, int side,
                    const lr_trace_options *options, lr_found *found, uint64_t *n_samples)
{
    member members[MOST + 1];
    const int n = gather(v, u->c, members);
    const int left = side != 0 ? leaver(v, r, u, members, n) : -1;
    bool hit = false;
    for (int i = 0; i < n; i++) {
        lr_found one;
        if (!has_surface(members[i].corner, v->threshold) ||
            !lr_hit_corners(v, members[i].corner, r, LR_REGULAR, u, i == left ? side : 0, options,
                            &one, n_samples) ||
            (hit && !(one.t < found->t)))
            continue;
        one.object = members[i].object;
        *found = one;
        hit = true;
    }
    return hit;
}

int32_t lr_id_of_object(const lr_volume *v, const lr_found *found)
{
    double nearest = INFINITY;
    int32_t id = 0;
    for (int b = 0; b < 8; b++) {
        const int32_t *c = found->c;
        const double q[3] = {found->p[0] - (b & 1), found->p[1] - (b >> 1 & 1),
                             found->p[2] - (b >> 2)};
        const lr_pair_of_samples pair =
            lr_sample_pair(v, c[0] + (b & 1), c[1] + (b >> 1 & 1), c[2] + (b >> 2));
        for (int i = 0; i < 2; i++)
            if (pair.object[i] == found->object && pair.value[i] >= v->threshold &&
                lr_dot(q, q) < nearest) {
                nearest = lr_dot(q, q);
                id = pair.id[i];
            }
    }
    return id;
}
