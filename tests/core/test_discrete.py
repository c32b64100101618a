# SPDX-License-Identifier: GPL-3.0-or-later
"""Discrete ray tracing: bits of lights, normals and pictures, held against walks in Python."""

from __future__ import annotations

import numpy as np
import pytest
import views
from scipy import ndimage

import leapray
from addon.study import phantom

# Octahedral normals of 255 x 255 codes; the largest angle between a vector and that of its code, of
# three million random ones, is 0.954 degrees.
ANGLE = np.radians(0.96)
SUN = leapray.Light("sun", (2.0, 1.0, 0.5), direction=(0.48, -0.6, 0.64))
POINT = leapray.Light("point", (50.0, 80.0, 90.0), position=(30.0, 9.0, -14.0))
WITHIN = leapray.Light("point", (9.0, 9.0, 9.0), position=(17.3, 8.6, 9.2))


def ball(size, centre, radius):
    """Occupancy of a sphere, a ramp of three voxels wide."""
    z, y, x = np.indices((size,) * 3)
    away = np.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2)
    return np.clip(0.5 + (radius - away) / 3, 0, 1).astype(np.float32)


def scene():
    """A large ball under a small one, and a floor: shadows on both."""
    samples = np.maximum(ball(24, (9, 9, 8), 5.3), ball(24, (13, 14, 16), 3.1))
    floor = np.clip(0.5 + (2.6 - np.indices(samples.shape)[0]) / 3, 0, 1)
    return leapray.Volume(np.maximum(samples, floor).astype(np.float32))


def surface_cells(volume, samples):
    """(n + 1)^3 flags of cells -1..n-1: smallest of eight samples < T <= largest."""
    padded = np.pad(samples, 1)
    blocks = np.lib.stride_tricks.sliding_window_view(padded, (2, 2, 2))
    most, least = blocks.max(axis=(3, 4, 5)), blocks.min(axis=(3, 4, 5))
    found = (most >= 0.5) & (least < 0.5)
    assert found.sum() == volume.info.n_surface_cells
    return found


class Walk:
    """Discrete lines through a volume, step by step as Kaufman and Shimony draw them."""

    def __init__(self, volume, cells):
        wide = np.pad(cells, 3)
        self.cells, self.offset = wide, 4  # index of cell 0
        self.near = ndimage.binary_dilation(wide, np.ones((3, 3, 3)))
        self.low = np.array(volume.info.surface_lo) - 1
        self.high = np.array(volume.info.surface_hi) + 1

    def at(self, flags, c):
        i, j, k = np.asarray(c) + self.offset
        return flags[k, j, i]

    def end(self, c, d, last):
        """Where the line from the centre of c along d leaves the box, or ends at t = last."""
        d = np.asarray(d, float)
        with np.errstate(divide="ignore", invalid="ignore"):
            planes = np.where(d > 0, self.high + 1, self.low)
            t = np.where(d != 0, (planes - (c + 0.5)) / d, np.inf)
        axis = int(t.argmin())
        out = min(float(t[axis]), last)
        to = np.clip(np.floor(c + 0.5 + out * d), self.low, self.high).astype(int)
        to[d == 0] = np.asarray(c)[d == 0]
        if t[axis] < last:
            to[axis] = self.high[axis] if d[axis] > 0 else self.low[axis]
        return to

    def first(self, c, d, last=np.inf):
        """The first surface cell after c on the line along d, or None."""
        c = np.array(c)
        sign = np.sign(d).astype(int)
        n = np.maximum((self.end(c, d, last) - c) * sign, 0)
        k, m = np.zeros(3, int), int(n.argmax())
        while True:
            to = self.wide(n, k, m) if not self.at(self.near, c + sign * k) else None
            if to is None:
                left = [a for a in range(3) if k[a] < n[a]]
                if not left:
                    return None
                a = min(left, key=lambda a: ((2 * k[a] + 1) / n[a], a))
                to = k.copy()
                to[a] += 1
            k = to
            if self.at(self.cells, c + sign * k):
                return c + sign * k

    @staticmethod
    def wide(n, k, m):
        """A 26-connected step; None where there is none."""
        if k[m] == n[m]:
            return None
        to = k.copy()
        to[m] += 1
        for a in {0, 1, 2} - {m}:
            nearest = 2 * to[m] * n[a]
            to[a] += nearest > (2 * k[a] + 1) * n[m]
            if nearest > (2 * to[a] + 1) * n[m]:
                return None
        return to


def outside(c, normal):
    """The voxel one out along a normal: components of half the largest or more count."""
    by = normal / np.abs(normal).max()
    return c + (np.sign(by) * np.floor(np.abs(by) + 0.5)).astype(int)


