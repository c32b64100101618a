# SPDX-License-Identifier: GPL-3.0-or-later
"""Random arguments of the core's package: mostly right, or with wrong ones among them."""

from __future__ import annotations

from functools import cache

import meshes
import numpy as np

import leapray

NUMBERS = (
    *(0.0, -0.0, 0.5, 1.0, -1.0, 2.0, 3.0, 8.0, -7.5, 1e-3, 1e3, 1e9, -3e9, 1e30, -1e30, 1e300),
    *(-1e300, 1.7e308, 5e-324, 1e-310, 1e-300, 1e-30, -1e-30, 2.0**31, 2.0**53),
    *(np.nan, np.inf, -np.inf),
)
WHOLES = (0, 1, -1, 2, 3, 5, 7, 8, 9, 16, 17, 255, 256, 65535, 65536, 2**31 - 1, -(2**31), 2**31)
DTYPES = ("f4", "f8", "u1", "u2", ">f4", ">u2", "i4", "i8", "f2", "bool", "c16", "O", "U3")


class Source:
    """One call's random choices."""

    def __init__(self, seed: int, index: int) -> None:
        self.rng = np.random.default_rng([seed, index])
        self.calm = self.rng.random() < 0.6  # most arguments are right

    def mostly(self, p: float) -> bool:
        return self.calm or self.likely(p)

    def threads(self) -> int:
        return self.one((1, 1, 2, 3, 0) if self.mostly(0.9) else (-1, -7))

    def likely(self, p: float) -> bool:
        return bool(self.rng.random() < p)

    def one(self, things):
        things = list(things)
        return things[self.rng.integers(len(things))]

    def number(self, tame: float = 0.7) -> float:
        """Mostly an ordinary one."""
        return float(self.rng.normal() * 3) if self.mostly(tame) else self.one(NUMBERS)

    def whole(self, most: int, tame: float = 0.8) -> int:
        return int(self.rng.integers(most + 1)) if self.mostly(tame) else self.one(WHOLES)

    def numbers(self, shape, tame: float = 0.7):
        values = self.rng.normal(size=shape) * self.one((1, 1, 3, 1e6, 1e-6))
        if not self.likely(tame) and values.size:
            spots = self.rng.random(shape) < self.one((0.05, 0.5, 1.0))
            values[spots] = self.rng.choice(NUMBERS, int(spots.sum()))
        return values

    def vector(self, tame: float = 0.8):
        return (
            self.numbers(3, 1 if self.calm else tame)
            if self.mostly(0.97)
            else self.numbers(self.whole(5, 1))
        )

    def name(self, names) -> str:
        return self.one(names) if self.mostly(0.97) else self.one(("", "nothing", "surface:", 3))

    def strided(self, array):
        """The same values or others, laid out as C does not expect."""
        kind = self.rng.integers(7)
        if kind == 0:
            return array[::-1]
        if kind == 1 and array.ndim > 1:
            return array[..., ::-1]
        if kind == 2:
            return np.repeat(array, 2, axis=0)[::2]
        if kind == 3:
            return np.asfortranarray(array)
        if kind == 4 and array.size:
            return np.broadcast_to(array[:1], array.shape)
        if kind == 5 and array.ndim > 1 and not self.mostly(0.7):
            return array.T
        return array

    def ids(self, shape):
        return self.rng.integers(
            *self.one(((0, 3), (0, 65536), (-5, 70000))[: 3 - self.calm]), shape
        )

    def matrix(self):
        m = np.eye(4)
        kind = self.rng.integers(3 if self.calm else 8)
        if kind < 3:
            m[:3] = self.numbers((3, 4), 1)
        elif kind == 3:
            m[:3] = self.numbers((3, 4), 0)
        elif kind == 4:
            m *= self.one(NUMBERS)
        elif kind == 5:
            m[:3, :3] *= self.one((1e-6, 1e6, 1e-150, 1e150, -1))
        elif kind == 6:
            m = self.numbers(self.one(((4, 4), (3, 4), (16,), (0,))))
        return m

    def shape(self, most: int = 11):
        return tuple(int(n) for n in self.rng.integers(1, most + 1, 3))

    def samples(self, shape):
        z, y, x = (np.arange(n) - (n - 1) / 2 for n in shape)
        radius = self.rng.uniform(0, max(shape) / 2)
        far = np.sqrt(z[:, None, None] ** 2 + y[None, :, None] ** 2 + x[None, None, :] ** 2)
        kind = self.rng.integers(6)
        if kind < 3:
            return np.clip(0.5 + (radius - far) / 3, 0, 1)
        if kind == 3:
            return self.rng.random(shape) * (self.rng.random(shape) < 0.3)
        return np.full(shape, float(kind == 4))

    def typed(self, array, dtype: str):
        with np.errstate(all="ignore"):
            if dtype in ("u1", "u2", ">u2"):
                return (array * 255).astype(dtype)
            return array.astype(dtype)

    def planes(self, shape):
        made = []
        for n in shape[::-1]:
            n = n if self.mostly(0.98) else self.whole(12, 1)
            axis = np.cumsum(self.rng.uniform(0.1, 3, n)) + self.number(0.8)
            if n and not self.mostly(0.9):
                axis[self.rng.integers(n)] = self.one(NUMBERS)
            made.append(axis if self.mostly(0.9) else self.strided(axis))
        return tuple(made[: None if self.mostly(0.99) else 2])

    def volume(self):
        """A new volume, if the arguments allow one."""
        shape = self.shape()
        samples = self.samples(shape)
        if not self.mostly(0.8):
            samples = np.where(self.rng.random(shape) < 0.2, self.one(NUMBERS), samples)
        samples = self.typed(
            samples, self.one(("f4", "f8", "u1", "u2") if self.mostly(0.8) else DTYPES)
        )
        more = {}
        if self.likely(0.5):
            more["threshold"] = self.rng.uniform(0.01, 1) if self.mostly(0.8) else self.one(NUMBERS)
        if self.likely(0.3):
            more["ids"] = self.ids(shape)
        if self.likely(0.5):
            more["object_from_index"] = self.matrix()
        if self.likely(0.3):
            more["sheet"] = True
            more["touched"] = self.strided(self.rng.random(shape) < self.one((0, 0.5, 1)))
        if self.likely(0.3):
            more["planes"] = self.planes(shape)
        return leapray.Volume(self.strided(samples), **more)

    def mesh(self):
        vertices, triangles = (a.copy() for a in self.one(known_meshes()))
        if self.likely(0.3):
            vertices = vertices * self.one((1e-6, 1e6, 1e-200, 1e200, 0))
        if self.likely(0.2):
            spot = self.rng.integers(len(vertices)), self.rng.integers(3)
            vertices[spot] = self.one(NUMBERS)
        if self.likely(0.2):
            spot = self.rng.integers(len(triangles)), self.rng.integers(3)
            triangles[spot] = self.rng.integers(len(vertices))
        if not self.mostly(0.9):
            triangles = triangles.astype(self.one(("i8", "u4", "f8", "i2")))
            triangles[0, 0] = self.one((0, len(vertices), 30000))
        if self.likely(0.1):
            vertices, triangles = self.strided(vertices), self.strided(triangles)
        if not self.mostly(0.95):
            triangles = triangles[:0]
        return vertices, triangles

    def rays(self):
        n = self.one((0, 1, 3, 17, 64))
        origins, directions = self.numbers((n, 3), 0.5), self.numbers((n, 3), 0.5)
        if self.likely(0.5):
            directions = 0.3 * self.numbers((n, 3), 1) - origins + 3
        if not self.mostly(0.95):
            directions = directions[:-1]
        if self.likely(0.1):
            origins = self.typed(origins, self.one(DTYPES[:-4]))
        return self.strided(origins), self.strided(directions), n


