# SPDX-License-Identifier: GPL-3.0-or-later
"""Random calls of the core's package with arguments that nobody should give.

    python tests/hostile_calls.py [--calls N] [--seed S] [--first I] [--sanitize]

Each call is made by a generator of its own, so that --first I --calls 1 repeats it. It must end
within a minute by a result that holds what is promised or by a LeapRayError whose
text is a sentence. --sanitize compiles the core by the system's gcc with
AddressSanitizer and UndefinedBehaviorSanitizer, once, and calls that.
"""

from __future__ import annotations

import argparse
import collections
import faulthandler
import functools
import os
import sys
import time
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    native = str(Path(__file__).resolve().parent.parent / "native")
    sys.path[:0] = [os.environ.get("LEAPRAY_PACKAGE", native), native]

from hostile_arguments import (
    DTYPES,
    NUMBERS,
    WHOLES,
    Source,
    attributes,
    known_meshes,
    known_structures,
    known_textures,
    known_volumes,
)
from sentences import check_sentence

import build_variants
import leapray
from leapray import programs, rendering

LONGEST = 60  # seconds of a call
ROOM = 30_000_000  # bytes that a voxelization may take


class Broken(AssertionError):
    """A result that is not what is promised."""


# ---- calls -------------------------------------------------------------------------------------


def make_volume(s: Source):
    volume = s.volume()
    check(np.isfinite(volume.read()).all(), "samples that are not finite")
    if s.likely(0.5):
        trace_through(s, leapray.build(volume, s.one(leapray.variants())))
    if s.likely(0.3):
        volume.narrow(1 + abs(s.number()) * 9)
        check(volume.info.dtype == "u8", "not narrow")


def fill_block_by_block(s: Source):
    size = s.shape(20)[: None if s.mostly(0.98) else 2]
    size = tuple(n if s.mostly(0.97) else s.one(WHOLES) for n in size)
    builder = leapray.VolumeBuilder(
        size, s.name(("u8", "u16", "f32")), s.one((0.5, 1.0, 0.01) if s.mostly(0.9) else NUMBERS),
        s.matrix(), s.likely(0.3), s.likely(0.3),
    )  # fmt: skip
    if s.likely(0.2):
        builder.place(s.planes(size[::-1]))
    for _ in range(s.rng.integers(4)):
        shape = s.shape(min(9, *map(abs, size)) if s.mostly(0.9) else 9)
        room = [max(1, n - m + 1) for n, m in zip(size, shape[::-1], strict=False)]
        origin = [int(s.rng.integers(n)) if s.mostly(0.9) else s.whole(20) for n in room]
        ids = s.rng.integers(0, 5, shape) if s.likely(0.3) else None
        touched = s.rng.random(shape) < 0.5 if s.likely(0.3) else None
        builder.put(origin, s.strided(s.typed(s.samples(shape), s.one(DTYPES[:3]))), ids, touched)
    volume = builder.finish()
    trace_through(s, leapray.build(volume, s.one(leapray.variants())))
    if s.likely(0.2):
        builder.put((0, 0, 0), np.zeros((1, 1, 1)))


def trace_through(s: Source, structure):
    origins, directions, n = s.rays()
    more = {}
    for name in ("t_min", "t_max"):
        if s.likely(0.4):
            more[name] = s.numbers(n, 0.5) if s.likely(0.5) else s.number(0.3)
    for name, names in (("mode", leapray.MODES), ("hit_test", leapray.HIT_TESTS),
                        ("root", leapray.ROOTS), ("normal", leapray.NORMALS)):  # fmt: skip
        if s.likely(0.5):
            more[name] = s.name(names)
    if more.get("hit_test") == "uniform" and s.likely(0.8):
        steps = (0.01, 0.3, 1.0, 50.0) if s.mostly(0.5) else NUMBERS
        more |= {"root": s.one(("bisect", "linear")), "step": s.one(steps)}
    if s.likely(0.4):
        cells = s.rng.integers(-3, 12, (n, 3))
        if n and s.likely(0.3):
            cells[s.rng.integers(n)] = [s.one(WHOLES) for _ in range(3)]
        more["start"] = (cells, s.rng.integers(-1, 2, n))
    more["threads"] = s.threads()
    more["count"] = s.likely(0.5)
    check_hits(leapray.trace(structure, origins, directions, **more), n)


