# SPDX-License-Identifier: GPL-3.0-or-later
"""OpenVDB files with balls in them, for the tests of Volume objects."""

import bpy
import numpy as np

VOXEL = 1 / 18  # of balls of radius 1
REACH = 3  # voxels of a level set's band
# How far the trilinear field of a ball's distances is off: an eighth of the square of the voxel by
# the second derivatives, which are 1 / radius in two directions.
OFF = 2 * VOXEL**2 / 8


def openvdb():
    bpy.utils.expose_bundled_modules()
    import openvdb

    return openvdb


def distances(n=48, centre=(0.0, 0.0, 0.0)):
    """(n, n, n) in x, y, z order: distance from a centre, in voxels from the middle, to samples."""
    axes = np.meshgrid(*[np.arange(n) - (n - 1) / 2] * 3, indexing="ij")
    return np.sqrt(sum((a - c) ** 2 for a, c in zip(axes, centre, strict=True)))


def grid(values, name, kind="unknown", background=0.0):
    """A float grid of values in x, y, z order, VOXEL apart, round the origin."""
    made = openvdb().FloatGrid(background)
    made.copyFromArray(np.ascontiguousarray(values, np.float32))
    made.name, made.gridClass = name, kind
    made.transform = openvdb().createLinearTransform(VOXEL)
    made.transform.postTranslate([-(len(values) - 1) / 2 * VOXEL] * 3)
    return made


def level_set(name="ball", radius=1.0):
    """A ball as the distances to its surface, in units of space, inside below 0."""
    values = (distances() - radius / VOXEL).clip(-REACH, REACH) * VOXEL
    return grid(values, name, "level set", REACH * VOXEL)


def fog(name="density", radius=1.0):
    """A ball whose density falls from 2 to 0 over eight voxels, and is 1 on its surface."""
    return grid((1 + (radius / VOXEL - distances()) / 4).clip(0, 2), name, "fog volume")


def write(path, *grids):
    openvdb().write(str(path), grids=list(grids))
    return str(path)
