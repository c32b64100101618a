# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes of labels: which a file has, which materials they wear, which make a solid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

import leapray
from leapray import LeapRayError
from leapray.label_volume import MOST
from leapray.scalar_grid import ScalarGrid

from ... import arrays, model
from ...descriptions import WHOLE_MAX, described
from ...plan import field_filters
from ...settings import Isosurfaces

UNUSED = "interpolation", "least", "invert", "capped"  # settings that mean nothing to labels
MOST_CLEAR = 256  # solids of see-through labels; what is beyond shares the last one
MOST_KNOWN = 64  # lists of numbers that are kept for later frames
TINTED = "diffuse", "glossy", "glass", "refraction", "principled"  # lobes

_numbers: dict[str, tuple[int, ...]] = {}  # by contents


def are_shown(grid: ScalarGrid, own: Isosurfaces) -> bool:
    """Whether a volume's data are to be rendered as labels."""
    return own.shown == "labels" or (own.shown == "auto" and grid.kind == "labels")


def read(
    grid: ScalarGrid,
    contents: str,
    name: str,
    own: Isosurfaces,
    notes,
    heard: Callable[[Callable[[leapray.Watch], tuple]], tuple],
) -> tuple[ScalarGrid, model.Labels]:
    """The grid as an array of labels, and which there are.

    notes are told of settings that do nothing. heard runs what takes long, so that it can be
    stopped. Raises LeapRayError for numbers that are no labels, and for more labels than ids can
    hold; Stopped.
    """
    grid = replace(field_filters.dense(grid), kind="labels")
    if contents not in _numbers:
        while len(_numbers) >= MOST_KNOWN:
            _numbers.pop(next(iter(_numbers)))
        _numbers[contents] = heard(
            lambda watch: tuple(leapray.label_numbers(grid, watch=watch).tolist())
        )
    numbers = _numbers[contents]
    if not numbers:
        raise LeapRayError("its data have no labels, but 0 alone")
    if len(numbers) > MOST + 1:
        raise LeapRayError(f"its data have {len(numbers)} labels; ids hold {MOST + 1}")
    settings = described(Isosurfaces)
    idle = [settings[k].label for k in UNUSED if getattr(own, k) not in ("", settings[k].default)]
    if idle:
        what = f"shows labels, for which {', '.join(idle)} {'do' if idle[1:] else 'does'} nothing"
        notes.missing("Volume object", name, what)
    return grid, model.Labels(numbers)


def materials(
    base: model.Material, grid: ScalarGrid, numbers: Sequence[int]
) -> list[model.Material]:
    """One for each label: a material in the label's colour, with the label as its pass index."""
    return [_tinted(base, grid, number) for number in numbers]


def _tinted(base: model.Material, grid: ScalarGrid, number: int) -> model.Material:
    color = color_of(grid, number)
    lobes = tuple(
        replace(lobe, color=color, textured=False) if lobe.kind in TINTED else lobe
        for lobe in base.lobes
    )
    name = grid.label_names.get(number, f"{base.name or 'Label'} {number}")
    index = min(number, WHOLE_MAX)
    return replace(
        base, name=name, lobes=lobes, index=index, color_source="", attribute="", image=None
    )


def color_of(grid: ScalarGrid, number: int) -> model.Color:
    """Linear RGB of a label: the file's, else one of the table."""
    if number in grid.label_colors:
        srgb = np.clip(grid.label_colors[number], 0.0, 1.0).astype(np.float32)
        red, green, blue = arrays.from_srgb(srgb).tolist()
        return red, green, blue
    return of_table(number)


# The n-th multiple of this share of a turn lies far from the ones before, also of every third.
TURN = 0.7548776662466927  # 1 / the plastic number
LIGHTNESS, CHROMA, FIRST_HUE = (0.7, 0.55, 0.85), 0.16, 0.08


def of_table(number: int) -> model.Color:
    """A colour that differs from those of the numbers near.

    Source: Ottosson 2020, Oklab; hues by Roberts' additive recurrence.
    """
    hue = 2 * np.pi * ((number * TURN + FIRST_HUE) % 1.0)
    light, a, b = LIGHTNESS[number % 3], CHROMA * np.cos(hue), CHROMA * np.sin(hue)
    cone = np.array([[1, 0.3963377774, 0.2158037573], [1, -0.1055613458, -0.0638541728],
                     [1, -0.0894841775, -1.2914855480]]) @ (light, a, b)  # fmt: skip
    rgb = np.array([[4.0767416621, -3.3077115913, 0.2309699292],
                    [-1.2684380046, 2.6097574011, -0.3413193965],
                    [-0.0041960863, -0.7034186147, 1.7076147010]]) @ cone**3  # fmt: skip
    red, green, blue = rgb.clip(0.0, 1.0).tolist()
    return red, green, blue


def bodies(slots: Sequence[int], worn: Sequence[model.Material]) -> tuple[tuple[int, ...], ...]:
    """Ids of the labels that make each solid.

    slots: the index of each label's material in worn. Opaque labels share the last solid, which
    light cannot pass where they touch; of the others those of one material make one.
    """
    clear = dict.fromkeys(at for at in slots if worn[at].is_clear)
    solid_of = {at: min(n, MOST_CLEAR - 1) for n, at in enumerate(clear)}
    made: list[list[int]] = [[] for _ in range(MOST_CLEAR + 1)]
    for label, at in enumerate(slots):
        made[solid_of.get(at, MOST_CLEAR)].append(label)
    return tuple(tuple(each) for each in made if each)