@pytest.fixture(scope="module")
def lit():
    volume = scene()
    prepared = leapray.prepare(volume, "discrete")
    for index, light in enumerate((SUN, POINT, WITHIN)):
        prepared.set_light(index, light)
    return prepared


@pytest.fixture(scope="module")
def walk(lit):
    samples = np.maximum(ball(24, (9, 9, 8), 5.3), ball(24, (13, 14, 16), 3.1))
    floor = np.clip(0.5 + (2.6 - np.indices(samples.shape)[0]) / 3, 0, 1)
    return Walk(lit.volume, surface_cells(lit.volume, np.maximum(samples, floor)))


def test_bits_are_those_of_a_line_from_every_voxel(lit, walk):
    voxels = lit.voxels()
    assert len(voxels.cell) == lit.volume.info.n_surface_cells
    seen = np.zeros(3, int)
    for index, light in enumerate((SUN, POINT, WITHIN)):
        for c, normal, bits in zip(voxels.cell, voxels.normal, voxels.lit, strict=True):
            sun = light.kind == "sun"
            to = np.array(light.direction) if sun else light.position - (c + 0.5)
            want = bool(normal @ to > 0)
            if want:
                start = outside(c, normal)
                d = np.array(light.direction) if sun else light.position - (start + 0.5)
                want = walk.first(start, d, np.inf if sun else 1.0) is None
            assert bool(bits >> index & 1) == want, (light, c)
            seen[index] += want
    assert (seen > 100).all()
    facing = (voxels.normal @ SUN.direction > 0).sum()
    assert seen[0] < facing - 30  # and some lie in shadow


