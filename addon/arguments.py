# SPDX-License-Identifier: GPL-3.0-or-later
"""The words of the command line: verbs, their options, and what is said of a wrong one (no bpy)."""

from __future__ import annotations

import argparse
import difflib
import importlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import leapray
from leapray.arrays import INTERPOLATIONS

from .blender.presets import LOOKS
from .descriptions import number
from .settings import SETTINGS

LAST_FRAME = 1048574  # of Blender, which would quietly clamp
MOST_PERCENT, LEAST_PIXELS, MOST_PIXELS = 32767, 4, 65536  # likewise
VERBS = ("render", "compare", "study")
FRAMES = re.compile(r"(-?\d+)(?:(?:-|\.\.)(-?\d+))?")
CLIP = re.compile(r"([xyz])=(\d*\.?\d+|\d+\.)")


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one sentence, with the nearest word that there is."""

    def __init__(self, **options) -> None:
        super().__init__(**options)
        self._negative_number_matcher = re.compile(r"-\d")  # --frames -5-5 has a value

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"leapray: {self.sentence(message)}\n")

    def sentence(self, message: str) -> str:
        """argparse's message, plainer."""
        name, _, rest = message.removeprefix("argument ").partition(": ")
        choice = re.fullmatch(r"invalid choice: '(.*)' \(choose from (.*)\)", rest)
        if choice:
            word, known = choice[1], re.sub("'", "", choice[2]).split(", ")
            what = {"VERB": f"no verb {word}", "NAME": f"no study {word}"}.get(
                name, f"{name}: invalid choice: '{word}'"
            )
            if name == "VERB" and word.endswith(".blend"):
                return f"{what}; did you mean render {word}?"
            return f"{what};{nearest(word, known)} there are {', '.join(known)}"
        if name == "the following arguments are required":
            verb = self.prog.rpartition(" ")[2]
            there_are = {"VERB": f": {', '.join(VERBS)}", "NAME": f": {', '.join(studies())}"}
            return f"{verb} needs {rest}{there_are.get(rest, '')}"
        if rest.startswith("expected"):
            return f"{name} needs a value"
        return f"{name} {rest}" if rest.startswith("must") else message.removeprefix("argument ")

    def refuse_rest(self, words: list[str]) -> NoReturn:
        """Say what none of the options understands."""
        options = [word for word in words if word.startswith("-")]
        if not options:
            self.error(f"nothing is known to be done with {' '.join(words)}")
        name = options[0].partition("=")[0]
        known = [text for text in self._option_string_actions if text.startswith("--")]
        if re.fullmatch("-[a-z]", name):  # as Blender has them
            meant = next((text for text in known if text.startswith(f"-{name}")), "")
            hint = f" did you mean {meant}?" if meant else ""
        else:
            hint = nearest(name, known)
        self.error(f"no option {name};{hint or f' {self.prog} --help lists what there is'}")


def nearest(word: str, known: Sequence[str]) -> str:
    """ " did you mean ...?" where one of the known words looks like it."""
    close = difflib.get_close_matches(word.lower(), known, 1)
    return f" did you mean {close[0]}?" if close else ""


def parse(argv: list[str]) -> argparse.Namespace:
    """What the words ask for; SystemExit with 2 after a sentence where they cannot be understood,
    with 0 after help. Raises LeapRayError for a study that needs what this Python has not."""
    top, verbs = parser(argv)
    if argv and argv[0].startswith("-") and argv[0] not in ("-h", "--help"):
        top.error(f"the verb comes first, and then {argv[0]}: {', '.join(VERBS)}")
    args, rest = top.parse_known_args(argv)
    if rest:
        verbs[getattr(args, "name", args.verb)].refuse_rest(rest)
    return args


def studies() -> list[str]:
    """The names of the studies: the modules of addon/study that say so by `STUDY = True`."""
    folder = Path(__file__).with_name("study")
    return sorted(
        path.stem for path in folder.glob("*.py") if "\nSTUDY = True\n" in path.read_text("utf-8")
    )


def study_module(name: str):
    """A module of addon/study; LeapRayError where it needs what this Python has not."""
    try:
        return importlib.import_module(f".study.{name}", __package__)
    except ModuleNotFoundError as error:
        raise leapray.LeapRayError(
            f"{name} needs {error.name}, which this Python has not; start it by build.py"
        ) from error


def clip(word: str) -> tuple[str, float]:
    """An axis, and a share of the data's box along it."""
    found = CLIP.fullmatch(word)
    if not found or not 0.0 <= float(found[2]) <= 1.0:
        raise argparse.ArgumentTypeError(f"must be as z=0.5, from 0 to 1 of x, y or z, not {word}")
    return found[1], float(found[2])


