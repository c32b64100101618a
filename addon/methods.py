# SPDX-License-Identifier: GPL-3.0-or-later
"""How a picture is made: by rays, by one of the core's whole-image methods, or as a projection of
the values of volumes (no bpy)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import leapray

from .descriptions import Choice, sentence


@dataclass(frozen=True)
class Method:
    """An entry of the menu of render methods."""

    spec: str  # as in files and on the command line
    label: str
    about: str  # a sentence
    image: leapray.ImageMethod | None = None  # the core's, of which it is one
    mode: str = ""  # of leapray.trace, of a projection
    by_depth: bool = False  # a projection that shows by hues how far away the value lies

    @property
    def exact(self) -> bool:
        """Whether it shows what a ray through each pixel's centre meets."""
        return self.image is None or self.image.exact


RAYS = Method("rays", "Rays", "Traces paths of light, with materials, lights and several samples")
PROJECTIONS = (
    Method(
        "maximum",
        "Maximum",
        "Shows the greatest value of volume data along each ray, without light",
        mode="maximum",
    ),
    Method(
        "minimum",
        "Minimum",
        "Shows the least value of volume data along each ray, without light",
        mode="minimum",
    ),
    Method(
        "mean",
        "Mean (X-ray)",
        "Shows the mean of volume data along each ray, as an X-ray picture does, without light",
        mode="mean",
    ),
    Method(
        "maximum_depth",
        "Depth-coded Maximum (maximum_depth)",
        "Shows the greatest value of volume data along each ray by its brightness, and by its hue "
        "how far away it lies: red near by, then yellow, green and blue",
        mode="maximum",
        by_depth=True,
    ),
)


def _of_image(entry: leapray.ImageMethod) -> Method:
    """The entry of one of the core's, called as in charts, and as on the command line."""
    views = "" if entry.perspective else ", by orthographic cameras alone"
    about = f"{sentence(entry.about)} ({entry.source}){views}"
    return Method(entry.spec, f"{entry.label} ({entry.spec})", about, image=entry)


def find(spec: str) -> Method:
    """The render method of that name, of the core's methods with options, as "name:option=choice".

    Raises LeapRayError that lists what there is.
    """
    name = spec.partition(":")[0]
    if name in {entry.name for entry in leapray.image_methods()}:
        return _of_image(leapray.image_method(spec))
    known = {method.spec: method for method in (RAYS, *PROJECTIONS)}
    if spec not in known:
        names = [RAYS.spec, *(e.name for e in leapray.image_methods())]
        names += [method.spec for method in PROJECTIONS]
        raise leapray.LeapRayError(f"unknown render method {spec!r}; there are {', '.join(names)}")
    return known[spec]


def choices() -> Iterator[Choice]:
    """All of them, below what they show."""
    yield Choice("", "Light", "Materials, lights, shadows and reflections")
    yield _choice(RAYS)
    for exact, heading, promise in (
        (True, "First Cells", "The first cells of surfaces, shaded by depth"),
        (False, "First Cells, Inexact", "Likewise, by methods that may show neighbouring cells"),
    ):
        yield Choice("", heading, promise)
        for entry in leapray.image_variants():
            if entry.exact == exact:
                yield _choice(_of_image(entry))
    yield Choice("", "Projections", "Values of volume data, without surfaces")
    for method in PROJECTIONS:
        yield _choice(method)


def _choice(method: Method) -> Choice:
    return Choice(method.spec, method.label, method.about)
