# SPDX-License-Identifier: GPL-3.0-or-later
"""Two hundred broken meshes: each gives a picture or a sentence, no crash, no hang, no NaN."""

import time

import meshes
import numpy as np
import pytest
import scenes

import leapray
from addon import model, pipeline
from addon.plan import objects
from leapray import LeapRayError
from leapray.voxelization import voxelize

BASES = {
    "ball": meshes.icosphere(1),
    "box": meshes.box(),
    "plane": meshes.plane(4, tilt=0.4),
    "leaf": meshes.leaf(6),
    "spiky": meshes.spiky(11, levels=1),
    "torus": meshes.torus(12, 8),
}


def some(rng, n, fraction):
    return rng.permutation(n)[: max(1, int(fraction * n))]


def open_up(rng, v, t):
    return v, np.delete(t, some(rng, len(t), 0.3), axis=0)


def pierce(rng, v, t):
    return v, np.delete(t, some(rng, len(t), 0.02), axis=0)


def grow_fins(rng, v, t):
    """More than two triangles share an edge."""
    edges = t[some(rng, len(t), 0.3), :2]
    tips = v[edges].mean(axis=1) + rng.normal(scale=0.3, size=(len(edges), 3))
    fins = np.column_stack([edges, np.arange(len(edges)) + len(v)])
    return np.concatenate([v, tips]), np.concatenate([t, fins])


def cross(rng, v, t):
    return meshes.joined((v, t), (v + 0.3 * rng.normal(size=3) * np.ptp(v, axis=0), t))


def invert(rng, v, t):
    return v, t[:, ::-1]


def flip(rng, v, t):
    t = t.copy()
    turned = some(rng, len(t), 0.2)
    t[turned] = t[turned, ::-1]
    return v, t


def double(rng, v, t):
    again = t[some(rng, len(t), 0.5)]
    return v, np.concatenate([t, again, again[::2, ::-1]])


def scatter(rng, v, t):
    """Many shells."""
    copies = [(0.3 * v + rng.uniform(-1, 1, 3) * np.ptp(v, axis=0), t) for _ in range(12)]
    return meshes.joined((v, t), *copies)


def collapse(rng, v, t):
    """Triangles that use a vertex twice, and some on one line."""
    t = t.copy()
    t[some(rng, len(t), 0.2), 2] = t[0, 0]
    return v, np.concatenate([t, t[:3, [0, 0, 1]], t[:3, [1, 1, 1]]])


def merge_places(rng, v, t):
    """Triangles without area between vertices at one place."""
    v = v.copy()
    moved = some(rng, len(v), 0.3)
    v[moved] = v[np.roll(moved, 1)]
    return v, t


def squeeze(rng, v, t):
    """Slivers."""
    axes = rng.permutation(3)
    return v * np.array([1.0, 1e-3, 10.0])[axes], t


def flatten(rng, v, t):
    return v * [1.0, 1.0, 0.0], t


def poison(rng, v, t):
    v = v.copy()
    v[rng.integers(len(v)), rng.integers(3)] = np.nan
    return v, t


def explode(rng, v, t):
    v = v.copy()
    v[rng.integers(len(v))] = rng.choice([np.inf, -np.inf, 1e300, 1e30])
    return v, t


def stray(rng, v, t):
    v = v.copy()
    v[rng.integers(len(v))] += 300 * rng.normal(size=3)
    return v, t


def shuffle(rng, v, t):
    """A soup: every corner its own vertex, all in disorder."""
    return v[t].reshape(-1, 3), rng.permutation(3 * len(t)).reshape(-1, 3)


def shake(rng, v, t):
    return v + rng.normal(scale=0.3, size=v.shape) * np.ptp(v, axis=0), t


def shrink(rng, v, t):
    return v * 1e-6, t


def blow_up(rng, v, t):
    return v * 1e6, t


def carry_off(rng, v, t):
    return v + 1e6 * rng.normal(size=3), t


def misname(rng, v, t):
    t = t.copy()
    t[rng.integers(len(t)), rng.integers(3)] = rng.choice([-1, len(v), 2**31 - 1])
    return v, t


DEFECTS = [
    *(open_up, pierce, grow_fins, cross, invert, flip, double, scatter, collapse, merge_places),
    *(squeeze, flatten, poison, explode, stray, shuffle, shake, shrink, blow_up, carry_off),
    misname,
]
ALONE = [(base, (defect,)) for defect in DEFECTS for base in ("ball", "plane", "torus")]
N = 200


def mixed(seed):
    rng = np.random.default_rng([7, seed])
    base = list(BASES)[rng.integers(len(BASES))]
    chosen = [DEFECTS[i] for i in rng.permutation(len(DEFECTS))[: rng.integers(2, 6)]]
    return base, tuple(sorted(chosen, key=lambda defect: defect is misname))  # others read names


RECIPES = [*ALONE, *(mixed(seed) for seed in range(N - len(ALONE)))]


def broken(i):
    base, defects = RECIPES[i]
    rng = np.random.default_rng([8, i])
    vertices, triangles = BASES[base]
    for defect in defects:
        with np.errstate(all="ignore"):
            vertices, triangles = defect(rng, vertices, triangles)
    return np.asarray(vertices, np.float64), np.asarray(triangles)


