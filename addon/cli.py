# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: `build.py VERB`, `python -m addon.cli VERB`, `blender -c leapray VERB`.

A picture is rendered into a folder of its own beside the place asked for and
then renamed, so that a picture that is there is whole. What Blender prints to
standard output is kept from it: the last line says where the result is.
"""

from __future__ import annotations

import argparse
import contextlib
import glob
import importlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path

import leapray
from leapray import LeapRayError
from leapray.voxelization import FILTERS

from . import model
from .session import check_file, open_scene, render_frame, set_format

DEFAULTS = model.Settings()
FORMATS = (".png", ".exr")
MOST_THREADS, LAST_FRAME = 1024, 1048574  # of Blender, which would quietly clamp
_command = None  # Blender's handle of the registered command


def main(argv: list[str]) -> int:
    """Do what the words say; returns the exit code, 0 only when the result exists."""
    try:
        args = parser(argv).parse_args(argv)
        return args.run(args)
    except SystemExit as ended:  # argparse has said why
        return ended.code if isinstance(ended.code, int) else 1
    except KeyboardInterrupt:
        say("interrupted")
        return 130
    except LeapRayError as error:
        say(str(error))
        return 1


def say(sentence: str) -> None:
    print(f"leapray: {sentence}", file=sys.stderr, flush=True)


# ---- words ---------------------------------------------------------------


def parser(argv: Sequence[str] = ()) -> argparse.ArgumentParser:
    """The words there are. A study's own options are known only where argv names it, as they
    take what it needs to be looked up."""
    top = argparse.ArgumentParser(
        prog="leapray", description="Render scenes of Blender as volumes, compare, measure."
    )
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")

    verb = verbs.add_parser("render", help="render one frame of a scene")
    verb.set_defaults(run=render)
    verb.add_argument("scene", type=Path, metavar="SCENE.blend")
    verb.add_argument(
        "--output", type=Path, help="OUT.png, or OUT.exr with all passes; default: SCENE.png here"
    )
    verb.add_argument("--json", type=Path, metavar="FILE", help="default: beside the picture")
    verb.add_argument(
        "--frame",
        type=frame_number,
        metavar="N",
        help="default: the scene's current frame",
    )
    add_settings(verb)

    verb = verbs.add_parser("compare", help="the same frame by Cycles and by LeapRay")
    verb.set_defaults(run=compare)
    verb.add_argument("scene", type=Path, metavar="SCENE.blend")
    verb.add_argument("--output", type=Path, metavar="DIR", help="default: SCENE-compare here")
    verb.add_argument("--traversers", metavar="all|A,B,..", help="default: the default one")
    verb.add_argument("--samples", type=count(1), default=16, metavar="N", help="per pixel")
    verb.add_argument("--reference", type=count(1), metavar="N", help="default: 8 times --samples")
    verb.add_argument(
        "--references",
        type=Path,
        metavar="DIR",
        help="where reference frames are kept, to be read instead of rendered by the next run",
    )
    verb.add_argument(
        "--frame",
        type=frame_number,
        metavar="N",
        help="default: the scene's current one",
    )
    verb.add_argument(
        "--world",
        choices=["scene", "black"],
        default="scene",
        help="black: the lights alone give light",
    )
    verb.add_argument(
        "--materials",
        choices=["scene", "plain"],
        default="scene",
        help="plain: all diffuse, and light does not bounce",
    )
    verb.add_argument(
        "--diffuse-bounces", type=count(0), metavar="N", help="of both; default: the scene's"
    )
    verb.add_argument(
        "--curve", type=count(1), metavar="N", help="chart both engines at 1, 4, 16 .. N samples"
    )
    verb.add_argument("--percentage", type=count(1), metavar="P", help="of the resolution")
    verb.add_argument(
        "--cache-folder",
        metavar="DIR",
        help="where volumes are kept as .vdb files, to be read instead of made by the next run",
    )
    verb.add_argument("--threads", type=count(0, MOST_THREADS), metavar="N", help="0: all cores")

    verb = verbs.add_parser("study", help="measure speed, accuracy, stability")
    verb.set_defaults(run=study)
    names = verb.add_subparsers(
        dest="name", required=True, metavar="NAME", help=", ".join(studies())
    )
    for name in studies():
        each = names.add_parser(name)
        each.add_argument("--output", type=Path, metavar="DIR", help="default: a folder here")
        each.add_argument("--quick", action="store_true", help="fewer, smaller measurements")
        if "study" in argv[:1] and name in argv:
            module = study_module(name)
            each.description = module.__doc__.splitlines()[0]
            module.add_arguments(each)
    return top


def add_settings(verb: argparse.ArgumentParser) -> None:
    """Options that replace settings of the scene; what is not given stays the scene's."""
    verb.add_argument("--samples", type=count(1), metavar="N", help="rays per pixel")
    for kind in ("max", "diffuse", "glossy", "transmission", "transparent"):
        of = "in all" if kind == "max" else f"by {kind} surfaces"
        verb.add_argument(
            f"--{kind}-bounces", type=count(0), metavar="N", help=f"most bounces of light {of}"
        )
    verb.add_argument(
        "--noise-threshold",
        type=float,
        metavar="X",
        help="where a pixel has enough samples; 0: never",
    )
    verb.add_argument(
        "--min-samples", type=count(0), metavar="N", help="before noise is judged; 0: as suits it"
    )
    verb.add_argument("--pixel-filter", choices=list(leapray.PIXEL_FILTERS))
    verb.add_argument("--filter-width", type=float, metavar="X", help="of the pixel filter, pixels")
    verb.add_argument("--clamp-direct", type=float, metavar="X", help="light of a sample; 0: off")
    verb.add_argument("--clamp-indirect", type=float, metavar="X", help="after bounces; 0: off")
    verb.add_argument(
        "--ambient-distance", type=float, metavar="X", help="fast stand-in for bounces; 0: off"
    )
    verb.add_argument("--ao-distance", type=float, metavar="X", help="reach of ambient occlusion")
    verb.add_argument("--seed", type=count(0), metavar="N", help="another pattern of rays")
    verb.add_argument(
        "--traverser",
        metavar="NAME",
        help=", ".join(entry.name for entry in leapray.traversers()),
    )
    verb.add_argument("--hit-test", choices=list(leapray.HIT_TESTS))
    verb.add_argument("--root", choices=list(leapray.ROOTS))
    verb.add_argument("--normal", choices=list(leapray.NORMALS))
    verb.add_argument("--layout", choices=model.LAYOUTS)
    verb.add_argument("--filter", choices=list(FILTERS), help="of the volumes' samples")
    verb.add_argument(
        "--resolution",
        type=auto_or_count,
        metavar="auto|N",
        help="samples along the longest side of each volume",
    )
    verb.add_argument(
        "--pixel-error",
        type=float,
        metavar="X",
        help=f"of a pixel, for --resolution auto; {DEFAULTS.pixel_error} unless the scene says so",
    )
    verb.add_argument(
        "--half-width", type=float, metavar="X", help="of that filter, voxels; 0: as suits"
    )
    verb.add_argument("--exact", choices=list(model.EXACT), help="whose cells keep their triangles")
    verb.add_argument("--sample-type", choices=list(model.SAMPLE_TYPES), help="of the volumes")
    verb.add_argument("--memory-mb", type=count(1), metavar="N", help="for all volumes")
    verb.add_argument(
        "--cache-folder",
        metavar="DIR",
        help="where volumes are kept as .vdb files, to be read instead of made by the next run",
    )
    verb.add_argument("--threads", type=count(0, MOST_THREADS), metavar="N", help="0: all cores")