def check_hits(hits, n: int):
    check(hits.t.shape == (n,) and hits.cell.shape == hits.normal.shape == (n, 3), "shapes")
    check(not np.isnan(hits.t).any(), "a hit at NaN")
    hit = np.isfinite(hits.t)
    check(not hits.normal[~hit & (hits.t == np.inf)].any(), "a normal without a hit")
    check(np.isfinite(hits.normal).all(), "a normal that is not finite")
    length = np.linalg.norm(hits.normal, axis=1)
    check(((np.abs(length - 1) < 1e-6) | (length == 0)).all(), "a normal that is not unit")
    for name, total in hits.counters.items():
        check(total >= 0, f"{name} is {total}")


def trace_known(s: Source):
    trace_through(s, s.one(known_structures()))


def see(s: Source):
    """Light, extremes and means through a visible volume."""
    n = s.whole(6)
    knots = np.sort(s.numbers(max(0, min(n, 99)), 0.8))
    columns = [np.abs(s.numbers(shape, 0.8)) for shape in (knots.shape, (*knots.shape, 3), (3,))]
    scattering = columns[0][:, None] * np.abs(s.numbers((1, 3), 0.5))
    if s.likely(0.1):
        scattering = np.abs(s.numbers((*knots.shape, 3), 0.8))
    transfer = leapray.TransferFunction(knots, *columns, scattering)
    samples = s.typed(s.samples(s.shape()), s.one(DTYPES))
    grid = leapray.ScalarGrid("field", samples, s.matrix(), scale=s.number(), offset=s.number())
    volume = leapray.visible_volume(grid, transfer, everywhere=s.likely(0.2), threads=s.threads())
    origins, directions, n = s.rays()
    more = {"mode": s.name(leapray.VISIBLE_MODES), "sampling": s.name(leapray.SAMPLINGS)}
    for name in ("t_min", "t_max", "step", "tolerance", "stop_opacity", "stop"):
        if s.likely(0.3):
            more[name] = s.number(0.3)
    hits = leapray.trace(leapray.build(volume), origins, directions, **more)
    check(hits.t.shape == (n,) and not np.isnan(hits.t).any(), "a t that is none")
    check(not np.isnan(hits.color).any() and (hits.color >= 0).all(), "a colour that is none")
    check(((hits.opacity >= 0) & (hits.opacity <= 1)).all(), "an opacity that is none")


def build_wrongly(s: Source):
    spec = s.one(leapray.variants()).spec
    if s.likely(0.5):
        spec = s.one(
            ("", ":", "cd:", "cd:a=b", "nothing", "octree:size=3", spec + ",x", spec + ":")
        )
    volume = s.one(known_volumes()) if s.likely(0.8) else s.one((None, 3, np.zeros((3, 3, 3))))
    trace_through(s, leapray.build(volume, spec))


def voxelize(s: Source):
    vertices, triangles = s.mesh()
    extent = float(np.ptp(vertices, axis=0).max()) if s.likely(0.85) else 1.0
    size = extent / s.rng.uniform(2, 20) if s.mostly(0.95) else s.one(NUMBERS)
    more = {"max_nbytes": ROOM, "threads": s.threads()}
    for name, names in (("filter", ("ramp", "box", "cone", "gauss", "binary")),
                        ("kind", ("auto", "solid", "sheet")), ("dtype", ("u8", "u16", "f32")),
                        ("exact", ("all", "sheets", "none")),
                        ("simd", ("auto", "portable", "avx2", "avx512"))):  # fmt: skip
        if s.likely(0.5):
            more[name] = s.name(names)
    if s.likely(0.2):
        more["half_width"] = s.number(0.3)
    if s.likely(0.3):
        n = len(triangles) if s.mostly(0.9) else s.whole(5, 1)
        more["ids"] = s.ids(n)
    if s.likely(0.3):
        more["attributes"] = attributes(s, len(triangles) if s.mostly(0.95) else 3)
    volume = leapray.voxelize(vertices, triangles, size, **more)
    check(np.isfinite(volume.read()).all(), "samples that are not finite")
    trace_through(s, leapray.build(volume))
    if s.likely(0.3):
        ask_points(s, volume)
    if s.likely(0.2):
        unpack(s, volume)


