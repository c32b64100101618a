# SPDX-License-Identifier: GPL-3.0-or-later
"""The renderer's closures, lights and surroundings as numpy functions.

They are compiled from the core's own files and tests/c/shading.c, since no
public function leads to them.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

import build_core
from leapray import rendering

ROOT = Path(__file__).resolve().parent.parent
SOURCES = (
    "base/error",
    "grid/attributes/shader_program",
    "grid/attributes/texture",
    "render/bsdf/albedo_glass",
    "render/bsdf/albedo_reflection",
    "render/bsdf/bsdf",
    "render/bsdf/gradient_shading",
    "render/bsdf/material",
    "render/bsdf/phase",
    "render/bsdf/shading_frame",
    "render/lights/area",
    "render/lights/environment",
    "render/lights/light",
    "render/lights/light_fields",
    "render/lights/light_tree",
    "render/lights/point",
    "render/lights/spot",
    "render/lights/sun",
)
KINDS = {"diffuse": 1, "glossy": 2, "transmission": 3, "transparent": 4}

# lr_point, lr_scatter, lr_response and lr_light_ray
POINT = np.dtype(
    {
        "names": ["view", "normal", "facing", "bends", "color", "eta", "inside"],
        "formats": ["3f8", "3f8", "3f8", "?", "3f8", "f8", "?"],
    },
    align=True,
)
SCATTER = np.dtype(
    [("direction", "3f8"), ("weight", "3f8"), ("pdf", "f8"), ("kind", "i4"), ("delta", "?")],
    align=True,
)
RESPONSE = np.dtype([("f_cos", "3f8"), ("pdf", "f8")])
RAY = np.dtype(
    [("direction", "3f8"), ("distance", "f8"), ("color", "3f8"), ("pdf", "f8"), ("delta", "?")],
    align=True,
)


@cache
def library() -> ctypes.CDLL:
    """The compiled functions."""
    folder = tempfile.mkdtemp()
    compiled = Path(folder, "shading.so")
    sources = [ROOT / "native" / "src" / f"{name}.c" for name in SOURCES]
    sources += [ROOT / "tests" / "c" / "shading.c"]
    flags = ["-std=c17", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno"]
    flags += [f"-I{ROOT / 'native' / part}" for part in ("include", "src")]
    command = [sys.executable, "-m", "ziglang", "cc", *build_core.TARGET, *flags]
    subprocess.run([*command, *map(str, sources), "-lm", "-o", str(compiled)], check=True)
    return ctypes.CDLL(str(compiled))


def _address(array):
    return ctypes.c_void_p(array.ctypes.data)


def _call(name, *args):
    return getattr(library(), name)(*args)


class Surface:
    """A material at a point of the plane z = 0, seen from `view` (3,), above."""

    def __init__(self, material, view, *, inside=False, eta=0.0, color=(1, 1, 1), normal=(0, 0, 1)):
        lobes = rendering._lobes([material])
        self._kept = lobes, rendering._materials([material], lobes)
        self._desc = _address(self._kept[1])
        self._point = np.zeros(1, POINT)
        view = np.array(view, float) / np.linalg.norm(view)
        for name, value in dict(
            view=view, normal=normal, facing=normal, color=color, eta=eta, inside=inside
        ).items():
            self._point[name] = value

    def flags(self):
        return _call("shading_flags", self._desc)

    def look(self):
        """albedo (6,), emission (3,), transparency (3,)."""
        out = np.zeros(6), np.zeros(3), np.zeros(3)
        _call("shading_look", self._desc, _address(self._point), *map(_address, out))
        return out

    def sample(self, kind, u):
        """Scattered rays for u (n, 3); pdf 0 where the light is lost."""
        u = np.ascontiguousarray(u, float)
        out = np.zeros(len(u), SCATTER)
        _call("shading_sample", self._desc, _address(self._point), KINDS[kind],
              ctypes.c_int64(len(u)), _address(u), _address(out))  # fmt: skip
        return out

    def eval(self, light):
        """Responses (n, 3 groups) to light from (n, 3)."""
        light = np.ascontiguousarray(light, float)
        out = np.zeros((len(light), 3), RESPONSE)
        _call("shading_eval", self._desc, _address(self._point), ctypes.c_int64(len(light)),
              _address(light), _address(out))  # fmt: skip
        return out


class Phase:
    """A phase function at a point that is seen from `view` (3,)."""

    def __init__(self, kind, g, view):
        view = np.array(view, float) / np.linalg.norm(view)
        self._view = view
        self._told = ctypes.c_int32(kind), ctypes.c_double(g), _address(view)

    def sample(self, u):
        """Scattered rays for u (n, 2)."""
        return self._call("shading_phase_sample", u, SCATTER)

    def eval(self, light):
        """Responses to light from (n, 3)."""
        return self._call("shading_phase_eval", light, RESPONSE)

    def _call(self, name, values, dtype):
        values = np.ascontiguousarray(values, float)
        out = np.zeros(len(values), dtype)
        _call(name, *self._told, ctypes.c_int64(len(values)), _address(values), _address(out))
        return out


class Hybrid(Phase):
    """A share of a surface whose normal is +z, of that colour, beside a phase function."""

    def __init__(self, kind, g, view, share, color, roughness, specular):
        super().__init__(kind, g, view)
        self._numbers = np.array([share, roughness, specular, *color], float)
        self._told = (*self._told, _address(self._numbers))

    def sample(self, u):
        """Scattered rays for u (n, 3); pdf 0 where the light is lost."""
        return self._call("shading_hybrid_sample", u, SCATTER)

    def eval(self, light):
        """Responses to light from (n, 3)."""
        return self._call("shading_hybrid_eval", light, RESPONSE)


def sample_light(light, p, u):
    """Rays from p (3,) to a leapray.Light for u (n, 2); pdf 0 where there is none."""
    return _light("shading_light_sample", light, p, u)


def hit_light(light, o, d):
    """What rays from o (3,) along d (n, 3) see of a leapray.Light; pdf 0 where they miss."""
    return _light("shading_light_hit", light, o, d)


def choose_lights(lights, p, normal, u, world=0.0):
    """For u (n,) lights (-1: none), their probabilities, and those of all, the world's last."""
    table = rendering._lights(lights)
    p, normal, u = (np.ascontiguousarray(x, float) for x in (p, normal, u))
    light_index, probability = np.zeros(len(u), np.int64), np.zeros(len(u))
    probability_of = np.zeros(len(lights) + (world > 0))
    assert _call("shading_lights", _address(table), ctypes.c_int64(len(lights)),
                 ctypes.c_double(world), _address(p), _address(normal), ctypes.c_int64(len(u)),
                 *map(_address, (u, light_index, probability, probability_of)))  # fmt: skip
    return light_index, probability, probability_of


