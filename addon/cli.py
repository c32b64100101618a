# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: `build.py VERB`, `python -m addon.cli VERB`, `blender -c leapray VERB`.

A picture is rendered into a folder of its own beside the place asked for and
then renamed, so that a picture that is there is whole. What Blender prints to
standard output is kept from it: the last line says where the result is.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from leapray import LeapRayError

from . import arguments, pixel_report, process
from .blender.open_file import be_registered, open_scene, render_frame, set_format
from .descriptions import Setting
from .methods import PROJECTIONS
from .settings import SETTINGS
from .store import files
from .store.files import check_file, check_folder, part_folder, resolved

FORMATS = (".png", ".exr")
BLEND = re.compile(r"\.blend\d*")  # Blender numbers the files that it keeps of earlier saves
_command = None  # Blender's handle of the registered command


def main(argv: list[str]) -> int:
    """Do what the words say; returns the exit code, 0 only when the result exists."""
    try:
        return run(argv)
    except KeyboardInterrupt:
        say("interrupted")
        return 130


def run(argv: list[str]) -> int:
    """As main; KeyboardInterrupt is the caller's."""
    try:
        args = arguments.parse(argv)
        return VERBS[args.verb](args)
    except SystemExit as ended:  # argparse has said why
        return ended.code if isinstance(ended.code, int) else 1
    except LeapRayError as error:
        say(str(error))
    except OSError as error:  # a full disk, a folder that has gone
        say(f"{error.filename or 'a file'}: {error.strerror or error}")
    return 1


def say(sentence: str) -> None:
    print(f"leapray: {sentence}", file=sys.stderr, flush=True)


# ---- render --------------------------------------------------------------


def render(args: argparse.Namespace) -> int:
    """Render a frame, or several; writes each picture and the JSON beside it."""
    args.scene = resolved(args.scene) if str(args.scene).startswith("~") else args.scene
    measured = not BLEND.fullmatch(args.scene.suffix.lower())
    name = data_name(args.scene) if measured else args.scene.stem
    if not (measured and args.scene.name and args.scene.is_dir()):
        check_file(args.scene)
    check_data_options(args, measured)
    output = resolved(args.output or Path(f"{name}.png"), args.scene)
    if output.suffix.lower() not in FORMATS:
        raise LeapRayError(f"--output must end in {' or '.join(FORMATS)}, and is {output}")
    figures = pixel_figures(args) if args.pixel else None
    known = args.frames or [0 if args.frame is None else args.frame]
    for target in targets(args, output, known) if not args.pixel else ():
        target.check(args)
    for key, setting in SETTINGS.items():
        if setting.check is not None and getattr(args, key) is not None:
            setattr(args, key, spec_of(setting, getattr(args, key)))
    if args.cache_folder:
        args.cache_folder = str(resolved(Path(args.cache_folder), args.scene))

    scene = open_data(args) if measured else open_scene(args.scene)
    override(scene, args)
    if args.pixel:
        return trace_pixel(args, scene, figures)
    several = args.frames is not None
    if not several:
        known = [scene.frame_current if args.frame is None else args.frame]
    warned: set[str] = set()
    told: list[dict] = []
    for count, target in enumerate(targets(args, output, known), 1):
        target.check(args)
        lead = f"Frame {target.frame}, {count} of {len(known)} | " if several else ""
        warnings = render_one(args, scene, target, told, lead)
        for warning in warnings:
            if warning not in warned:
                say(f"warning: {warning}")
        warned.update(warnings)
        print(f"{target.picture}, and its figures in {target.figures}", flush=True)
    return 0


def data_name(path: Path) -> str:
    """What pictures of measured data are called: another name than a scene's, and than that of
    a file that tells the layout of raw numbers."""
    if path.is_dir():
        return f"{path.name}_data"
    stem, _, suffix = path.name.removesuffix(".gz").rpartition(".")
    return f"{stem}_{suffix}" if stem else suffix