def parser(argv: Sequence[str] = ()) -> tuple[Parser, dict[str, Parser]]:
    """The words there are, and those of each verb and study. A study's own options are known only
    where argv names it, as they take what it needs to be looked up."""
    top = Parser(
        prog="leapray", description="Render scenes of Blender as volumes, compare, measure."
    )
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")

    verb = verbs.add_parser("render", help="render a frame of a scene, or several; or a scan")
    verb.add_argument(
        "scene",
        type=Path,
        metavar="SCENE.blend|DATA",
        help="a scene; or measured data, round which one is made: NIfTI, NRRD, MRC, TIFF, OpenVDB, "
        "raw numbers, DICOM files or a folder of them",
    )
    verb.add_argument(
        "--threshold",
        type=number(None, None, float),
        metavar="X",
        help="of measured data: the value on the surface, in their units; default: found in them",
    )
    verb.add_argument(
        "--clip",
        type=clip,
        metavar="x|y|z=SHARE",
        help="of measured data: cut them open across an axis, so far along their box, 0 to 1, and "
        "show the values on the cut in grey",
    )
    verb.add_argument(
        "--interpolation",
        choices=list(INTERPOLATIONS),
        help="of measured data: the field between the samples; default: linear",
    )
    verb.add_argument(
        "--preset",
        choices=list(LOOKS),
        help="of measured data: show a volume without a surface, by a look for data of that kind",
    )
    verb.add_argument(
        "--output",
        type=Path,
        help="OUT.png, or OUT.exr with all passes; default: SCENE.png here. // is the scene's "
        "folder, ### the frame's number",
    )
    verb.add_argument(
        "--json",
        type=Path,
        metavar="FILE",
        help="default: beside the picture; of several frames one file, unless its name has ###",
    )
    which = verb.add_mutually_exclusive_group()
    which.add_argument(
        "--frame",
        type=frame_number,
        metavar="N",
        help="default: the scene's current frame",
    )
    which.add_argument(
        "--frames",
        type=frame_numbers,
        metavar="A-B",
        help="all from A to B, or a list as 1-3,7; the pictures are numbered",
    )
    verb.add_argument(
        "--percentage",
        type=number(1, MOST_PERCENT),
        metavar="P",
        help="of the resolution; default: the scene's, 100 where one of the next two is given",
    )
    verb.add_argument(
        "--pixel",
        type=pixel,
        metavar="X,Y",
        help="render this pixel alone and print what happens on its paths: rays, cells, hits, "
        "lights; no picture is written, --json FILE takes the same as data. As in Blender's image "
        "editor 0,0 is the lower left pixel",
    )
    for axis, of in (("x", "the picture's width"), ("y", "its height")):
        verb.add_argument(
            f"--resolution-{axis}",
            type=number(LEAST_PIXELS, MOST_PIXELS),
            metavar="N",
            help=f"{of} in pixels; default: the scene's",
        )
    add_settings(verb)

    verb = verbs.add_parser("compare", help="the same frame by Cycles and by LeapRay")
    verb.add_argument("scene", type=Path, metavar="SCENE.blend")
    verb.add_argument("--output", type=Path, metavar="DIR", help="default: SCENE-compare here")
    verb.add_argument("--traversers", metavar="all|A,B,..", help="default: the default one")
    add_setting(verb, "samples", default=16)
    verb.add_argument("--reference", type=number(1), metavar="N", help="default: 8 times --samples")
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
    add_setting(verb, "diffuse_bounces")
    verb.add_argument(
        "--curve", type=number(1), metavar="N", help="chart both engines at 1, 4, 16 .. N samples"
    )
    verb.add_argument(
        "--percentage", type=number(1, MOST_PERCENT), metavar="P", help="of the resolution"
    )
    for name in ("cache_folder", "threads"):
        add_setting(verb, name)

    verb = verbs.add_parser("study", help="measure speed, accuracy, stability")
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
    return top, {**verbs.choices, **names.choices}


def add_settings(verb: Parser) -> None:
    """Options that replace settings of the scene; what is not given stays the scene's."""
    for name, setting in SETTINGS.items():
        if setting.option:
            add_setting(verb, name)


def add_setting(verb: Parser, name: str, **changes) -> None:
    """The option of a setting; None where it is not given."""
    setting = SETTINGS[name]
    more: dict[str, Any] = {}
    if setting.kind is bool:
        more["action"] = argparse.BooleanOptionalAction
    elif setting.check is not None:  # by the verb, with the nearest word
        more["metavar"] = "NAME"
        entries = dict.fromkeys(name.partition(":")[0] for name in setting.names())
        more["help"] = f"{setting.tooltip}: {', '.join(entries)}"
    elif setting.choices:
        more["choices"] = setting.names()
    elif setting.kind is str:
        more["metavar"] = "DIR"
    else:
        least = setting.minimum if not setting.zero_word else 1
        more["type"] = number(least, setting.maximum, setting.kind, setting.zero_word)
        letter = "N" if setting.kind is int else "X"
        more["metavar"] = f"{setting.zero_word}|{letter}" if setting.zero_word else letter
    words = {"help": setting.tooltip} | more | changes
    verb.add_argument(f"--{name.replace('_', '-')}", **words)


def pixel(word: str) -> tuple[int, int]:
    """A type for argparse: the column and row of "X,Y"."""
    numbers = re.fullmatch(r"(-?\d+),(-?\d+)", word)
    if not numbers:
        raise argparse.ArgumentTypeError(f"must be like 120,45, not {word}")
    return int(numbers[1]), int(numbers[2])


frame_number = number(-LAST_FRAME, LAST_FRAME)


def frame_numbers(word: str) -> list[int]:
    """A type for argparse: the frames of "A-B", "A..B", "A", or of a list of those, in order."""
    found: dict[int, None] = {}
    for part in word.split(","):
        ends = FRAMES.fullmatch(part.strip())
        if not ends:
            raise argparse.ArgumentTypeError(f"must be like 1-24 or 1-3,7, not {word}")
        first, last = (frame_number(end) for end in (ends[1], ends[2] or ends[1]))
        if last < first:
            raise argparse.ArgumentTypeError(f"must go upwards, not as {part.strip()}")
        found.update(dict.fromkeys(range(first, last + 1)))
    return list(found)