@cache
def known_meshes():
    return [
        meshes.box(),
        meshes.icosphere(1),
        meshes.plane(3, tilt=0.4),
        meshes.spiky(3, levels=1),
        meshes.torus(8, 6),
        meshes.leaf(5),
    ]


@cache
def known_volumes():
    """Of all kinds: solids, sheets, with ids, triangle cells, nothing in them, all merged."""
    rng = np.random.default_rng(1)
    source = Source(1, 0)
    made = [leapray.Volume(np.zeros((4, 5, 6), t)) for t in ("u1", "u2", "f4")]
    made.append(leapray.Volume(np.ones((4, 4, 4), "f4")))
    made.append(leapray.Volume(np.zeros((4, 4, 4), "f4"), planes=(np.arange(4.0) ** 2,) * 3))
    noise = rng.random((9, 10, 20)).astype("f4")
    made.append(leapray.Volume(noise, planes=[np.cumsum(rng.random(n)) for n in (20, 10, 9)]))
    made.append(leapray.Volume(noise, ids=rng.integers(0, 9, noise.shape)))
    made.append(leapray.Volume(noise, 1.0, sheet=True, touched=noise < 0.5))
    made.append(leapray.Volume(np.ones((4, 4, 4), "u1"), sheet=True, touched=np.zeros((4, 4, 4))
                               .astype(bool)))  # fmt: skip
    for k, (vertices, triangles) in enumerate(known_meshes()):
        for exact, dtype in (("all", "u1"), ("sheets", "u2"), ("none", "f4")):
            made.append(
                leapray.voxelize(
                    vertices, triangles, 0.2, exact=exact, threads=1,
                    dtype={"u1": "u8", "u2": "u16", "f4": "f32"}[dtype],
                    ids=np.full(len(triangles), k) if exact == "all" else None,
                    attributes=attributes(source, len(triangles), 1) if exact == "all" else None,
                )
            )  # fmt: skip
    ball, shape = known_meshes()[1], known_meshes()[0]
    parts = [
        leapray.voxelize(v + 0.3 * k, t, 0.25, ids=np.full(len(t), k), kind="solid", threads=1)
        for k, (v, t) in enumerate((ball, shape))
    ]
    return [*made, leapray.merge(parts)]


@cache
def known_structures():
    """Every traverser over every volume that it takes."""
    made = []
    for entry in leapray.variants():
        for volume in known_volumes():
            if entry.rectilinear or volume.info.planes is None:
                made.append(leapray.build(volume, entry))
    return made


def attributes(s: Source, n: int, tame: float = 0.8):
    def some(shape):
        return np.abs(s.numbers(shape, tame)).clip(-9, 9).astype("f4") if s.mostly(0.9) else None

    textures = tuple(s.one(known_textures()) for _ in range(s.rng.integers(3)))
    colors, uvs = some((n, 3, 3)), some((n, 3, 2))
    offered = [leapray.WHITE, *[leapray.VERTEX] * (colors is not None)]
    offered += range(len(textures) if uvs is not None else 0)
    sources = s.rng.choice(offered if s.likely(tame) else range(-5, 5), n)
    return leapray.Attributes(some((n, 3, 3)), sources if s.mostly(0.9) else None, colors, uvs,
                              textures)  # fmt: skip


@cache
def known_textures():
    rng = np.random.default_rng(2)
    return [
        leapray.Texture(rng.random((h, w, 3)).astype("f4"), i, e)
        for h, w, i, e in ((1, 1, "linear", "repeat"), (3, 7, "closest", "clip"),
                           (16, 5, "linear", "mirror"), (2, 2, "cubic", "extend"))
    ]  # fmt: skip
