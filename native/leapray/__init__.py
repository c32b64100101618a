# SPDX-License-Identifier: GPL-3.0-or-later
"""LeapRay's core: rays through sampled volumes, numpy in and numpy out."""

from ._abi import LR_VERSION as __version__
from ._lib import LeapRayError, OutOfMemory, Stopped, Watch
from .attributes import VERTEX, WHITE, Attributes, Texture
from .imaging import SKIPS, Clearance, FirstCells, first_cells
from .rendering import PASSES, Camera, Instance, Light, Lobe, Material, Scene, World
from .tracing import (
    HIT_TESTS,
    METRICS,
    MODES,
    NORMALS,
    ROOTS,
    Hits,
    Option,
    Structure,
    Traverser,
    add_counters,
    build,
    distance,
    trace,
    trace_options,
    traverser,
    traversers,
    variants,
)
from .volume import Volume, VolumeBuilder, VolumeInfo
from .voxelization import MeshInfo, mesh_layers, voxelize

__all__ = [
    "HIT_TESTS",
    "METRICS",
    "MODES",
    "NORMALS",
    "PASSES",
    "ROOTS",
    "SKIPS",
    "VERTEX",
    "WHITE",
    "Attributes",
    "Camera",
    "Clearance",
    "FirstCells",
    "Hits",
    "Instance",
    "LeapRayError",
    "Light",
    "Lobe",
    "Material",
    "MeshInfo",
    "Option",
    "OutOfMemory",
    "Scene",
    "Stopped",
    "Structure",
    "Texture",
    "Traverser",
    "Volume",
    "VolumeBuilder",
    "VolumeInfo",
    "Watch",
    "World",
    "__version__",
    "add_counters",
    "build",
    "distance",
    "first_cells",
    "mesh_layers",
    "trace",
    "trace_options",
    "traverser",
    "traversers",
    "variants",
    "voxelize",
]
