# SPDX-License-Identifier: GPL-3.0-or-later
"""The words of the command line, the paths in them, and the files that it writes (no render)."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

import leapray
from addon import arguments, cli
from addon.store import files
from leapray import LeapRayError

FIRST = leapray.traversers()[0].name

# ---- wrong words -------------------------------------------------------------

WRONG = {
    "rendr a.blend": "no verb rendr; did you mean render? there are render, compare, study",
    "a.blend": "no verb a.blend; did you mean render a.blend?",
    "--samples 3 render a.blend": "the verb comes first, and then --samples",
    "study phantm": "no study phantm; did you mean phantom? there are accuracy,",
    "study": "study needs NAME: accuracy,",
    "": "leapray needs VERB: render, compare, study",
    "render": "render needs SCENE.blend",
    "render a.blend --sampels 3": "no option --sampels; did you mean --samples?",
    "render --sampels 3 a.blend": "no option --sampels; did you mean --samples?",
    "render a.blend --sampels=3": "no option --sampels; did you mean --samples?",
    "render a.blend -o x.png": "no option -o; did you mean --output?",
    "render a.blend -f 3": "no option -f; did you mean --frame?",
    "render a.blend --quux": "no option --quux; leapray render --help lists what there is",
    "render a.blend b.blend": "nothing is known to be done with b.blend",
    "render a.blend --samples": "--samples needs a value",
    "render a.blend --samples many": "--samples: invalid integer value: 'many'",
    "render a.blend --samples 0": "--samples must be at least 1, not 0",
    "render a.blend --hit-test face": "--hit-test: invalid choice: 'face'; did you mean faces? "
    "there are extrema, faces, uniform",
    "render a.blend --frame 1 --frames 1-2": "--frames: not allowed with argument --frame",
    "render a.blend --frames 5-1": "--frames must go upwards, not as 5-1",
    "render a.blend --frames 1-": "--frames must be like 1-24 or 1-3,7, not 1-",
    "render a.blend --frames 1-1048575": "--frames must be at most 1048574, not 1048575",
    "render a.blend --percentage 0": "--percentage must be at least 1, not 0",
    "render a.blend --percentage 32768": "--percentage must be at most 32767, not 32768",
    "render a.blend --resolution-x 3": "--resolution-x must be at least 4, not 3",
    "render a.blend --resolution-y 65537": "--resolution-y must be at most 65536, not 65537",
    "compare a.blend --percentage 40000": "--percentage must be at most 32767, not 40000",
    "compare a.blend --traverser x --wrold black": "no option --wrold; did you mean --world?",
    "study phantom --quik": "no option --quik; did you mean --quick?",
}


@pytest.mark.parametrize("words", WRONG)
def test_a_wrong_word_is_one_sentence_with_the_nearest_right_one(words, capfd):
    assert cli.main(words.split()) == 2
    out, err = capfd.readouterr()
    assert out == "" and err.startswith(f"leapray: {WRONG[words]}") and err.count("\n") == 1, err


def test_an_unknown_traverser_gets_the_nearest(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    Path("a.blend").touch()
    assert cli.main(["render", "a.blend", "--traverser", FIRST + "x"]) == 1
    err = capfd.readouterr().err
    assert f"; did you mean {FIRST}?" in err and "there are " in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("word", "frames"),
    [
        ("3", [3]),
        ("1-4", [1, 2, 3, 4]),
        ("1..3", [1, 2, 3]),
        ("-2-1", [-2, -1, 0, 1]),
        ("-3--2", [-3, -2]),
        ("7,1-2,2", [7, 1, 2]),
    ],
)
def test_frames_are_ranges_and_lists(word, frames):
    assert arguments.parse(["render", "a.blend", "--frames", word]).frames == frames


# ---- paths -------------------------------------------------------------------


def test_paths_are_meant_as_blender_and_the_shell_have_them(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    scene = Path("somewhere/a.blend")
    here = Path.cwd() / "somewhere"
    for written, meant in {
        "x.png": Path("x.png"),
        "/x.png": Path("/x.png"),
        "//x.png": here / "x.png",
        "//sub/../x.png": here / "sub/../x.png",
        "~/x.png": tmp_path / "x.png",
        "a~/x.png": Path("a~/x.png"),
    }.items():
        assert files.resolved(Path(written), scene) == meant
    with pytest.raises(LeapRayError, match="no-such-user/x is not known"):
        files.resolved(Path("~no-such-user/x"))
    with pytest.raises(LeapRayError, match=r"// is the folder of a \.blend, and there is none"):
        files.resolved(Path("//x"))


@pytest.mark.parametrize(
    ("name", "frame", "several", "want"),
    [
        ("out.png", 7, False, "out.png"),
        ("out.png", 7, True, "out0007.png"),
        ("out_.png", 12345, True, "out_12345.png"),
        ("out.png", -7, True, "out-0007.png"),
        ("out_##.png", 7, True, "out_07.png"),
        ("out_##.png", 123, False, "out_123.png"),
        ("#a_###.b.png", 7, True, "#a_007.b.png"),
        ("f#/out.png", 7, False, "f#/out.png"),
    ],
)
def test_names_are_numbered_as_blender_numbers_them(name, frame, several, want):
    assert files.numbered(Path(name), frame, several) == Path(want)


REFUSED = [
    (["--output", "//no/a.png"], "no does not exist"),
    (["--output", "//"], "must end in .png or .exr"),
    (["--output", "~no-such-user/a.png"], "The home folder in"),
    (["--json", "//no/a.json"], "no does not exist"),
    (["--frames", "1-3", "--output", "a#.png", "--json", "./a2.png"], "three different files"),
]


@pytest.mark.parametrize(("words", "sentence"), REFUSED)
def test_paths_that_cannot_be_are_refused_before_blender_loads(
    tmp_path, monkeypatch, capfd, words, sentence
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "open_scene", lambda path: pytest.fail("it was opened"))
    Path("a.blend").touch()
    assert cli.main(["render", "a.blend", *words]) == 1
    err = capfd.readouterr().err
    assert sentence in err and err.count("\n") == 1
    assert os.listdir() == ["a.blend"]


# ---- JSON --------------------------------------------------------------------


def test_json_holds_no_nan_and_no_infinity(tmp_path):
    nan, inf = float("nan"), float("inf")
    told = {
        "a": nan,
        "b": [inf, 1.5, (-inf, "NaN")],
        "c": np.float32(nan),
        "d": np.array([1.0, inf]),
        "e": {"f": np.int64(3), "g": Path("x"), 1: True},
    }
    files.write_json(tmp_path / "a.json", told)
    found = json.loads((tmp_path / "a.json").read_text(), parse_constant=pytest.fail)
    want = {"f": 3, "g": "x", "1": True}
    assert found == {
        "a": None,
        "b": [None, 1.5, [None, "NaN"]],
        "c": None,
        "d": [1, None],
        "e": want,
    }


FOREIGN = ["", "{}", "[]", '{"versions": 3}', "no json", '{"frames": []}', "\xff", "[" * 99999]


@pytest.mark.parametrize("text", FOREIGN, ids=range(len(FOREIGN)))
@pytest.mark.parametrize("words", [[], ["--frames", "1-2"], ["--output", "b.exr"]])
def test_a_json_file_of_others_is_not_replaced_unless_it_is_named(
    tmp_path, monkeypatch, capfd, text, words
):
    monkeypatch.chdir(tmp_path)
    opened = []
    monkeypatch.setattr(cli, "open_scene", lambda path: opened.append(path) or exit(7))
    Path("a.blend").touch()
    name = {"--frames": "a0002.json", "--output": "b.json"}.get("".join(words[:1]), "a.json")
    Path(name).write_text(text, "latin-1")
    assert cli.main(["render", "a.blend", *words]) == 1
    err = capfd.readouterr().err
    assert f"{name} was not written by LeapRay" in err and "--json" in err and not opened
    assert Path(name).read_text("latin-1") == text
    assert cli.main(["render", "a.blend", *words, "--json", name]) == 7 and opened


def test_a_json_file_of_ours_is_replaced():
    one = {"versions": {"leapray": "0"}}
    assert cli.is_ours(one) and cli.is_ours({"frames": [one, one]})


@pytest.mark.parametrize("words", [["study", "phantom"], ["compare", "a.blend"]])
def test_a_study_replaces_no_json_file_of_others(tmp_path, monkeypatch, capfd, words):
    monkeypatch.chdir(tmp_path)
    Path("a.blend").touch()
    Path("out").mkdir()
    for name in ("report.json", "phantom.json"):
        Path("out", name).write_text("{}")
    assert cli.main([*words, "--output", "out"]) == 1
    assert "was not written by LeapRay" in capfd.readouterr().err
    assert sorted(os.listdir("out")) == ["phantom.json", "report.json"]
