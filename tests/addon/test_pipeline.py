# SPDX-License-Identifier: GPL-3.0-or-later
"""From a scene in plain arrays to a frame: right pictures, clean ends, nothing left behind."""

from __future__ import annotations

import ctypes
import gc
import json
import random
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import scenes

import leapray
from addon import pipeline, tiles
from addon.store.memory_cache import Cache

WIDTH, HEIGHT = 96, 64


def small(**settings):
    """A sphere and a turned box over a floor."""
    meshes = [scenes.sphere(n=16), scenes.box((0.8, 0.8, 0.8), turn=0.5), scenes.plane(20.0)]
    placed = [
        scenes.place(0, object_index=1),
        scenes.place(1, at=(1.4, -0.5, -0.3), object_index=2, materials=(1,)),
        scenes.place(2, at=(0, 0, -1), object_index=3),
    ]
    view = scenes.camera(eye=(0, -6, 2), width=WIDTH, height=HEIGHT)
    return scenes.scene(meshes, placed, view=view, **{"samples": 2, "tile_size": 16, **settings})


def heavy():
    """Enough triangles and voxels for a good second of planning, and many rays."""
    meshes = [scenes.sphere(n=120), scenes.box((1.5, 1.5, 1.5), turn=0.4)]
    placed = [scenes.place(0, at=(-1, 0, 0)), scenes.place(1, at=(1, 0, 0))]
    view = scenes.camera(width=1280, height=720)
    return scenes.scene(
        meshes, placed, view=view, width=1280, height=720, pixel_error=0.02, samples=4
    )


# ---- tiles --------------------------------------------------------------------------


@pytest.mark.parametrize(("width", "height", "size"), [(1, 1, 64), (100, 37, 16), (64, 128, 64)])
def test_tiles_cover_every_pixel_once(width, height, size):
    count = np.zeros((height, width), int)
    for tile in tiles.split(width, height, size):
        assert 1 <= tile.width <= size and 1 <= tile.height <= size
        count[tile.y : tile.y + tile.height, tile.x : tile.x + tile.width] += 1
    assert (count == 1).all()


@pytest.mark.parametrize(("height", "least", "most"), [(1, 64, 8), (37, 16, 4), (1000, 16, 8)])
def test_strips_cover_every_row_once(height, least, most):
    count = np.zeros(height, int)
    cut = tiles.strips(70, height, least, most)
    for tile in cut:
        assert (tile.x, tile.width) == (0, 70)
        count[tile.y : tile.y + tile.height] += 1
    assert (count == 1).all() and len(cut) <= most
    assert max(tile.height for tile in cut) >= min(least, height)


def test_tiles_come_from_the_centre():
    first, *_, last = tiles.split(1000, 600, 50)
    assert abs(first.x + 25 - 500) <= 50 and abs(first.y + 25 - 300) <= 50
    assert last.x in (0, 950) and last.y in (0, 550)


# ---- pictures -----------------------------------------------------------------------


@pytest.mark.parametrize("traverser", [t.name for t in leapray.traversers() if t.exact])
@pytest.mark.parametrize("scale", [None, 3.0], ids=["perspective", "orthographic"])
def test_a_sphere_has_the_depth_and_outline_of_the_analytic_one(scale, traverser):
    """No pixel differs but those whose centre lies within 0.3 pixels of the outline."""
    n = 256
    view = scenes.camera(width=n, height=n, scale=scale)
    scene = scenes.scene([scenes.sphere(n=128)], view=view, width=n, height=n, traverser=traverser)
    frame = pipeline.render(scene)
    x, y = np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5)
    film = view.corner + x[..., None] * view.dx + y[..., None] * view.dy
    if scale is None:
        origin, ray = np.broadcast_to(view.eye, film.shape), film
    else:
        origin, ray = view.eye + film, np.broadcast_to(view.forward, film.shape)
    a, b = (ray * ray).sum(-1), (origin * ray).sum(-1)
    closest = np.linalg.norm(origin - (b / a)[..., None] * ray, axis=-1)
    root = b * b - a * ((origin * origin).sum(-1) - 1)
    t = (-b - np.sqrt(np.maximum(root, 0))) / a
    pixel = np.linalg.norm(view.dx) * (t if scale is None else 1.0)
    depth = frame.passes["Depth"][..., 0]
    hit = depth < 1e9
    clear = np.abs(closest - 1) > 0.3 * np.broadcast_to(pixel, closest.shape)
    assert (hit == (closest < 1))[clear].all()
    inside = (closest < 1) & hit
    at = origin + t[..., None] * ray
    cosine = np.abs((at * ray).sum(-1)) / np.sqrt(a)
    error = np.abs(depth - t) * np.sqrt(a) * cosine / pixel  # perpendicular, in footprints
    assert np.quantile(error[inside], 0.99) < 0.25
    normal = (frame.passes["Normal"] * at).sum(-1)[inside]
    assert np.median(np.degrees(np.arccos(np.clip(normal, -1, 1)))) < 0.5
    position = frame.passes["Position"][inside]
    assert np.abs(np.linalg.norm(position, axis=-1) - 1).max() < 0.01