def count(least: int, most: int = 2**31 - 1):
    """A type for argparse: an integer from least to most, as Blender can hold it."""

    def number(word: str) -> int:
        value = int(word)
        if value < least:
            raise argparse.ArgumentTypeError(f"must be at least {least}, not {value}")
        if value > most:
            raise argparse.ArgumentTypeError(f"must be at most {most}, not {value}")
        return value

    number.__name__ = "integer"  # argparse shows it
    return number


def auto_or_count(word: str) -> int:
    """A type for argparse: "auto", which is 0, or an integer from 1 on."""
    return 0 if word == "auto" else count(1)(word)


auto_or_count.__name__ = '"auto" or integer'
frame_number = count(-LAST_FRAME, LAST_FRAME)

# ---- verbs ---------------------------------------------------------------


def render(args: argparse.Namespace) -> int:
    """Render a frame; writes the picture and the JSON beside it."""
    check_file(args.scene)
    output = Path(args.output or f"{args.scene.stem}.png")
    report = Path(args.json or output.with_suffix(".json"))
    if output.suffix.lower() not in FORMATS:
        raise LeapRayError(f"--output must end in {' or '.join(FORMATS)}, and is {output}")
    for path in (output, report):
        check_folder(path)
    if len({path.resolve() for path in (args.scene, output, report)}) < 3:
        raise LeapRayError(
            f"The scene {args.scene}, the picture {output} and the figures {report} "
            "must be three different files"
        )
    if args.traverser is not None:
        args.traverser = leapray.traverser(args.traverser).spec  # refuses an unknown one

    scene = open_scene(args.scene)
    import bpy

    override(scene, args)
    frame = scene.frame_current if args.frame is None else args.frame
    scene.frame_set(frame)
    if args.threads is not None:
        scene.render.threads_mode = "FIXED" if args.threads else "AUTO"
        scene.render.threads = args.threads or scene.render.threads

    with part_folder(output) as folder, part_folder(report) as aside:
        picture = folder / f"picture{output.suffix.lower()}"
        set_format(scene, picture)
        reports = render_frame(scene)
        if not reports:
            raise LeapRayError(f"No view layer of scene '{scene.name}' is used for rendering")
        if not picture.exists():
            raise LeapRayError("Blender wrote no picture")
        told = {
            "scene": str(args.scene),
            "frame": frame,
            "picture": str(output),
            "blender": bpy.app.version_string,
            **next(iter(reports.values())),
        }
        if len(reports) > 1:
            told["view_layers"] = reports
        figures = aside / "figures.json"
        figures.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
        os.replace(figures, report)
        os.replace(picture, output)
    for warning in dict.fromkeys(w for layer in reports.values() for w in layer["warnings"]):
        say(f"warning: {warning}")
    print(f"{output}, and its figures in {report}", flush=True)
    return 0


