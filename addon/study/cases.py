# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes with difficult rays, of one kind each (no bpy)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import leapray

from ..arrays import unit
from . import oracle

SEED = 1992


@dataclass(frozen=True)
class Case:
    """A volume (nz, ny, nx) of f32 samples, rays through it, and the volume's place."""

    name: str
    samples: Callable[[np.random.Generator], NDArray]
    rays: Callable[[np.random.Generator, int, NDArray], tuple[NDArray, NDArray]]
    matrix: tuple = ()  # object_from_index, (3, 3); powers of two keep exact rays exact


def blobs(rng) -> NDArray:
    """Spheres with a soft border."""
    size = (33, 36, 40)
    grid = np.stack(list(np.indices(size)), axis=-1)
    field = np.zeros(size)
    for _ in range(9):
        off = np.linalg.norm(grid - rng.random(3) * size, axis=-1) - rng.uniform(1, 6)
        field = np.maximum(field, np.clip(0.5 - off / 4, 0, 1))
    return field.astype(np.float32)


def walls(rng) -> NDArray:
    """A wall one sample thick, at a slant."""
    z, y, x = np.indices((32, 32, 32)) - 15.5
    normal = np.array([0.61, 0.5, -0.615])
    off = np.abs(x * normal[0] + y * normal[1] + z * normal[2])
    return (off <= 0.5 * np.abs(normal).sum()).astype(np.float32)


def wires(rng) -> NDArray:
    """Soft rods whose radius is less than a voxel."""
    z, y, x = np.indices((36, 36, 36)).astype(float)
    field = np.zeros(x.shape)
    for tilt, a, b in ((0.13, 9, 11), (-0.21, 18, 20), (0.31, 27, 24)):
        off = np.hypot(x - a - tilt * (z - 18), y - b + tilt * (z - 18))
        field = np.maximum(field, np.clip(0.5 + (0.7 - off) / 3, 0, 1))
    return field.astype(np.float32)


def isolated(rng) -> NDArray:
    samples = np.zeros((30, 34, 38), np.float32)
    places = rng.integers(0, samples.size, 60)
    samples.flat[places] = rng.uniform(0.55, 1, 60)
    return samples


def checkerboard(rng) -> NDArray:
    return (np.indices((14, 15, 16)).sum(axis=0) % 3 == 0).astype(np.float32)


def noise(rng) -> NDArray:
    return rng.random((24, 24, 24)).astype(np.float32)


def single(rng) -> NDArray:
    return np.ones((1, 1, 1), np.float32)


def empty(rng) -> NDArray:
    return np.zeros((20, 20, 20), np.float32)


def full(rng) -> NDArray:
    return np.ones((20, 20, 20), np.float32)


def dyadic(origins, directions) -> tuple[NDArray, NDArray]:
    """Rays that the oracle takes: origins in multiples of 2^-16, whole directions."""
    fine = 2.0**oracle.SHIFT
    return np.round(np.asarray(origins) * fine) / fine, np.round(directions)


def edges(rng, count, size):
    """Rays through points of the lattice, and so through edges and corners."""
    origins, _ = oracle.lattice_rays(rng, count, size)
    directions = rng.integers(0, size, (count, 3)) * 2.0 - origins * 2.0
    directions[(directions == 0).all(axis=1)] = (1, 1, 1)
    return dyadic(origins, directions)


def in_boundary(rng, count, size):
    """Rays that run in the planes that bound the lattice and its virtual layer."""
    origins, directions = oracle.generic_rays(rng, count, size)
    axis, rows = rng.integers(0, 3, count), np.arange(count)
    planes = np.stack([np.full(3, -1), np.zeros(3), size - 1, size], axis=0)
    origins[rows, axis] = planes[rng.integers(0, 4, count), axis]
    directions[rows, axis] = np.where(rng.random(count) < 0.5, 0.0, -0.0)
    directions[(directions == 0).all(axis=1)] = (0, 0, -1)
    return origins, directions


def axis_parallel(rng, count, size):
    """One or two components are 0 or -0."""
    origins, directions = oracle.generic_rays(rng, count, size)
    zero = rng.random((count, 3)) < 0.5
    directions = np.where(zero, np.where(rng.random((count, 3)) < 0.5, 0.0, -0.0), directions)
    directions[(directions == 0).all(axis=1)] = (0, -1, 0)
    origins = np.where(zero, rng.integers(-2, 4 * size + 6, (count, 3)) / 4.0, origins)
    return dyadic(origins, directions)


def grazing(rng, count, size):
    """Nearly parallel to an axis, close to lattice planes."""
    origins, directions = oracle.generic_rays(rng, count, size)
    axis, rows = rng.integers(0, 3, count), np.arange(count)
    origins = np.floor(origins) + rng.integers(-2, 3, (count, 3)) * 2.0**-oracle.SHIFT
    inside = rng.integers(0, size, (count, 3))
    origins = np.where(np.arange(3) == axis[:, None], origins, inside + origins % 1.0)
    directions = rng.integers(-3, 4, (count, 3)).astype(float)
    directions[rows, axis] = np.sign(size[axis] / 2 - origins[rows, axis] + 0.1) * 2.0**20
    return dyadic(origins, directions)


def from_inside(rng, count, size):
    origins = rng.random((count, 3)) * (size - 1)
    return dyadic(origins, rng.normal(size=(count, 3)) * 4096)


def from_afar(rng, count, size):
    """Origins a million voxels away."""
    away = 1e6 * unit(rng.normal(size=(count, 3)))
    targets = rng.random((count, 3)) * (size + 1) - 1
    origins, _ = dyadic(targets + away, away)
    return dyadic(origins, (targets - origins) * 2.0**8)


STRETCH = ((1024.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))
SHEAR = ((1.0, 0.5, 0), (0, 1.0, 0.25), (0, 0, 1.0))
GENERIC = oracle.generic_rays
CASES = (
    Case("generic rays", blobs, GENERIC),
    Case("aligned with the lattice", blobs, oracle.lattice_rays),
    Case("zero and -0 components", blobs, axis_parallel),
    Case("nearly along lattice planes", blobs, grazing),
    Case("through edges and corners", isolated, edges),
    Case("in a boundary plane", blobs, in_boundary),
    Case("start inside", blobs, from_inside),
    Case("origin 10^6 voxels away", blobs, from_afar),
    Case("walls one voxel thick", walls, GENERIC),
    Case("rods thinner than a voxel", wires, GENERIC),
    Case("isolated voxels", isolated, GENERIC),
    Case("checkerboard", checkerboard, GENERIC),
    Case("noise", noise, GENERIC),
    Case("empty volume", empty, GENERIC),
    Case("full volume", full, GENERIC),
    Case("one voxel", single, oracle.lattice_rays),
    Case("voxels 1 : 1024", blobs, GENERIC, STRETCH),
    Case("sheared voxels", blobs, GENERIC, SHEAR),
)


def made(case: Case, count: int):
    """The volume, its samples, and its rays in index space and in object space."""
    rng = np.random.default_rng((SEED, CASES.index(case)))
    samples = case.samples(rng)
    origins, directions = case.rays(rng, count, np.array(samples.shape[::-1]))
    matrix = np.eye(4)
    if case.matrix:
        matrix[:3, :3] = case.matrix
    volume = leapray.Volume(samples, object_from_index=matrix)
    placed = (origins, directions)
    if case.matrix:
        placed = tuple(part @ matrix[:3, :3].T for part in placed)
    return volume, samples, (origins, directions), placed