def test_the_picture_does_not_depend_on_threads_or_tiles():
    cache = Cache()
    frames = [
        pipeline.render(small(threads=threads, tile_size=size), cache=cache)
        for threads, size in [(1, 16), (2, 16), (7, 16), (2, 9), (1, 4096)]
    ]
    assert set(frames[0].passes) == {"Combined", "Depth", "Normal", "Position", "Object Index"}
    assert set(np.unique(frames[0].passes["Object Index"])) == {0.0, 1.0, 2.0, 3.0}
    for frame in frames[1:]:
        for name, image in frames[0].passes.items():
            np.testing.assert_array_equal(frame.passes[name], image, err_msg=name)


def test_layout_scene_shows_the_same():
    one, whole = pipeline.render(small()), pipeline.render(small(layout="scene", resolution=256))
    same = one.passes["Object Index"] == whole.passes["Object Index"]
    assert same.mean() > 0.9
    near = (np.abs(one.passes["Depth"] - whole.passes["Depth"]) < 0.1)[same]
    assert near.mean() > 0.95
    red = one.passes["Object Index"][..., 0] == 2
    red &= same[..., 0]
    lit = whole.passes["Combined"][red]
    assert (lit[:, 0] > 4 * lit[:, 1]).mean() > 0.9


def test_tiles_arrive_on_the_calling_thread_and_make_up_the_image():
    seen, threads, phases = {}, set(), []

    def on_tile(x, y, width, height, passes):
        threads.add(threading.current_thread())
        tiles.paste(seen, tiles.Tile(x, y, width, height), passes, (HEIGHT, WIDTH))

    def progress(fraction, phase):
        threads.add(threading.current_thread())
        phases.append((fraction, phase))

    frame = pipeline.render(small(threads=2), on_tile=on_tile, progress=progress)
    assert threads == {threading.current_thread()}
    for name, image in frame.passes.items():
        np.testing.assert_array_equal(seen[name], image, err_msg=name)
    fractions = [fraction for fraction, _ in phases]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0
    assert phases[0] == (0.0, "Voxelizing") and phases[-1] == (1.0, "Rendered 24/24 Tiles")


def test_a_second_render_voxelizes_nothing(monkeypatch):
    cache = Cache()
    first = pipeline.render(small(), cache=cache)
    monkeypatch.setattr(leapray, "voxelize", None)
    monkeypatch.setattr(leapray, "build", None)
    again = pipeline.render(small(), cache=cache)
    np.testing.assert_array_equal(first.passes["Combined"], again.passes["Combined"])
    assert again.report["seconds"]["voxelize"] == 0.0


def test_an_empty_scene_shows_the_world():
    frame = pipeline.render(scenes.scene([]))
    np.testing.assert_allclose(frame.passes["Combined"][..., :3], 0.1)
    assert (frame.passes["Depth"] == np.float32(1e10)).all()


# ---- the report ------------------------------------------------------------------------