def test_a_light_that_is_moved_leaves_the_bits_of_the_others():
    prepared = leapray.prepare(scene(), "discrete")
    nbytes = prepared.nbytes
    prepared.set_light(3, SUN)
    prepared.set_light(31, POINT)
    both = prepared.voxels().lit
    assert prepared.nbytes - nbytes == 2 * 8 * (len(both) // 64 + 1)
    prepared.set_light(3, WITHIN)
    moved = prepared.voxels().lit
    np.testing.assert_array_equal(moved >> 31, both >> 31)
    assert (moved & 8 != both & 8).any()
    watch = leapray.Watch()
    watch.stop()
    with pytest.raises(leapray.Stopped):
        prepared.set_light(31, SUN, watch=watch)
    np.testing.assert_array_equal(prepared.voxels().lit, moved)
    prepared.set_light(3, None)
    np.testing.assert_array_equal(prepared.voxels().lit, both & 1 << 31)
    prepared.set_light(31, None)
    assert prepared.nbytes == nbytes


def test_normals_are_those_of_the_field_but_for_their_codes(lit):
    voxels, z = lit.voxels(), np.indices((24,) * 3)
    samples = np.maximum(ball(24, (9, 9, 8), 5.3), ball(24, (13, 14, 16), 3.1))
    samples = np.maximum(samples, np.clip(0.5 + (2.6 - z[0]) / 3, 0, 1).astype(np.float32))
    inner = ((voxels.cell > 0) & (voxels.cell < 21)).all(axis=1)
    gradient = np.stack(np.gradient(np.pad(samples.astype(float), 2)), axis=-1)[..., ::-1]
    blocks = np.lib.stride_tricks.sliding_window_view(gradient, (2, 2, 2), (0, 1, 2))
    i, j, k = voxels.cell[inner].T + 2
    want = -blocks[k, j, i].mean(axis=(-1, -2, -3))
    want /= np.linalg.norm(want, axis=1, keepdims=True)
    cosine = (want * voxels.normal[inner]).sum(axis=1)
    assert inner.sum() > 500 and np.arccos(np.clip(cosine, -1, 1)).max() < ANGLE


@pytest.mark.parametrize("look", [views.parallel, views.perspective])
def test_cells_are_those_of_discrete_lines_traced_one_by_one(look):
    rng = np.random.default_rng(1)
    for n in (1, 3, 10):
        volume = leapray.Volume(phantom.phantom(40, n))
        for _ in range(3):
            camera = look(rng, volume, 50)
            image = leapray.render_image("discrete", volume, camera, 50, 50)
            assert views.wrong(image, views.traced(volume, camera, 50, 50, "lines")) == 0
            exact = leapray.render_image("octree_projection", volume, camera, 50, 50)
            told = image.misses(exact)
            assert told.displaced > 0 and told.lost + told.invented < 0.1 * told.hits


def test_the_picture_is_what_visible_lights_send(lit):
    voxels = lit.voxels()
    number = {tuple(c): n for n, c in enumerate(voxels.cell.tolist())}
    camera = views.perspective(np.random.default_rng(2), lit.volume, 60)
    image = leapray.render_image("discrete", lit, camera, 60, 60)
    assert image.hit.sum() > 500
    for y, x in np.argwhere(image.hit):
        n = number[tuple(image.cell[y, x].tolist())]
        np.testing.assert_array_equal(image.normal[y, x], voxels.normal[n])
        want = np.zeros(3)
        for index, light in enumerate((SUN, POINT, WITHIN)):
            sun = light.kind == "sun"
            to = np.array(light.direction if sun else light.position - (voxels.cell[n] + 0.5))
            square = to @ to
            share = voxels.normal[n] @ to / np.sqrt(square) / (np.pi * (1 if sun else square))
            want += (voxels.lit[n] >> index & 1) * share * np.array(light.color)
        np.testing.assert_allclose(image.shade[y, x], want, atol=1e-12)


def test_mirrors_show_what_reflected_lines_meet(walk, lit):
    """One mirror of all light, seen from straight above the floor and aslant."""
    prepared = leapray.prepare(lit.volume, "discrete:mirror=0.5")
    for index, light in enumerate((SUN, POINT, WITHIN)):
        prepared.set_light(index, light)
    voxels = lit.voxels()
    number = {tuple(c): n for n, c in enumerate(voxels.cell.tolist())}
    camera = views.parallel(np.random.default_rng(7), lit.volume, 40)
    plain = leapray.render_image("discrete", lit, camera, 40, 40)
    image = leapray.render_image("discrete:mirror=0.5", prepared, camera, 40, 40)
    np.testing.assert_array_equal(plain.cell, image.cell)
    own = {
        tuple(c): s
        for c, s in zip(plain.cell[plain.hit].tolist(), plain.shade[plain.hit], strict=True)
    }
    reflected = checked = 0
    for y, x in np.argwhere(image.hit):
        c, way, weight, want, known = image.cell[y, x], np.array(camera.forward), 1.0, 0.0, True
        for _ in range(5):
            if tuple(c.tolist()) not in own:
                known = False  # a voxel that the plain picture does not show
                break
            want = want + weight * 0.5 * own[tuple(c.tolist())]
            normal = voxels.normal[number[tuple(c.tolist())]]
            if _ == 4 or normal @ way >= 0:
                break
            way = way - 2 * (normal @ way) * normal
            weight *= 0.5
            c = walk.first(outside(c, normal), way)
            if c is None:
                break
            reflected += 1
        if known:
            checked += 1
            np.testing.assert_allclose(image.shade[y, x], want, atol=1e-12)
    assert reflected > 30 and checked > 300


def test_colours_come_from_the_volume():
    import meshes

    vertices, triangles = meshes.box((0.0, 0.0, 0.0), (4.0, 4.0, 4.0))
    colors = np.full((len(triangles), 3, 3), (1.0, 0.5, 0.25), np.float32)
    attributes = leapray.Attributes(
        color_sources=np.full(len(triangles), leapray.VERTEX), colors=colors
    )
    volume = leapray.voxelize(vertices, triangles, 0.25, attributes=attributes)
    voxels = leapray.prepare(volume, "discrete").voxels()
    np.testing.assert_allclose(voxels.color, np.broadcast_to((1, 0.5, 0.25), voxels.color.shape),
                               atol=0.5 / 255 + 1e-6)  # fmt: skip


def test_lights_that_do_not_fit_are_answered_by_a_sentence(lit):
    with pytest.raises(leapray.LeapRayError, match="not area"):
        lit.set_light(0, leapray.Light("area", (1, 1, 1)))
    for index, words in ((32, "0 to 31, not for 32"), (-1, "not for -1"), (2**40, "must be 0 to")):
        with pytest.raises(leapray.LeapRayError, match=words):
            lit.set_light(index, SUN)
    with pytest.raises(leapray.LeapRayError, match="must have a direction"):
        lit.set_light(0, leapray.Light("sun", (1, 1, 1), direction=(0, 0, 0)))
    with pytest.raises(leapray.LeapRayError, match="must be finite"):
        lit.set_light(0, leapray.Light("point", (1, 1, 1), position=(0, np.nan, 0)))
    with pytest.raises(leapray.LeapRayError, match="square of its distance must be finite"):
        lit.set_light(0, leapray.Light("point", (1, 1, 1), position=(0, 1e200, 0)))
    with pytest.raises(leapray.LeapRayError, match="color of a light must have shape"):
        lit.set_light(0, leapray.Light("point", (1, 1)))
    other = leapray.prepare(lit.volume, "templates")
    with pytest.raises(leapray.LeapRayError, match="templates shades by depth and has no lights"):
        other.set_light(0, SUN)
    assert len(other.voxels().cell) == 0
