/* Connects the samples of a brick that lie on one side of the surface.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "voxelize/link_samples.h"

#include "grid/layout.h"

uint16_t lr_linked_root(uint16_t *parent, uint16_t i)
{
    for (; parent[i] != i; i = parent[i])
        parent[i] = parent[parent[i]];
    return i;
}

/* The 13 of the 26 neighbours that follow in order. */
static const int8_t STEP[13][3] = {
    {1, 0, 0},  {-1, 1, 0}, {0, 1, 0}, {1, 1, 0},  {-1, -1, 1}, {0, -1, 1}, {1, -1, 1},
    {-1, 0, 1}, {0, 0, 1},  {1, 0, 1}, {-1, 1, 1}, {0, 1, 1},   {1, 1, 1},
};

static void link_step(const float *distance, const int8_t step[3], uint16_t *parent)
{
    float length = sqrtf((float)(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]));
    int offset = step[0] * lr_stride(0) + step[1] * lr_stride(1) + step[2] * lr_stride(2);
    for (int z = 0; z < LR_SIDE - step[2]; z++)
        for (int y = step[1] < 0; y < LR_SIDE - (step[1] > 0); y++)
            for (int x = step[0] < 0; x < LR_SIDE - (step[0] > 0); x++) {
                int i = lr_in_brick(x, y, z), j = i + offset;
                if (!(distance[i] + distance[j] > (float)LR_LINK * length) || distance[i] <= 0.0f ||
                    distance[j] <= 0.0f || distance[i] == INFINITY || distance[j] == INFINITY)
                    continue;
                uint16_t a = lr_linked_root(parent, (uint16_t)i),
                         b = lr_linked_root(parent, (uint16_t)j);
                parent[a < b ? b : a] = a < b ? a : b;
            }
}

void lr_link_samples(const float *distance, uint16_t *parent)
{
    for (uint16_t i = 0; i < LR_CELLS; i++)
        parent[i] = i;
    for (int s = 0; s < 13; s++)
        link_step(distance, STEP[s], parent);
}