def test_the_report_says_what_was_done():
    frame = pipeline.render(small(threads=2))
    report = json.loads(json.dumps(frame.report))
    assert report["settings"]["samples"] == 2 and report["threads"] == 2
    assert report["versions"]["leapray"] == leapray.__version__ and report["cpu"]
    seconds = report["seconds"]
    assert {"read", "voxelize", "structure", "plan", "prepare", "trace", "total"} == set(seconds)
    assert sum(v for k, v in seconds.items() if k != "total") <= seconds["total"]
    # one ray per pixel for the geometry, two for the picture, and those of the light
    assert report["rays"] >= 3 * WIDTH * HEIGHT and report["tests"] > report["hits"] > 0
    assert len(report["volumes"]) == 3
    held = report["bytes"]["volumes"] + report["bytes"]["structures"]
    assert held == sum(v["nbytes"] for v in report["volumes"]) < report["bytes"]["peak"]


def test_bad_objects_are_named_in_the_frame():
    scene = small()
    bad = scenes.place(0, name="Squashed", scale=(1, 0, 1))
    scene = scenes.dataclasses.replace(
        scene, instances=(*scene.instances, bad), warnings=("From reading.",)
    )
    frame = pipeline.render(scene)
    assert frame.warnings[0] == "From reading." and "Squashed" in frame.warnings[1]
    assert frame.report["warnings"] == frame.warnings
    np.testing.assert_array_equal(
        frame.passes["Combined"], pipeline.render(small()).passes["Combined"]
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("samples", 0),
        ("resolution", -1),
        ("pixel_error", 0.0),
        ("pixel_error", float("nan")),
        ("memory_mb", 0),
        ("tile_size", 0),
        ("threads", -1),
        ("traverser", "warp"),
        ("hit_test", "guess"),
        ("root", "guess"),
        ("normal", "guess"),
        ("sample_type", "u7"),
        ("layout", "pile"),
    ],
)
def test_bad_settings_stop_before_work_begins(monkeypatch, name, value):
    monkeypatch.setattr(leapray, "voxelize", None)
    with pytest.raises(leapray.LeapRayError, match=f"{name.replace('_', '.')}.*{value}"):
        pipeline.render(small(**{name: value}))


# ---- ends ----------------------------------------------------------------------------------


def test_an_exception_of_the_caller_ends_all_workers():
    def on_tile(*_):
        raise ZeroDivisionError

    before = threading.active_count()
    with pytest.raises(ZeroDivisionError):
        pipeline.render(small(threads=3), on_tile=on_tile)
    assert threading.active_count() == before


def test_an_exception_of_a_worker_is_raised_and_ends_the_others(monkeypatch):
    calls = []

    def fail(self, *_, **__):
        calls.append(1)
        raise leapray.LeapRayError("no tile today")

    monkeypatch.setattr(leapray.Scene, "render_tile", fail)
    before = threading.active_count()
    with pytest.raises(leapray.LeapRayError, match="no tile today"):
        pipeline.render(small(threads=2))
    assert threading.active_count() == before and len(calls) <= 2


def resident() -> int:
    """Bytes of this process that are in memory, without what the C library keeps for later."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


@pytest.mark.slow
@pytest.mark.alone
def test_cancelling_at_any_moment_ends_soon_and_leaves_nothing():
    scene = heavy()
    ended = []

    def until(deadline):
        def stop():
            if time.monotonic() > deadline and not ended:
                ended.append(time.monotonic())
            return bool(ended)

        return stop

    with pytest.raises(leapray.Stopped):
        pipeline.render(scene, stop=until(time.monotonic() + 1.0))
    memory, threads = [], threading.active_count()
    moments = random.Random(7)
    phases = set()
    for _ in range(20):
        ended.clear()
        with pytest.raises(leapray.Stopped):
            pipeline.render(
                scene,
                stop=until(time.monotonic() + moments.uniform(0.0, 1.2)),
                progress=lambda fraction, phase: phases.add(phase),
            )
        assert time.monotonic() - ended[0] < 0.5
        assert threading.active_count() == threads
        memory.append(resident())
    growth = np.median(memory[10:]) - np.median(memory[:10])
    assert growth < 35 << 20  # ten frames' volumes and structures are 700 MB
    assert "Voxelizing" in phases
