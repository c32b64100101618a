# SPDX-License-Identifier: GPL-3.0-or-later
"""Area lights in surfaces, and nearer to them than these are modelled exactly."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import scenes

from addon import model, pipeline
from addon.plan import light_planes

OFF = 1e-3  # what the surfaces may be off


def square(size=1.0, z=0.0, x=0.0, hole=0.0):
    """A horizontal square, or four around a square hole."""
    if hole:
        beside, at = (size - hole) / 2, (size + hole) / 4
        parts = [(beside, size, -at, 0), (beside, size, at, 0), (hole, beside, 0, -at),
                 (hole, beside, 0, at)]  # fmt: skip
    else:
        parts = [(size, size, x, 0)]
    corners, triangles = [], []
    for width, depth, cx, cy in parts:
        n = len(corners)
        corners += [(cx + sx * width / 2, cy + sy * depth / 2, z)
                    for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]  # fmt: skip
        triangles += [(n, n + 1, n + 2), (n, n + 2, n + 3)]
    return model.Mesh("square", np.float32(corners), np.int32(triangles))


def area_light(**changes):
    """An area light at the origin that points down."""
    light = model.Light("area", (5.0, 5.0, 5.0), direction=(0, 0, -1), name="Area",
                        axis_u=(0.6, 0, 0), axis_v=(0, 0.4, 0), angle=math.pi,
                        shape="rectangle")  # fmt: skip
    return dataclasses.replace(light, **changes)


def placed(mesh, matrix=None, accuracy=OFF):
    return light_planes.Surface("Panel", mesh, np.eye(4) if matrix is None else matrix, accuracy)


def turned(angle, z=0.0):
    matrix = np.eye(4)
    matrix[:3, :3] = [
        (math.cos(angle), 0, math.sin(angle)),
        (0, 1, 0),
        (-math.sin(angle), 0, math.cos(angle)),
    ]
    matrix[2, 3] = z
    return matrix


BESIDE = {  # surfaces, the sign of the margin, whether it is told
    "in its plane": ([placed(square())], 1, True),
    "in its plane but for f32": ([placed(square(z=3e-9))], 1, True),
    "before it": ([placed(square(z=-OFF / 2))], 1, False),
    "behind it": ([placed(square(z=OFF / 2))], -1, False),
    "far before it": ([placed(square(z=-3 * OFF))], 0, False),
    "far behind it": ([placed(square(z=3 * OFF))], 0, False),
    "beside it": ([placed(square(x=1.0))], 0, False),
    "touching its side": ([placed(square(x=0.8))], 0, False),
    "over a corner": ([placed(square(x=0.75))], 1, True),
    "around it": ([placed(square(hole=0.6))], 0, False),
    "around a part of it": ([placed(square(hole=0.5))], 1, True),
    "far larger": ([placed(square(size=1e3))], 1, True),
    "far smaller": ([placed(square(size=1e-2, x=0.1))], 1, True),
    "across it": ([placed(square(), turned(math.pi / 2))], 0, False),
    "through it": ([placed(square(), turned(0.1))], 0, False),
    "turned by less than it is off": ([placed(square(), turned(OFF / 2))], 1, False),
    "scaled into it": ([placed(square(z=1.0), np.diag([9, 9, 1e-9, 1]))], 1, True),
    "exact and just behind": ([placed(square(z=1e-5), accuracy=0.0)], 0, False),
    "exact and in its plane": ([placed(square(), accuracy=0.0)], 1, True),
    "several": ([placed(square(z=OFF / 2)), placed(square(x=5.0)), placed(square())], 1, True),
    "none": ([], 0, False),
}


@pytest.mark.parametrize("name", BESIDE)
def test_the_mesh_tells_on_which_side_of_a_light_it_lies(name):
    surfaces, sign, told = BESIDE[name]
    for matrix in (np.eye(4), turned(2.0, 7.0) @ np.diag([3.0, 3, 3, 1])):
        warnings: list[str] = []
        turn = matrix[:3, :3] / 3 if matrix[2, 3] else matrix[:3, :3]
        light = area_light(
            position=tuple(matrix[:3, 3]),
            direction=tuple(turn @ (0, 0, -1)),
            axis_u=tuple(matrix[:3, :3] @ (0.6, 0, 0)),
            axis_v=tuple(matrix[:3, :3] @ (0, 0.4, 0)),
        )
        moved = [
            light_planes.Surface(s.name, s.mesh, matrix @ s.world_from_object, s.accuracy * scale)
            for s in surfaces
            for scale in (3 if matrix[2, 3] else 1,)
        ]
        (found,) = light_planes.with_margins([light], moved, warnings)
        assert np.sign(found.plane_margin) == sign
        assert abs(found.plane_margin) < 4 * OFF
        assert bool(warnings) == told
        assert all("'Area' lies in the very plane of 'Panel'" in each for each in warnings)
        assert dataclasses.replace(found, plane_margin=0.0) == light


def test_lights_that_nothing_stops_and_other_lights_stay():
    lights = [area_light(casts_shadow=False), area_light(kind="point", shape="sphere", radius=0.5)]
    assert light_planes.with_margins(lights, [placed(square())], []) == tuple(lights)


def picture(distance, size, shape, solid):
    """The mean light of a floor under a panel, which lies so far behind a light of z = 1.37."""
    panel = scenes.box((0.5, 0.5, 0.5)) if solid else square(0.8)
    z = 1.37 + distance + (0.25 if solid else 0)
    view = scenes.camera(eye=(2.2, -3, 1.0), target=(0, 0, 0.3), width=size, height=size)
    light = area_light(position=(0, 0, 1.37), axis_u=(0.3, 0, 0), axis_v=(0, 0.3, 0), shape=shape)
    made = scenes.scene(
        [square(3.0), panel],
        [scenes.place(0, object_index=1), scenes.place(1, at=(0.03, 0.02, z), object_index=2)],
        view=view, width=size, height=size, lights=(light,), samples=8,
    )  # fmt: skip
    frame = pipeline.render(dataclasses.replace(made, world=model.World()))
    light = frame.passes["Combined"][..., :3].mean(-1)
    floor = frame.passes["Object Index"][..., 0] == 1
    return light[floor].mean(), light[frame.passes["Object Index"][..., 0] == 2].max(initial=0.0)


@pytest.mark.parametrize("solid", [False, True])
@pytest.mark.parametrize("shape", ["rectangle", "ellipse"])
def test_a_surface_hides_the_light_in_its_plane_at_every_size(shape, solid):
    for size in (24, 110):
        for distance in (-1e-3, -1e-5, 0.0):
            floor, panel = picture(distance, size, shape, solid)
            assert floor == panel == 0
    shining = [picture(1e-5, size, shape, solid)[0] for size in (24, 110)]
    assert shining[0] > 0.01
    assert shining[0] == pytest.approx(picture(0.5, 24, shape, solid)[0], rel=2e-3)
    assert shining[1] == pytest.approx(picture(0.5, 110, shape, solid)[0], rel=2e-3)