def names(i):
    base, defects = RECIPES[i]
    return "-".join([str(i), base, *(defect.__name__ for defect in defects)])


def trace(volume, rng):
    """Rays from around through the volume's box; everything that comes back is checked."""
    corners = (
        volume.info.object_from_index[:3, 3],
        np.array(volume.info.size) * (volume.info.object_from_index[0, 0]),
    )
    middle, radius = corners[0] + corners[1] / 2, np.linalg.norm(corners[1])
    start = rng.normal(size=(200, 3))
    start *= radius / np.linalg.norm(start, axis=1, keepdims=True)
    aim = rng.uniform(-0.2, 0.2, (200, 3)) * corners[1]
    hits = leapray.trace(leapray.build(volume), middle + start, aim - start)
    hit = np.isfinite(hits.t)
    assert not np.isnan(hits.t).any() and (hits.t >= 0).all()
    normal = np.asarray(hits.normal)[hit]
    assert np.isfinite(normal).all()
    if hit.any():
        length = np.linalg.norm(normal, axis=1)
        assert np.abs(length - 1).max() < 1e-3
    return hit.mean()


@pytest.mark.parametrize("kind", ["auto", "solid", "sheet"])
def test_every_broken_mesh_is_voxelized_or_refused_in_a_sentence(kind):
    assert len(RECIPES) == N
    shown, refused = 0, 0
    for i in range(N):
        vertices, triangles = broken(i)
        finite = vertices[np.isfinite(vertices).all(axis=1)]
        size = np.ptp(finite, axis=0).max() / 20 if len(finite) else 1.0
        begun = time.perf_counter()
        try:
            volume = voxelize(
                vertices, triangles, size, kind=kind, dtype=("u8", "u16", "f32")[i % 3], threads=1
            )
        except LeapRayError as error:
            assert " " in str(error) and len(str(error)) > 20, names(i)
            refused += 1
        else:
            g = volume.read()
            assert np.isfinite(g).all() and g.min() >= 0, names(i)
            assert volume.mesh_info.why, names(i)
            trace(volume, np.random.default_rng(i))
            shown += 1
        assert time.perf_counter() - begun < 10, names(i)
    assert shown > N / 2 and refused > N / 20  # both happen


def in_view(i):
    """The broken mesh as Blender would hand it over, brought to a size of 2 by its instance."""
    vertices, triangles = broken(i)
    with np.errstate(all="ignore"):
        vertices = vertices.astype(np.float32)
    finite = vertices[np.isfinite(vertices).all(axis=1)].astype(np.float64)
    finite = np.concatenate([finite, np.zeros((int(len(finite) == 0), 3))])
    size = max(np.ptp(finite, axis=0).max(), 1e-30)
    centre = (finite.min(axis=0) + finite.max(axis=0)) / 2
    return model.Mesh(names(i), vertices, triangles.astype(np.int32)), 2.0 / size, centre


@pytest.mark.parametrize("first", range(0, N, 20))
def test_every_broken_mesh_is_rendered_or_named(first):
    """Twenty in a scene, with a good one in front that none of them may spoil."""
    given, placed = (
        [scenes.sphere(0.5, n=8, name="Good")],
        [scenes.place(0, at=(0, -9, 0), name="Good")],
    )
    for k, i in enumerate(range(first, first + 20)):
        mesh, scale, centre = in_view(i)
        if mesh.triangles.min() < 0 or mesh.triangles.max() >= len(mesh.vertices):
            continue  # Blender has no such meshes; the core's sentence is claimed above
        row, column = divmod(k, 5)
        at = np.array([3.0 * column - 6, 0, 3.0 * row - 4.5]) - scale * centre
        given.append(mesh)
        placed.append(scenes.place(len(given) - 1, at=at, scale=scale, name=mesh.name))
    view = scenes.camera(eye=(0, -20, 0), width=60, height=48)
    scene = scenes.scene(given, placed, view=view, width=60, height=48, pixel_error=2.0, threads=2)
    begun = time.perf_counter()
    frame = pipeline.render(scene)
    assert time.perf_counter() - begun < 60
    for name, pixels in frame.passes.items():
        assert not np.isnan(pixels).any(), name
    assert np.isfinite(frame.passes["Combined"]).all()
    assert abs(frame.passes["Depth"][24, 30, 0] - 10.5) < 0.1  # the good one
    told = " ".join(frame.report["warnings"])
    rows = {row["name"] for row in frame.report["volumes"]}
    for mesh in given:
        assert mesh.name in rows or f"{mesh.name!r}" in told or mesh.name in told, mesh.name


def test_errors_of_scenes_are_sentences():
    with pytest.raises(objects.SceneError, match="Nothing is left to render"):
        pipeline.render(scenes.scene([in_view(names_of("poison"))[0]], [scenes.place(0)]))


def names_of(defect):
    return next(i for i, (_, defects) in enumerate(RECIPES) if defects[0].__name__ == defect)