def tell_layers(s: Source):
    vertices, triangles = s.mesh()
    layers = leapray.mesh_layers(vertices, triangles, abs(s.number()))
    check(layers.min(initial=0) >= 0, "a layer below 0")


def tell_distances(s: Source):
    cells = s.rng.random(s.shape(20)) < s.one((0, 0.01, 0.5, 1))
    if s.likely(0.1):
        cells = cells[:, :, 0] if s.likely(0.5) else cells[:0]
    got = leapray.distance(s.strided(cells), s.name(leapray.METRICS), threads=s.threads())
    check(got.min() >= 0, "a distance below 0")


def read_blocks(s: Source):
    volume = s.one(known_volumes())
    origin = [s.whole(30, 0.9) - s.one((0, 0, 10)) for _ in range(3 if s.mostly(0.98) else 2)]
    size = [s.whole(12, 1) if s.mostly(0.98) else s.one((-1, 0, 2**31)) for _ in range(3)]
    read = s.one((volume.read, volume.read_ids, volume.read_surface, volume.read_exact))
    got = read(origin, size if s.mostly(0.95) else None)
    check(got.ndim == 3, "not a block")
    volume.bricks()


def ask_points(s: Source, volume):
    n = s.one((0, 1, 5, 40))
    points = s.strided(s.numbers((n, 3), 0.5))
    ids = s.ids(n) if s.likely(0.5) else None
    if ids is not None and s.likely(0.1):
        ids = ids[:-1]
    value, gradient = volume.sample(points, ids, s.number() if s.likely(0.3) else 0.0)
    check(value.shape == (n,) and gradient.shape == (n, 3), "shapes")
    check(np.isfinite(value).all(), "a value that is not finite")
    volume.attributes(points, ids, abs(s.number()) if s.likely(0.5) else 0.0)
    volume.exact_at(points)


def ask_known(s: Source):
    ask_points(s, s.one(known_volumes()))


