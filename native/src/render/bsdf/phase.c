/* Phase functions.
 *
 * Source: Henyey and Greenstein, Diffuse radiation in the galaxy, 1941; Frisvad, Importance
 * sampling the Rayleigh phase function, 2011.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include "render/bsdf/phase.h"

/* Below it the closed form loses more digits than the uniform density is off. */
static const double NEARLY_NONE = 1e-6;

/* Per solid angle, over all of which it adds up to 1. cosine: between the directions in which light
 * comes and goes on. */
static double density(lr_phase phase, double cosine)
{
    if (phase.kind == LR_PHASE_RAYLEIGH)
        return 3 / (16 * LR_PI) * (1 + cosine * cosine);
    const double g = phase.g, away = fmax(1 + g * g - 2 * g * cosine, 0);
    return (1 - g * g) / (4 * LR_PI * away * sqrt(away));
}

/* The cosine of a direction with that density. */
static double sample_cosine(lr_phase phase, double u)
{
    if (phase.kind == LR_PHASE_RAYLEIGH) {
        const double x = 4 * u - 2, root = cbrt(x + copysign(sqrt(x * x + 1), x));
        return lr_clamp(root - 1 / root, -1, 1);
    }
    const double g = phase.g;
    if (fabs(g) < NEARLY_NONE)
        return 2 * u - 1;
    const double s = (1 - g * g) / (1 - g + 2 * g * u);
    return lr_clamp((1 + g * g - s * s) / (2 * g), -1, 1);
}

lr_response lr_phase_eval(lr_phase phase, const double view[3], const double light[3])
{
    const double p = density(phase, -lr_dot(view, light));
    return (lr_response){{p, p, p}, p};
}

lr_scatter lr_phase_sample(lr_phase phase, const double view[3], const double u[2])
{
    const double cosine = sample_cosine(phase, u[0]), sine = sqrt(fmax(1 - cosine * cosine, 0));
    const double x = sine * cos(2 * LR_PI * u[1]), y = sine * sin(2 * LR_PI * u[1]);
    lr_scatter scatter = {.weight = {1, 1, 1}, .kind = LR_RAY_VOLUME};
    double s[3], t[3];
    lr_orthonormal_basis(view, s, t);
    for (int a = 0; a < 3; a++)
        scatter.direction[a] = x * s[a] + y * t[a] - cosine * view[a];
    scatter.pdf = density(phase, cosine);
    return scatter;
}