def compare(args: argparse.Namespace) -> int:
    """Hand on to the comparison with Cycles."""
    return hand_on("compare", args)


def study(args: argparse.Namespace) -> int:
    """Hand on to one of the studies."""
    return hand_on(args.name, args)


def studies() -> list[str]:
    """The names of the studies: the modules of addon/study that say so by `STUDY = True`."""
    folder = Path(__file__).with_name("study")
    return sorted(
        path.stem for path in folder.glob("*.py") if "\nSTUDY = True\n" in path.read_text("utf-8")
    )


def hand_on(name: str, args: argparse.Namespace) -> int:
    """Run a module of addon/study."""
    return study_module(name).main(args)


def study_module(name: str):
    """A module of addon/study; LeapRayError where it needs what this Python has not."""
    try:
        return importlib.import_module(f".study.{name}", __package__)
    except ModuleNotFoundError as error:
        raise LeapRayError(
            f"{name} needs {error.name}, which this Python has not; start it by build.py"
        ) from error


def override(scene, args: argparse.Namespace) -> None:
    """Put the settings that were given into the scene, which would quietly clamp them."""
    for field in fields(model.Settings):
        value = getattr(args, field.name, None)
        known = scene.leapray.bl_rna.properties.get(field.name)
        if value is None or known is None:  # not given; threads is Blender's
            continue
        if not isinstance(value, str) and not known.hard_min <= value <= known.hard_max:
            raise LeapRayError(
                f"{known.name} must lie between {known.hard_min:g} and {known.hard_max:g}, "
                f"and is {value}"
            )
        setattr(scene.leapray, field.name, value)
        for layer in scene.view_layers if field.name == "samples" else ():
            layer.samples = 0  # its own, which would count more than the scene's


# ---- files ---------------------------------------------------------------


def check_folder(path: Path) -> None:
    """Raise LeapRayError where a file could not be written there."""
    if path.is_dir():
        raise LeapRayError(f"{path} is a folder, not a file to write")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise LeapRayError(f"The output folder {folder} does not exist")
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise LeapRayError(
            f"The output folder {folder} cannot be written to: {error.strerror}"
        ) from error


@contextlib.contextmanager
def part_folder(output: Path) -> Iterator[Path]:
    """A folder beside output for what is not complete; gone afterwards.

    All that a killed process leaves lies in such folders. One is locked while in
    use, so that those of killed processes can be told and cleared away.
    """
    parent, name = output.absolute().parent, f".{output.name}."
    for old in parent.glob(f"{glob.escape(name)}*.part"):
        with contextlib.suppress(OSError), locked(old):
            shutil.rmtree(old)
    folder = Path(tempfile.mkdtemp(prefix=name, suffix=".part", dir=parent))
    try:
        with locked(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder's lock; OSError where another process has it."""
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


# ---- blender -c ----------------------------------------------------------


def register() -> None:
    global _command
    import bpy

    _command = bpy.utils.register_cli_command("leapray", main)


def unregister() -> None:
    global _command
    import bpy

    bpy.utils.unregister_cli_command(_command)
    _command = None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