def unpack(s: Source, volume=None):
    data = (volume or s.one(known_volumes())).pack()
    kind = s.rng.integers(4, 6) if s.calm else s.rng.integers(5)
    if kind == 0:
        data = data[: s.rng.integers(data.size)]
    elif kind == 1:
        spots = s.rng.integers(0, data.size, s.one((1, 2, 20)))
        data[spots] = s.rng.integers(0, 256, len(spots))
    elif kind == 2:
        at = 4 * int(s.rng.integers(max(1, min(data.size, s.one((300, data.size))) // 4)))
        data[at : at + 4] = np.frombuffer(np.int32(s.one(WHOLES[:-1])).tobytes(), np.uint8)
    elif kind == 3:
        data = np.concatenate([data, data[:7]])
    again = leapray.Volume.unpack(data.tobytes())
    if s.likely(0.5):
        again.bind(tuple(s.one(known_textures()) for _ in range(s.rng.integers(3))))
    trace_through(s, leapray.build(again))
    ask_points(s, again)


def merge(s: Source):
    chosen = [s.one(known_volumes()) for _ in range(s.rng.integers(4))]
    if s.mostly(0.7):
        v, t = s.one(known_meshes()[:5:4])
        chosen = [
            leapray.voxelize(
                v + s.one((0, 0.3, 5)) * k, t, 0.25, ids=np.full(len(t), k), threads=1,
                kind="solid", dtype="u8" if s.mostly(0.8) else "f32",
            )
            for k in range(s.rng.integers(1, 4))
        ]  # fmt: skip
    trace_through(s, leapray.build(leapray.merge(chosen)))


def program(s: Source):
    """Instructions with operands that may lie beyond all registers and constants."""
    n, most = s.one((0, 1, 5, 40)), 4 if s.calm else 70000
    code = s.rng.integers(0, s.one((most, 40)), (n, 5))
    code[:, 0] = s.rng.integers(0, len(programs.OPERATIONS) if s.mostly(0.7) else 65536, n)
    tables = [leapray.Table(s.numbers(s.one((2, 7)), 0.9), s.one(programs.KINDS))] * s.one((0, 2))
    return leapray.Program(
        code.clip(0, 65535).tolist(), s.numbers(s.one((0, 3, 50))), tables,
        s.rng.integers(0, most, 3).clip(0, 65535).tolist(),
    )  # fmt: skip


def run_program(s: Source):
    made = program(s).run(s.strided(s.numbers((s.one((0, 1, 30)), 4), 0.5)))
    check(made.shape[1] == 3, "no colours")


def look_up(s: Source):
    by = program(s) if s.likely(0.3) else None
    channels = s.one((3, 4) if by is not None else (3,)) if s.mostly(0.95) else s.whole(5)
    pixels = s.numbers((*s.shape(9)[:2], abs(channels) % 9), 0.7)
    pixels = pixels.astype(s.one(("f4", "f8", "u1", "i4")))
    texture = leapray.Texture(
        None if by is not None and s.likely(0.2) else s.strided(pixels),
        s.name(("linear", "closest", "cubic")),
        s.name(("repeat", "extend", "clip", "mirror")),
        program=by,
        points_only=s.likely(0.3),
    )
    n = s.one((0, 1, 9))
    uvs = s.numbers((n, 2), 0.5)
    got = texture.sample(uvs, np.abs(s.numbers((n, 3), 0.5)) if s.likely(0.5) else None)
    check(by is not None or np.isfinite(got).all(), "a colour that is not finite")


def render_an_image(s: Source):
    uniform = [v for v in known_volumes() if v.info.planes is None]
    volume = s.one(uniform) if s.mostly(0.95) else s.one(known_volumes())
    method = s.one(leapray.image_variants())
    spec = method if s.likely(0.8) else s.name([one.spec for one in leapray.image_variants()])
    prepared = leapray.prepare(volume, spec) if s.likely(0.5) else volume
    if prepared is not volume and s.likely(0.7 if prepared.method.lights else 0.05):
        prepared.set_light(s.one((0, 31)) if s.mostly(0.9) else s.whole(99), light(s))
    width, height = (s.one((1, 5, 16)) if s.mostly(0.95) else s.one((0, -1, 2**31)) for _ in "wh")
    found = leapray.render_image(spec, prepared, camera(s), width, height, threads=s.threads())
    if found.empty is not None:
        prepared = prepared if s.mostly(0.9) else s.one(known_volumes())
        found = leapray.render_image(spec, prepared, camera(s), width, height, before=found)
    check(found.t.shape == (height, width) and not np.isnan(found.t).any(), "what was found")


def camera(s: Source):
    if s.mostly(0.5):
        side = s.one((1.0, 1e-3, 1e3))
        kind = s.one(("perspective", "orthographic", "orthographic"))
        z = float(kind == "perspective")
        return leapray.Camera(kind, (0, 0, -9), (0, 0, 1), (-side, -side, z), (side / 5, 0, 0),
                              (0, side / 5, 0))  # fmt: skip
    return leapray.Camera(
        s.name(("perspective", "orthographic")), *(s.vector() for _ in range(5)),
        clip_start=s.number(), clip_end=s.number() if s.likely(0.3) else np.inf,
    )  # fmt: skip


def lobe(s: Source):
    units = (0.0, 1.0, 0.5, 1e-17, 1e-300) if s.mostly(0.97) else NUMBERS

    def color():
        return np.abs(s.vector(0.97)) * s.one((1, 1, 1e-20, 1e20))

    return leapray.Lobe(
        s.name(rendering.LOBES), color(), weight=s.one((1.0, 0.3, *units)), roughness=s.one(units),
        ior=s.one((1.5, 1.0, 0.7, 1e-3, 1e3)) if s.mostly(0.97) else s.number(0.5),
        multiscatter=s.likely(0.5), textured=s.likely(0.3), metallic=s.one(units),
        specular=s.one(units), specular_tint=color(), transmission=s.one(units),
        alpha=s.one(units), emission=color(),
    )  # fmt: skip


def light(s: Source):
    direction = s.vector(0.97)
    if s.mostly(0.9) and direction.shape == (3,):
        with np.errstate(all="ignore"):
            direction = direction / np.linalg.norm(direction)
    return leapray.Light(
        s.name(rendering.LIGHTS), np.abs(s.vector(0.97)), s.vector(0.97), direction,
        s.vector(0.97), s.vector(0.97), radius=s.one((0.0, 0.1, 5.0) if s.mostly(0.9) else NUMBERS),
        angle=s.one((0.0, 0.1, 3.0, 3.1415)) if s.mostly(0.97) else s.number(),
        blend=s.one((0.0, 0.5, 1.0)) if s.mostly(0.98) else s.number(),
        shape=s.name(rendering.SHAPES), casts_shadow=s.likely(0.8), visible_camera=s.likely(0.3),
        plane_margin=abs(s.number(0.9)), max_bounces=s.whole(20),
    )  # fmt: skip


@functools.cache
def fogs():
    """Structures of volumes that scatter light."""
    rng = np.random.default_rng(4)
    grid = leapray.ScalarGrid("fog", rng.random((7, 6, 5), np.float32), np.diag([0.4] * 3 + [1]))
    looks = [
        leapray.TransferFunction([0.2, 0.6], [0, sigma], scattering=[(0, 0, 0), [sigma * a] * 3])
        for sigma, a in ((1.0, 1.0), (1e30, 0.5), (1e-30, 2.0))
    ]
    return [leapray.build(leapray.visible_volume(grid, look)) for look in looks]


def render(s: Source):
    materials = [
        leapray.Material(
            [lobe(s) for _ in range(s.one((0, 1, 2, 4)) if s.mostly(0.98) else 40)],
            absorption=np.abs(s.vector(0.97)) * s.one((0, 0, 1)), index=s.whole(9),
            scattering=np.abs(s.vector(0.97)) * s.one((0, 0, 1, 1e30)),
            glow=s.vector(0.97) * s.one((0, 0, 1)), anisotropy=s.one((0.0, 0.5, -1.0)),
            phase=s.name(rendering.PHASES), bare=s.likely(0.05),
        )
        for _ in range(s.rng.integers(1, 4))
    ]  # fmt: skip
    n = s.whole(5, 1)
    instances = [
        leapray.Instance(
            s.one((*known_structures(), *fogs())), s.one((np.eye(4), s.matrix())),
            anisotropy=s.one((0.0, 0.5, -1.0)) if s.mostly(0.98) else s.number(),
            phase=s.name(rendering.PHASES), visible_volume_scatter=s.mostly(0.9),
            first_material=s.one((0, 0, 0, 1)) if s.mostly(0.98) else s.one((-1, 2**31)),
            n_materials=s.one((1, 1, 2)) if s.mostly(0.98) else s.one((0, 2**31)),
            object_index=s.whole(5), holdout=s.likely(0.1),
            visible_shadow=s.mostly(0.9), visible_camera=s.mostly(0.9),
        )
        for _ in range(n)
    ]  # fmt: skip
    image = None
    if s.likely(0.3):
        image = np.abs(
            s.numbers((*s.shape(7)[:2], 3 if s.mostly(0.97) else 2), 1 if s.calm else 0.9)
        )
        image = s.strided(image.astype("f4"))
        if s.likely(0.3):
            image = s.one(known_textures())
    world = leapray.World(
        np.abs(s.vector(0.97)), image,
        np.eye(3) if s.mostly(0.7) else s.numbers((3, 3)) * s.one((1.0, 1e-200, 1e200)),
    )  # fmt: skip
    slots = [s.rng.integers(len(materials)) for _ in range(2)]
    scene = leapray.Scene(
        camera(s), instances, [light(s) for _ in range(s.one((0, 1, 2, 9)))], materials,
        slots if s.mostly(0.98) else [s.one(WHOLES[:-2])] * 2, world, s.likely(0.3),
        [1, 2] if s.likely(0.2) else None,
        (s.number(0.95), abs(s.number(0.95)), s.name(("LINEAR", "QUADRATIC"))),
    )  # fmt: skip
    place = [s.whole(50, 0.97) for _ in range(2)]
    size = [s.one((1, 4, 9)) if s.mostly(0.97) else s.one((0, -1, 70000, 2**31)) for _ in range(2)]
    more = {"samples": s.one((1, 2, 5)) if s.mostly(0.97) else s.one(WHOLES), "seed": s.whole(9)}
    for name, value in leapray.SAMPLING.items():
        if not s.likely(0.2):
            continue
        if name == "pixel_filter":
            more[name] = s.name(leapray.PIXEL_FILTERS)
        elif isinstance(value, int):
            more[name] = s.whole(16, 0.95)
        else:
            more[name] = abs(s.number(0.9))
    more["passes"] = [s.name(leapray.PASSES) for _ in range(s.rng.integers(5))]
    if not s.mostly(0.9):
        more["workspace"] = np.empty(s.one((0, 1, 100, 5000)), np.uint8)
    if s.likely(0.1):
        more["record"] = leapray.Record(s.one((0, 1, 50)))
        size = (1, 1) if s.mostly(0.9) else size
    frame = scene.render_tile(*place, *size, **more)
    for name, pixels in frame.items():
        check(pixels.shape[:2] == (size[1], size[0]), name)


CALLS = {
    make_volume: 3, fill_block_by_block: 2, trace_known: 6, build_wrongly: 1, voxelize: 3,
    tell_layers: 1, tell_distances: 1, read_blocks: 1, ask_known: 1, unpack: 3, merge: 1,
    look_up: 2, run_program: 1, render_an_image: 2, see: 4, render: 6,
}  # fmt: skip


def check(holds: bool, what: str) -> None:
    if not holds:
        raise Broken(what)


def make(seed: int, index: int) -> str:
    """Make one call; returns how it ended, raises what must not be."""
    s = Source(seed, index)
    fractions = np.array(list(CALLS.values()), float)
    call = list(CALLS)[s.rng.choice(len(CALLS), p=fractions / fractions.sum())]
    try:
        with np.errstate(all="ignore"):
            call(s)
    except leapray.LeapRayError as refusal:
        check_sentence(refusal)
        return f"{call.__name__} refused"
    except Exception as error:
        error.add_note(f"in call {index} of seed {seed}, {call.__name__}")
        raise
    return f"{call.__name__} done"


def run(seed: int, first: int, n: int, keep_on: bool = False) -> collections.Counter:
    """Make n calls; with keep_on, faults are printed and counted."""
    ends: collections.Counter = collections.Counter()
    for index in range(first, first + n):
        faulthandler.dump_traceback_later(LONGEST, exit=True)
        began = time.monotonic()
        try:
            ends[make(seed, index)] += 1
        except Exception as error:
            if not keep_on:
                raise
            told = getattr(error, "__notes__", [""])[0] or f"in call {index} of seed {seed}"
            print(f"{type(error).__name__}: {error} ({told})", flush=True)
            ends["FAULT"] += 1
        if time.monotonic() - began > 10:
            print(f"call {index} took {time.monotonic() - began:.0f} s", flush=True)
    faulthandler.cancel_dump_traceback_later()
    return ends


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--calls", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sanitize", action="store_true")
    parser.add_argument("--keep-on", action="store_true", help="tell all faults, not the first")
    chosen = parser.parse_args()
    if chosen.sanitize:
        words = [word for word in sys.argv if word != "--sanitize"]
        return build_variants.run("address", words)
    faulthandler.enable()
    ends = run(chosen.seed, chosen.first, chosen.calls, chosen.keep_on)
    for end, count in sorted(ends.items()):
        print(f"{count:7} {end}")
    return ends["FAULT"] > 0


if __name__ == "__main__":
    sys.exit(main())
