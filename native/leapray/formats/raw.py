# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain numbers, whose layout stands in a .json file beside them, in the name, or is given.

The .json file has the members of RawLayout: {"size": [256, 256, 128], "dtype": "uint16",
"spacing": [0.5, 0.5, 1]}. A name says it as in head_256x256x128_uint16.raw.
"""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ..scalar_grid import KINDS, ScalarGrid
from .common import (
    Format,
    RawLayout,
    Request,
    check_matrix,
    check_samples,
    choose_frame,
    one_grid,
    only_grid,
    reading,
    refuse,
    scaled,
    stem,
)

NAME = re.compile(r"(\d+)x(\d+)x(\d+)_(u?int(?:8|16|32|64)|float(?:16|32|64))(?![0-9a-z])", re.I)
MOST = 2**40  # samples of a layout, beyond which a number is a mistake


def read(request: Request) -> ScalarGrid:
    path = request.path
    with reading(path, "raw numbers"):
        only_grid(request, stem(path))
        layout = request.layout or _layout_beside(path) or _layout_of_name(path)
        if layout is None:
            raise refuse(
                path,
                f"its layout is unknown; put it into {path.with_suffix('.json').name}, into the "
                "name, as in name_256x256x128_uint16.raw, or pass a RawLayout",
            )
        dtype = _check(path, layout)
        told: list[str] = []
        frame = choose_frame(request, layout.frames, told)
        nbytes = int(np.prod(layout.size, dtype=np.int64)) * dtype.itemsize
        wanted, came = layout.header + layout.frames * nbytes, path.stat().st_size
        if came != wanted:
            raise refuse(path, f"its layout takes {wanted} bytes, and the file has {came}")
        offset = layout.header + frame * nbytes
        samples = np.memmap(path, dtype, "r", offset, layout.size[::-1])
        matrix = scaled(np.eye(4), layout.spacing)
        matrix[:3, 3] = layout.origin
        return ScalarGrid(
            stem(path),
            check_samples(path, samples),
            check_matrix(path, matrix),
            scale=layout.scale,
            offset=layout.offset,
            kind=layout.kind,
            meters=layout.meters,
            quantity=layout.quantity,
            no_data=layout.no_data,
            source=str(path),
            files=tuple(map(str, _beside(path))),
            warnings=tuple(told),
        )


def _check(path: Path, layout: RawLayout) -> np.dtype:
    """The layout's type of numbers. Raises LeapRayError where a member has no meaning."""
    try:
        dtype = np.dtype(layout.dtype)
    except TypeError:
        raise refuse(path, f"{layout.dtype!r} is no type of numbers, as 'uint16' is") from None
    if dtype.kind not in "iuf":
        raise refuse(path, f"samples of the type {dtype} are no real numbers")
    whole = (*layout.size, layout.frames, layout.header)
    if len(layout.size) != 3 or not all(isinstance(n, (int, np.integer)) for n in whole):
        raise refuse(path, "its layout needs a size of three whole numbers")
    if min(whole[:4]) < 1 or layout.header < 0 or np.prod(whole[:4], dtype=np.float64) > MOST:
        raise refuse(path, f"its layout's size {layout.size} makes no volume")
    if layout.kind not in KINDS:
        raise refuse(path, f"unknown kind {layout.kind!r}; there are {', '.join(KINDS)}")
    numbers = [layout.scale, layout.offset, *layout.spacing, *layout.origin]
    if len(numbers) != 8 or not np.isfinite(numbers).all() or layout.scale == 0:
        raise refuse(path, "its layout's spacing, origin, scale or offset are no such numbers")
    return dtype.newbyteorder(">" if layout.big_endian else "<")


def _layout_beside(path: Path) -> RawLayout | None:
    """What a .json file beside it says, if there is one; one without size and dtype may be
    anything."""
    for file in _beside(path):
        if file.is_file():
            try:
                told = json.loads(file.read_text(encoding="utf-8"))
            except ValueError as error:
                raise refuse(file, f"it is no JSON: {error}") from None
            if not isinstance(told, dict) or {"size", "dtype"} & told.keys():
                return _layout_of(file, told)
    return None


def _layout_of(found: Path, told: Any) -> RawLayout:
    """What is told by a .json file."""
    known = [field.name for field in fields(RawLayout)]
    if not isinstance(told, dict) or not {"size", "dtype"} <= told.keys():
        raise refuse(found, "it needs the members size and dtype")
    unknown = sorted(told.keys() - set(known))
    if unknown:
        raise refuse(found, f"unknown member {unknown[0]!r}; there are {', '.join(known)}")
    try:
        lists = {key: tuple(told[key]) for key in ("size", "spacing", "origin") if key in told}
    except TypeError:
        raise refuse(found, "size, spacing and origin are lists of three numbers") from None
    return RawLayout(**{**told, **lists})


def _beside(path: Path) -> list[Path]:
    """Where the layout may stand."""
    return [path.with_name(path.name + ".json"), path.with_suffix(".json")]


def _layout_of_name(path: Path) -> RawLayout | None:
    found = NAME.search(path.name)
    if not found:
        return None
    nx, ny, nz = map(int, found.groups()[:3])
    return RawLayout((nx, ny, nz), found[4].lower())


FORMAT = Format("raw numbers", (".raw",), read, one_grid, lambda head: False)