def check_data_options(args: argparse.Namespace, measured: bool) -> None:
    """Refuse options of measured data for scenes, and those of surfaces for volumes without one."""
    of_surfaces = "threshold", "interpolation"
    given = [name for name in (*of_surfaces, "clip", "preset") if getattr(args, name) is not None]
    if given and not measured:
        raise LeapRayError(f"--{given[0]} is for measured data, and {args.scene} is a scene")
    if args.preset and given[0] != "preset":
        raise LeapRayError(
            f"--preset shows a volume without a surface, and --{given[0]} is for surfaces"
        )
    if args.method in {each.spec for each in PROJECTIONS} and given and given[0] in of_surfaces:
        raise LeapRayError(
            f"--method {args.method} shows values without a surface, and --{given[0]} is for "
            "surfaces"
        )


def open_data(args: argparse.Namespace):
    """A scene made round measured data."""
    be_registered()
    from .blender import data_scene

    return data_scene.make(
        args.scene, args.threshold, args.interpolation, args.clip, args.preset, args.method, say
    )


def pixel_figures(args: argparse.Namespace) -> Path | None:
    """Where --pixel writes its figures, if anywhere; LeapRayError where it cannot."""
    if args.output or args.frames:
        raise LeapRayError("--pixel writes no picture, and is of one frame: it goes with --frame")
    figures = resolved(args.json, args.scene) if args.json else None
    if figures:
        check_folder(figures)
        if figures.resolve() == args.scene.resolve():
            raise LeapRayError(f"The scene {args.scene} and the figures must be different files")
    return figures


def trace_pixel(args: argparse.Namespace, scene, figures: Path | None) -> int:
    """Render one pixel and print what happened on its paths; figures: write it as JSON there."""
    frame = scene.frame_current if args.frame is None else args.frame
    scene.frame_set(frame)
    reports = render_frame(scene, pixel=args.pixel)
    if not reports:
        raise LeapRayError(f"No view layer of scene '{scene.name}' is used for rendering")
    for layer, report in reports.items():
        if len(reports) > 1:
            print(f"View layer {layer}")
        for line in pixel_report.lines(report["pixel"]):
            print(line)
        for warning in report["warnings"]:
            say(f"warning: {warning}")
    if figures:
        with part_folder(figures) as aside:
            files.write_json(aside / "figures.json", frame_figures(args, frame, reports))
            with process.signals_deferred():
                os.replace(aside / "figures.json", figures)
        print(f"The same as data is in {figures}")
    return 0


def frame_figures(args: argparse.Namespace, frame: int, reports: dict[str, dict], **more) -> dict:
    """What a JSON file says of a frame: the first view layer's figures, and those of all."""
    import bpy

    figures = {
        "scene": str(args.scene),
        "frame": frame,
        **more,
        "blender": bpy.app.version_string,
        **next(iter(reports.values())),
    }
    return figures | ({"view_layers": reports} if len(reports) > 1 else {})


@dataclass(frozen=True)
class Target:
    """Where the picture and the figures of a frame go."""

    frame: int
    picture: Path
    figures: Path
    shared: bool  # whether the figures of other frames go to the same file

    def check(self, args: argparse.Namespace) -> None:
        """Raise LeapRayError where they could not be written."""
        for path in (self.picture, self.figures):
            check_folder(path)
        if len({path.resolve() for path in (args.scene, self.picture, self.figures)}) < 3:
            raise LeapRayError(
                f"The scene {args.scene}, the picture {self.picture} and the figures "
                f"{self.figures} must be three different files"
            )
        if args.json is None:
            files.check_replaceable(self.figures, is_ours, "name another file by --json")


def targets(args: argparse.Namespace, output: Path, frames: Sequence[int]) -> list[Target]:
    """Of each frame."""
    several = args.frames is not None
    told = resolved(args.json, args.scene) if args.json else None
    shared = several and told is not None and "#" not in told.name
    found = []
    for frame in frames:
        picture = files.numbered(output, frame, several)
        figures = files.numbered(told, frame, False) if told else picture.with_suffix(".json")
        found.append(Target(frame, picture, figures, shared))
    return found


def is_ours(data: dict) -> bool:
    """Whether a JSON file holds the figures of a frame, or of several."""
    frames = data.get("frames")
    first = frames[0] if isinstance(frames, list) and frames else data
    versions = first.get("versions") if isinstance(first, dict) else None
    return isinstance(versions, dict) and "leapray" in versions