def walk_lights(lights, o, d, t_max=np.inf):
    """(n, lights): how often rays from o along d (n, 3) come to each light's box."""
    table = rendering._lights(lights)
    o, d = np.ascontiguousarray(o, float), np.ascontiguousarray(d, float)
    met = np.zeros((len(d), len(lights)), np.uint8)
    assert _call("shading_light_walk", _address(table), ctypes.c_int64(len(lights)), _address(o),
                 ctypes.c_int64(len(d)), _address(d), ctypes.c_double(t_max),
                 _address(met))  # fmt: skip
    return met


def _light(name, light, at, values):
    table = rendering._lights([light])
    at, values = np.array(at, float), np.ascontiguousarray(values, float)
    out = np.zeros(len(values), RAY)
    _call(name, _address(table), _address(at), ctypes.c_int64(len(values)), _address(values),
          _address(out))  # fmt: skip
    return out


def sample_world(world, u):
    """Directions of a leapray.World for u (n, 2); pdf 0 where there is none."""
    return _world(world, np.ascontiguousarray(u, float), np.zeros(len(u), RAY))


def look_at_world(world, d):
    """Radiance and density of directions d (n, 3)."""
    rays = np.zeros(len(d), RAY)
    rays["direction"] = d
    return _world(world, None, rays)


def _world(world, u, rays):
    desc, texture = rendering._world(world)
    where = None if u is None else _address(u)
    assert _call("shading_environment", ctypes.byref(desc), ctypes.c_int64(len(rays)), where,
                 _address(rays))  # fmt: skip
    del texture
    return rays


def r_sequence(n, dimensions):
    """n points of the R sequence in the unit cube (Roberts 2018)."""
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (dimensions + 1))
    return (0.5 + np.arange(1, n + 1)[:, None] * root ** -np.arange(1.0, dimensions + 1)) % 1


def sphere_grid(n):
    """Directions (2 n^2, 3) that cover the sphere evenly, and the solid angle of each."""
    z, phi = np.meshgrid((np.arange(n) + 0.5) / n * 2 - 1, (np.arange(2 * n) + 0.5) * np.pi / n)
    r = np.sqrt(1 - z * z)
    d = np.stack([r * np.cos(phi), r * np.sin(phi), z], -1).reshape(-1, 3)
    return d, 4 * np.pi / len(d)
