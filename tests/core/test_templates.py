# SPDX-License-Identifier: GPL-3.0-or-later
"""Template rays: every voxel lies on one copy, hits are the template's, misses are told truly."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np
import pytest
import views

import leapray
from addon.study import phantom

KINDS = ("26", "6")


def of_cells(marked):
    """A volume whose surface cells are these alone, (nz, ny, nx): every cell has both signs."""
    marked = np.pad(marked, (0, 1))
    checkers = np.indices(marked.shape).sum(axis=0) % 2
    volume = leapray.Volume(checkers.astype(np.float32), sheet=True, touched=marked)
    assert volume.info.n_surface_cells == marked.sum()
    return volume


def render(volume, camera, pixels, kind="26"):
    spec = f"templates:connectivity={kind}"
    return leapray.render_image(spec, volume, camera, pixels, pixels)


# ---- the same in Python ----------------------------------------------------------


def template(slope, n, kind):
    """Offsets (along p, along q, slices) of the steps of a line through n slices."""
    along = np.arange(n)[:, None] * np.abs(slope)
    ends = np.sign(slope) * np.floor(along + 0.5)
    ends = [(int(p), int(q), k) for k, (p, q) in enumerate(ends)]
    if kind == "26":
        return ends
    found = ends[:1]
    for end in (b for _, b in pairwise(ends)):
        while found[-1] != end:
            at = list(found[-1])
            crossings = [(at[2] + 0.5, -1, 2, 1)] if at[2] < end[2] else []
            crossings += [
                ((abs(at[a]) + 0.5) / abs(slope[a]), a, a, 1 if slope[a] > 0 else -1)
                for a in (0, 1)
                if at[a] != end[a]
            ]
            _, _, axis, way = min(crossings)
            at[axis] += way
            found.append(tuple(at))
    return found


def brute(cells, low, camera, pixels, kind):
    """Cell (pixels, pixels, 3) that each pixel's copy hits; cells: (nz, ny, nx), from cell low on.

    Of a volume in index space.
    """
    d = np.asarray(camera.forward)
    m = int(np.abs(d).argmax())
    p, q = (a for a in range(3) if a != m)
    size = cells.shape[::-1]
    steps = template((d[p] / abs(d[m]), d[q] / abs(d[m])), size[m], kind)
    plane = low[m] + (0.5 if d[m] > 0 else size[m] - 0.5)
    origins, _ = leapray.camera_rays(camera, pixels, pixels)
    t = (plane - origins[:, m]) / d[m]
    start = np.floor(origins + t[:, None] * d).astype(int) - low
    found = np.full(origins.shape, np.iinfo(np.int32).min)
    for n, first in enumerate(start):
        for step in steps:
            c = np.zeros(3, int)
            c[p], c[q] = first[p] + step[0], first[q] + step[1]
            c[m] = step[2] if d[m] > 0 else size[m] - 1 - step[2]
            if (c >= 0).all() and (c < size).all() and cells[tuple(c[::-1])]:
                found[n] = c + low
                break
    return found.reshape(pixels, pixels, 3)


# ---- claims ------------------------------------------------------------------------


def test_every_voxel_lies_on_exactly_one_copy():
    """Of two cells each stops one copy, unless both lie on the same; and no voxel is left out."""
    rng = np.random.default_rng(1)
    for k in range(60):
        ends = np.array([(0, 0, 0), rng.integers(2, 15, 3)])
        inner = rng.integers(0, ends[1] + 1)
        cells = np.unique([*ends, inner], axis=0)
        marked = np.zeros((16, 16, 16), bool)
        marked[tuple(cells.T[::-1])] = True
        volume = of_cells(marked)
        camera = views.parallel(rng, volume, 40, turn=k % 5 > 0)
        image = render(volume, camera, 40)
        behind = image.counters["hits"]
        assert 1 <= behind <= len(cells)
        d = np.asarray(camera.forward)
        m = int(np.abs(d).argmax())
        p, q = (a for a in range(3) if a != m)
        size = ends[1] + 1
        steps = np.array(template((d[p] / abs(d[m]), d[q] / abs(d[m])), size[m], "26"))
        depth = cells[:, m] if d[m] > 0 else size[m] - 1 - cells[:, m]
        copies = np.stack([cells[:, p], cells[:, q]], axis=1) - steps[depth, :2]
        assert behind == len(np.unique(copies, axis=0))
        unseen = 0  # voxels behind a hit
        for copy in np.unique(copies, axis=0):
            first = depth[(copies == copy).all(axis=1)].min()
            path = copy + steps[first + 1 :, :2]
            unseen += int(((path >= 0) & (path < size[[p, q]])).all(axis=1).sum())
        assert image.counters["cells"] == np.prod(size) - unseen


@pytest.mark.parametrize("kind", KINDS)
def test_hits_are_those_of_the_template_walked_by_hand(kind):
    rng = np.random.default_rng(2)
    hits = 0
    for k in range(10):
        marked = rng.random((14, 12, 70 if k % 2 else 9)) < 0.01
        marked[0, 0, 0] = marked[-1, -1, -1] = True
        volume = of_cells(marked)
        camera = views.parallel(rng, volume, 40, turn=k > 1)
        image = render(volume, camera, 40, kind)
        want = brute(marked, np.zeros(3, int), camera, 40, kind)
        np.testing.assert_array_equal(image.cell, want)
        hits += image.hit.sum()
    assert hits > 200


@pytest.mark.parametrize("kind", KINDS)
def test_hits_lie_within_a_voxel_of_the_ray(kind):
    rng = np.random.default_rng(3)
    volume = leapray.Volume(phantom.phantom(48, 3))
    for _ in range(6):
        camera = views.parallel(rng, volume, 80)
        image = render(volume, camera, 80, kind)
        d = np.asarray(camera.forward)
        m = int(np.abs(d).argmax())
        origins, _ = leapray.camera_rays(camera, 80, 80)
        seen = image.hit.ravel()
        middle = image.cell.reshape(-1, 3)[seen] + 0.5
        t = (middle[:, m] - origins[seen][:, m]) / d[m]
        off = np.abs(origins[seen] + t[:, None] * d - middle)
        most = 1.0 if kind == "26" else 1.5  # a side step is up to half a slice early or late
        assert off.max() <= most + 1e-9
        near = image.t[image.hit]
        assert (np.abs(near - t) * abs(d[m]) <= 0.5 + 1e-9).all()


@pytest.mark.parametrize("kind", KINDS)
def test_the_report_of_misses_is_that_of_traced_rays(kind):
    rng = np.random.default_rng(4)
    lost = 0
    for n in range(1, 11):
        volume = leapray.Volume(phantom.phantom(48, n))
        camera = views.parallel(rng, volume, 90)
        image = render(volume, camera, 90, kind)
        exact = leapray.render_image("octree_projection", volume, camera, 90, 90)
        told = image.misses(exact)
        want = views.traced(volume, camera, 90, 90)
        hit, seen = np.isfinite(want.t), image.hit.ravel()
        apart = np.abs(image.cell.reshape(-1, 3) - want.cell)[hit & seen].max(axis=1)
        assert told == leapray.Misses(
            int((hit & ~seen).sum()),
            int((seen & ~hit).sum()),
            int((apart > 0).sum()),
            int(apart.max()),
            int(hit.sum()),
        )
        lost += told.lost
        assert told.lost + told.invented < 0.1 * told.hits  # at silhouettes
    assert lost > 0


def test_what_begins_within_the_surface_is_refused():
    volume = leapray.Volume(phantom.phantom(24, 1))
    camera = views.parallel(np.random.default_rng(5), volume, 20)
    _, extent = views.bounds(volume)
    with pytest.raises(leapray.LeapRayError, match="the camera must not clip from"):
        depth = 2 * extent / np.linalg.norm(camera.forward)
        render(volume, views.clipped(camera, depth, np.inf), 20)
    cut = render(volume, views.clipped(camera, 0.0, depth), 20)
    whole = render(volume, camera, 20)
    assert 0 < cut.hit.sum() < whole.hit.sum()
    np.testing.assert_array_equal(cut.hit, whole.t <= depth)


@pytest.mark.slow
@pytest.mark.alone
@pytest.mark.parametrize("n", [1, 5, 10])
def test_templates_are_twice_as_fast_as_lines_one_by_one(n):
    volume = leapray.Volume(phantom.phantom(128, n))
    camera = views.parallel(np.random.default_rng(6), volume, 250, askew=False)
    prepared = leapray.prepare(volume, "templates")
    lines = leapray.build(volume, "lines:connectivity=26")
    rays = leapray.camera_rays(camera, 250, 250)
    spent = np.zeros((7, 2))
    for row in spent:
        began = time.process_time()
        leapray.trace(lines, *rays, mode="binary", count=False)
        between = time.process_time()
        render(prepared, camera, 250)
        row[:] = between - began, time.process_time() - between
    assert np.median(spent[:, 0]) > 2 * np.median(spent[:, 1])
