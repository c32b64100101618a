# SPDX-License-Identifier: GPL-3.0-or-later
"""A head of ellipsoids as a CT scanner would see it, so that the right answer is known.

    python blend_samples/head_phantom.py OUT.nii [--size 128] [--labels]

Every tissue is an ellipsoid whose values fade smoothly into its surroundings, as a scanner's do;
away from others, the value half way between two tissues lies on the ellipsoid. The field has no
edges: where ellipsoids meet their surface is rounded.
Written as a NIfTI file of 16-bit Hounsfield units, or of 8-bit labels, in millimetres, x to the
right, y to the front and z up (RAS).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

EXTENT = 256.0  # millimetres along each axis of the lattice, centred on the origin
BLUR = 1.5  # millimetres: a tissue fades into the next as 1 / (1 + exp(height / BLUR))
AIR, FAT, SOFT, BONE, ENAMEL = -1000.0, -80.0, 40.0, 1100.0, 2200.0  # Hounsfield units
SKIN_AT, BONE_AT = (AIR + SOFT) / 2, (SOFT + BONE) / 2  # where ellipsoids lie in the field


@dataclass(frozen=True)
class Tissue:
    """An ellipsoid in millimetres, turned about x by `tilt` degrees."""

    name: str
    label: int
    value: float
    center: tuple[float, float, float]
    radii: tuple[float, float, float]
    tilt: float = 0.0

    def height(self, x: NDArray, y: NDArray, z: NDArray) -> NDArray[np.float64]:
        """Above the surface, in millimetres along the shortest axis: the field that is exact."""
        c, s = np.cos(np.radians(self.tilt)), np.sin(np.radians(self.tilt))
        x, y, z = (p - q for p, q in zip((x, y, z), self.center, strict=True))
        y, z = c * y + s * z, c * z - s * y
        a, b, d = self.radii
        return (np.sqrt((x / a) ** 2 + (y / b) ** 2 + (z / d) ** 2) - 1) * min(self.radii)


def both(name, label, value, center, radii, tilt=0.0) -> list[Tissue]:
    """One on each side of the face."""
    x, y, z = center
    return [Tissue(name, label, value, (side * x, y, z), radii, tilt) for side in (1, -1)]


# In the order in which they replace each other.
TISSUES = (
    Tissue("neck", 1, SOFT, (0, -14, -90), (50, 52, 70)),
    Tissue("head", 1, SOFT, (0, 0, 18), (76, 97, 96)),
    Tissue("face", 1, SOFT, (0, 44, -28), (58, 54, 62)),
    Tissue("chin", 1, SOFT, (0, 72, -78), (24, 22, 16)),
    Tissue("lips", 1, SOFT, (0, 88, -49), (25, 13, 13)),
    Tissue("nose bridge", 1, SOFT, (0, 94, 2), (8, 14, 26), 18),
    Tissue("nose", 1, SOFT, (0, 104, -17), (14, 14, 12)),
    *both("ear", 1, SOFT, (77, -8, 0), (8, 18, 28), 12),
    Tissue("skull", 2, BONE, (0, -4, 24), (68, 87, 82)),
    Tissue("face bones", 2, BONE, (0, 46, -16), (48, 42, 40)),
    Tissue("lower jaw", 2, BONE, (0, 40, -64), (46, 44, 26), 8),
    Tissue("throat", 1, SOFT, (0, 16, -70), (36, 48, 44)),
    Tissue("brain", 3, SOFT, (0, -4, 27), (60, 79, 72)),
    *both("eye", 4, SOFT, (28, 72, 6), (18, 24, 17)),
    *both("sinus", 5, AIR, (24, 58, -24), (13, 14, 14)),
    Tissue("nasal cavity", 5, AIR, (0, 66, -18), (9, 28, 18)),
    Tissue("mouth", 1, SOFT, (0, 42, -48), (33, 32, 10)),
    *[
        Tissue("tooth", 6, ENAMEL, (33 * np.sin(t), 44 + 35 * np.cos(t), z), (4, 4, 8))
        for z in (-42.0, -55.0)
        for t in np.radians(np.linspace(-80, 80, 14))
    ],
    Tissue("spine", 2, BONE, (0, -30, -94), (20, 22, 62)),
    Tissue("spinal canal", 1, SOFT, (0, -32, -94), (9, 9, 62)),
)


def spacing(size: int) -> float:
    """Millimetres between samples of a lattice of size^3."""
    return EXTENT / size


def world_from_index(size: int) -> NDArray[np.float64]:
    """(4, 4): sample (i, j, k) to millimetres."""
    h = spacing(size)
    matrix = np.diag([h, h, h, 1.0])
    matrix[:3, 3] = h / 2 - EXTENT / 2
    return matrix


def values(x: NDArray, y: NDArray, z: NDArray) -> NDArray[np.float64]:
    """Hounsfield units at points in millimetres."""
    found = np.full(np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z)), AIR)
    for tissue in TISSUES:
        inside = 0.5 - 0.5 * np.tanh(tissue.height(x, y, z) / (2 * BLUR))
        found += inside * (tissue.value - found)
    return found


def labels(x: NDArray, y: NDArray, z: NDArray) -> NDArray[np.uint8]:
    """The label of the tissue at points in millimetres, 0 outside."""
    found = np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z)), np.uint8)
    for tissue in TISSUES:
        found[tissue.height(x, y, z) < 0] = tissue.label
    return found


def volume(size: int, of=values, dtype=np.int16) -> NDArray:
    """The lattice (z, y, x), a slab at a time."""
    at = (np.arange(size) + 0.5) * spacing(size) - EXTENT / 2
    made = np.empty((size, size, size), dtype)
    for k in range(0, size, 8):
        slab = of(at[None, None, :], at[None, :, None], at[k : k + 8, None, None])
        made[k : k + 8] = np.rint(slab) if of is values else slab
    return made


def write(path: Path, size: int, labelled: bool = False) -> None:
    """The phantom as a NIfTI file; needs nibabel."""
    import nibabel

    data = volume(size, labels, np.uint8) if labelled else volume(size)
    image = nibabel.Nifti1Image(data.T, world_from_index(size))
    image.header.set_xyzt_units("mm")
    if labelled:
        image.header.set_intent("label", name="tissues")
    nibabel.save(image, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("--size", type=int, default=128, help="samples along each axis")
    parser.add_argument("--labels", action="store_true", help="labels in place of values")
    asked = parser.parse_args()
    write(asked.output, asked.size, asked.labels)


if __name__ == "__main__":
    main()
