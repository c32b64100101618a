/* Sides of the bricks that no triangle comes near, by a flood fill from the bricks around.
 *
 * A face-connected component of such bricks lies on one side: outside if it reaches the
 * border of the table, else that of most samples on the faces around it. All of these agree
 * unless the signs in the band are wrong.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/flood_fill.h"

/* The bricks without a side, and the votes for each component. */
typedef struct undecided {
    const lr_voxelizer *v;
    uint32_t *active; /* [table]: active brick + 1, 0: no triangle near */
    uint8_t *seen;    /* [table] */
    uint32_t *queue;  /* bricks of the component */
    size_t n;
    int64_t votes;
    bool at_border, contradicts;
    int32_t most, least; /* vote of one face */
} undecided;

static bool is_unknown(const undecided *u, size_t at)
{
    uint32_t active = u->active[at];
    return active == 0 || u->v->verdicts[active - 1].state == LR_STATE_UNKNOWN;
}

static void look(undecided *u, size_t at, int their_face)
{
    if (!is_unknown(u, at)) {
        const lr_faces *faces = &u->v->verdicts[u->active[at] - 1].faces;
        int32_t vote = 2 * __builtin_popcountll(faces->inside[their_face]) - LR_LAYER_SAMPLES;
        u->votes += vote;
        u->most = lr_max_i(u->most, vote);
        u->least = lr_min_i(u->least, vote);
    } else if (!u->seen[at]) {
        u->seen[at] = 1;
        u->queue[u->n++] = (uint32_t)at;
    }
}

static void look_around(undecided *u, size_t at)
{
    const int32_t *size = u->v->job.table_size;
    size_t rest = at, step = 1;
    for (int a = 0; a < 3; a++) {
        size_t n = (size_t)size[a], x = rest % n;
        rest /= n;
        if (x == 0 || x == n - 1)
            u->at_border = true;
        if (x > 0)
            look(u, at - step, 2 * a + 1);
        if (x < n - 1)
            look(u, at + step, 2 * a);
        step *= n;
    }
}

static bool decide_component(undecided *u, size_t seed, lr_volume *volume, const lr_watch *watch)
{
    u->n = 0;
    u->votes = 0;
    u->most = u->least = 0;
    u->at_border = false;
    u->seen[seed] = 1;
    u->queue[u->n++] = (uint32_t)seed;
    for (size_t i = 0; i < u->n; i++) {
        if (i % 65536 == 0 && lr_stopped(watch))
            return false;
        look_around(u, u->queue[i]);
    }
    u->contradicts = u->contradicts || (u->most > 0 && (u->least < 0 || u->at_border));
    if (!u->at_border && u->votes > 0)
        for (size_t i = 0; i < u->n; i++)
            lr_volume_enter_full(volume, u->queue[i]);
    return true;
}

/* Do neighbouring bricks have different sides where no surface lies between them? */
static bool faces_differ(const undecided *u, size_t at)
{
    const int32_t *size = u->v->job.table_size;
    size_t rest = at, step = 1;
    bool differ = false;
    for (int a = 0; a < 3; a++) {
        size_t n = (size_t)size[a], x = rest % n;
        rest /= n;
        if (x + 1 < n && !is_unknown(u, at + step)) {
            const lr_faces *p = &u->v->verdicts[u->active[at] - 1].faces;
            const lr_faces *q = &u->v->verdicts[u->active[at + step] - 1].faces;
            const int up = 2 * a + 1, down = 2 * a;
            differ = differ || ((p->inside[up] ^ q->inside[down]) &
                                ~(p->in_band[up] & q->in_band[down])) != 0;
        }
        step *= n;
    }
    return differ;
}

lr_status lr_between_decide(lr_voxelizer *v, const lr_watch *watch, bool *contradicts,
                            lr_error *error)
{
    size_t n_table = lr_table_count(v->volume);
    undecided u = {.v = v};
    u.active = calloc(n_table, sizeof *u.active);
    u.seen = calloc(n_table, 1);
    u.queue = malloc(n_table * sizeof *u.queue);
    lr_status status = LR_OK;
    if (u.active == NULL || u.seen == NULL || u.queue == NULL) {
        status = lr_fail_memory(error, n_table * 9, "the flood of the bricks");
    } else {
        for (uint32_t i = 0; i < v->bins.n_active; i++)
            u.active[v->bins.brick[i]] = i + 1;
        for (size_t at = 0; at < n_table && status == LR_OK; at++)
            if (!u.seen[at] && is_unknown(&u, at) && !decide_component(&u, at, v->volume, watch))
                status = lr_fail_stopped(error);
    }
    for (uint32_t i = 0; i < v->bins.n_active && status == LR_OK && !u.contradicts; i++) {
        if (i % 4096 == 0 && lr_stopped(watch))
            status = lr_fail_stopped(error);
        size_t at = v->bins.brick[i];
        u.contradicts = !is_unknown(&u, at) && faces_differ(&u, at);
    }
    *contradicts = u.contradicts;
    free(u.active);
    free(u.seen);
    free(u.queue);
    return status;
}