def render_one(args, scene, target: Target, told: list[dict], lead: str) -> list[str]:
    """Render a frame and write its files, with the figures of the frames that told holds where
    they share a file; returns its warnings."""
    scene.frame_set(target.frame)
    with part_folder(target.picture) as folder, part_folder(target.figures) as aside:
        picture = folder / f"picture{target.picture.suffix.lower()}"
        set_format(scene, picture)
        reports = render_frame(scene, lead)
        if not reports:
            raise LeapRayError(f"No view layer of scene '{scene.name}' is used for rendering")
        if not picture.exists():
            raise LeapRayError("Blender wrote no picture")
        frame = frame_figures(args, target.frame, reports, picture=str(target.picture))
        told.append(frame)
        figures = aside / "figures.json"
        files.write_json(figures, {"frames": told} if target.shared else frame)
        with process.signals_deferred():
            os.replace(figures, target.figures)
            os.replace(picture, target.picture)
    warnings = [warning for layer in reports.values() for warning in layer["warnings"]]
    return list(dict.fromkeys(warnings))


def spec_of(setting: Setting, word: str) -> str:
    """What a setting holds for a name with options; LeapRayError with the nearest name for an
    unknown."""
    assert setting.check is not None
    try:
        return setting.check(word)
    except LeapRayError as error:
        names = list(dict.fromkeys(each.partition(":")[0] for each in setting.names()))
        hint = arguments.nearest(word, names) if word not in names else ""
        raise LeapRayError(f"{error};{hint}" if hint else str(error)) from error


def override(scene, args: argparse.Namespace) -> None:
    """Put the settings that were given into the scene."""
    for name, setting in SETTINGS.items():
        value = getattr(args, name, None)
        if value is None or not setting.in_blender:
            continue
        setattr(scene.leapray, name, value)
        for layer in scene.view_layers if name == "samples" else ():
            layer.samples = 0  # its own, which would count more than the scene's
    if args.threads is not None:
        scene.render.threads_mode = "FIXED" if args.threads else "AUTO"
        scene.render.threads = args.threads or scene.render.threads
    if args.resolution_x or args.resolution_y:  # the pixels that were asked for
        scene.render.resolution_percentage = 100
    for name in ("resolution_x", "resolution_y", "resolution_percentage"):
        value = getattr(args, name.replace("resolution_percentage", "percentage"))
        if value is not None:
            setattr(scene.render, name, value)


# ---- compare, study ------------------------------------------------------


def compare(args: argparse.Namespace) -> int:
    """Hand on to the comparison with Cycles."""
    comparison = arguments.study_module("compare")
    args.scene = resolved(args.scene) if str(args.scene).startswith("~") else args.scene
    check_file(args.scene)
    for name in ("output", "references"):
        path = getattr(args, name)
        setattr(args, name, None if path is None else resolved(path, args.scene))
    if args.cache_folder:
        args.cache_folder = str(resolved(Path(args.cache_folder), args.scene))
    return comparison.main(args)


def study(args: argparse.Namespace) -> int:
    """Hand on to one of the studies."""
    args.output = None if args.output is None else resolved(args.output)
    return arguments.study_module(args.name).main(args)


VERBS = {"render": render, "compare": compare, "study": study}

# ---- blender -c ----------------------------------------------------------


def command(argv: list[str]) -> int:
    """What `blender -c leapray` calls; a signal ends Blender."""
    process.listen()
    try:
        return run(argv)
    except KeyboardInterrupt:
        process.end_by_signal()


def register() -> None:
    global _command
    import bpy

    _command = bpy.utils.register_cli_command("leapray", command)
    if any(words in pairwise(sys.argv) for words in (("-c", "leapray"), ("--command", "leapray"))):
        process.listen()  # Blender has not finished loading


def unregister() -> None:
    global _command
    import bpy

    bpy.utils.unregister_cli_command(_command)
    _command = None


if __name__ == "__main__":
    process.run(run, sys.argv[1:])
