/* What rays meet in homogeneous solids: light in closed form, and points that scatter.
 *
 * Transmittance is an exponential per channel of color. Where a ray is scattered follows the
 * density of one channel, chosen by how much of it is scattered in all; the weight is by the mean
 * density of all channels, so that none is scattered by a density far from its own. Of several
 * solids one scatters the ray, chosen by its share there.
 *
 * Source: Wilkie, Nawaz, Droske, Weidlich, Hanika, Hero wavelength spectral sampling, 2014 (balance
 * heuristic over channels).
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/integrator/medium.h"

bool lr_medium_find(const lr_scene *scene, const lr_medium_stack *in, uint32_t visibility,
                    lr_medium *medium)
{
    bool found = false;
    *medium = (lr_medium){.extinction = {0}};
    for (uint32_t k = 0; k < in->n; k++) {
        const lr_material *m = lr_medium_stack_filling(scene, in, k, visibility);
        if (m == NULL)
            continue;
        found = true;
        for (int a = 0; a < 3; a++) {
            medium->extinction[a] += m->medium.extinction[a];
            medium->scattering[a] += m->medium.scattering[a];
            medium->glow[a] += m->medium.glow[a];
        }
    }
    return found;
}

/* Optical depth; of an infinite length in nothing 0. */
static double depth(const lr_medium *medium, int a, double length)
{
    return medium->extinction[a] > 0 ? medium->extinction[a] * length : 0;
}

/* The integral of the transmittance over a length. A ray that never leaves a solid is lost by
 * rounding, and gets nothing of what does not absorb. */
static double mean_way(const lr_medium *medium, int a, double length)
{
    const double x = depth(medium, a, length);
    if (x > 1)
        return -expm1(-x) / medium->extinction[a];
    return length < INFINITY ? length * (x > 0 ? -expm1(-x) / x : 1) : 0;
}

void lr_medium_pass(const lr_medium *medium, double length, double color[3], double through[3])
{
    for (int a = 0; a < 3; a++) {
        color[a] = medium->glow[a] != 0 ? medium->glow[a] * mean_way(medium, a, length) : 0;
        through[a] = exp(-depth(medium, a, length));
    }
}

/* How much of each channel would be scattered by an endless way; returns the sum. */
static double scattered(const lr_medium *medium, const double throughput[3], double part[3])
{
    double sum = 0;
    for (int a = 0; a < 3; a++) {
        const double s = medium->scattering[a];
        part[a] = s > 0 ? fabs(throughput[a]) * s / medium->extinction[a] : 0;
        sum += part[a];
    }
    return sum;
}

double lr_medium_opacity(const lr_medium *medium, const double throughput[3], double length)
{
    double part[3], opaque = 0;
    const double all = scattered(medium, throughput, part);
    for (int a = 0; a < 3; a++)
        opaque += part[a] * -expm1(-depth(medium, a, length));
    return all > 0 ? opaque / all : 0;
}

/* Choose one of n by its share; what is left of u is uniform again. */
static uint32_t choose(const double *shares, uint32_t n, double *u)
{
    double sum = 0;
    uint32_t last = 0;
    for (uint32_t k = 0; k < n; k++)
        sum += shares[k];
    double at = *u * sum;
    for (uint32_t k = 0; k < n; k++) {
        if (!(shares[k] > 0))
            continue;
        last = k;
        if (at < shares[k])
            break;
        at -= shares[k];
    }
    *u = lr_clamp(at / shares[last], 0, 1);
    return last;
}

/* Where within the length a ray is scattered, by the density of one channel. */
static double draw_by_channel(const lr_medium *medium, const double drawn[3], double length,
                              double u, double *rest)
{
    const double sigma = medium->extinction[choose(drawn, 3, rest)];
    return fmin(-log1p(u * expm1(-sigma * length)) / sigma, length);
}

double lr_medium_draw(const lr_scene *scene, const lr_medium_stack *in, uint32_t visibility,
                      const lr_medium *medium, const double throughput[3], double length,
                      const lr_lamps_beside *lamps, const double u[2], uint32_t *solid,
                      double weight[3])
{
    double part[3], drawn[3], there[3], share[LR_MEDIA_MAX] = {0}, rest = u[1];
    double all_drawn = 0, all_there = 0;
    const double all = scattered(medium, throughput, part);
    for (int a = 0; a < 3; a++) {
        drawn[a] = part[a] * -expm1(-depth(medium, a, length));
        all_drawn += drawn[a];
    }
    const double t = u[0] < lamps->share
                         ? lr_lamps_beside_draw(lamps, u[0] / lamps->share)
                         : draw_by_channel(medium, drawn, length,
                                           (u[0] - lamps->share) / (1 - lamps->share), &rest);
    for (int a = 0; a < 3; a++)
        there[a] = fabs(throughput[a]) * exp(-depth(medium, a, t));
    for (uint32_t k = 0; k < in->n; k++) {
        const lr_material *m = lr_medium_stack_filling(scene, in, k, visibility);
        for (int a = 0; a < 3 && m != NULL; a++)
            share[k] += m->medium.scattering[a] * there[a];
        all_there += share[k];
    }
    memset(weight, 0, 3 * sizeof *weight);
    *solid = 0;
    if (!(all_there > 0)) /* by a lamp, where no light from it is left */
        return t;
    *solid = choose(share, in->n, &rest);
    const double pdf = all_there / all_drawn;
    const double drawn_by_both =
        (1 - lamps->share) * pdf + lamps->share * lr_lamps_beside_pdf(lamps, t);
    const double mis = pdf / drawn_by_both;
    const lr_medium *chosen = &scene->materials[in->material[*solid]].medium;
    for (int a = 0; a < 3; a++)
        weight[a] = chosen->scattering[a] / share[*solid] * all * mis;
    return t;
}
