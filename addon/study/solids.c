/* Where rays enter a torus, or a sphere, which is one without a ring.
 *
 * Marching by the exact distance never passes the surface. It is done for the
 * solid with its surface moved outwards by a margin, then, going on from there,
 * for the one with its surface moved inwards: a field whose surface deviates by
 * less than the margin has its first crossing between the two.
 *
 * Source: Hart 1996, Sphere tracing.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#include <math.h>
#include <stdint.h>

static const double THERE = 1e-10; /* of the unit of length: ends the march */
enum { MOST_STEPS = 20000 };       /* grazing rays creep */

static double distance(const double o[3], const double d[3], double t, double major, double minor)
{
    const double x = o[0] + t * d[0], y = o[1] + t * d[1], z = o[2] + t * d[2];
    if (major == 0.0)
        return sqrt(x * x + y * y + z * z) - minor;
    const double across = sqrt(x * x + y * y) - major;
    return sqrt(across * across + z * z) - minor;
}

/* From t on; infinity where the ray has left the ball, or creeps. */
static double march(const double o[3], const double d[3], double t, double major, double minor,
                    double end)
{
    for (int step = 0; step < MOST_STEPS && t < end; step++) {
        const double f = distance(o, d, t, major, minor);
        if (f < THERE)
            return t;
        t += f;
    }
    return INFINITY;
}

/* o, d [n][3], d unit, o outside; early, late [n]: where the ray enters the solid grown and
 * shrunk by margin, infinity where it does not. The ring lies in the plane z = 0. */
void solid_entries(const double *o, const double *d, int64_t n, double major, double minor,
                   double margin, double *early, double *late)
{
    const double radius = major + minor + 2 * margin;
    for (int64_t i = 0; i < n; i++) {
        const double *p = o + 3 * i, *q = d + 3 * i;
        const double middle = -(p[0] * q[0] + p[1] * q[1] + p[2] * q[2]);
        const double end = middle + radius;
        const double begin = middle - radius > 0 ? middle - radius : 0;
        early[i] = march(p, q, begin, major, minor + margin, end);
        late[i] = isinf(early[i]) ? INFINITY : march(p, q, early[i], major, minor - margin, end);
    }
}
