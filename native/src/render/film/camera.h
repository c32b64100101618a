/* The camera: rays through points of the film.
 *
 * SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef LR_RENDER_FILM_CAMERA_H
#define LR_RENDER_FILM_CAMERA_H

#include "base/base.h"

/* The ray o + t d through film point (x, y), in pixels from the lower left
 * corner of the image; t is the depth along the camera's axis. */
LR_INLINE void lr_camera_ray(const lr_camera *camera, double x, double y, double o[3], double d[3])
{
    for (int a = 0; a < 3; a++) {
        const double film = camera->corner[a] + x * camera->dx[a] + y * camera->dy[a];
        const bool perspective = camera->projection == LR_PERSPECTIVE;
        o[a] = perspective ? camera->eye[a] : camera->eye[a] + film;
        d[a] = perspective ? film : camera->forward[a];
    }
}

#endif
