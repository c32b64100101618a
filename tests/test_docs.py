# SPDX-License-Identifier: GPL-3.0-or-later
"""The pages in docs/ say what the code does: they are what their scripts make of it."""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

import pytest

import leapray
from leapray import arrays, voxelization

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS))

import make_architecture  # noqa: E402
import make_library  # noqa: E402
import make_methods  # noqa: E402
import make_settings  # noqa: E402
import walks  # noqa: E402


@pytest.fixture(scope="module")
def library() -> str:
    return make_library.PAGE.read_text(encoding="utf-8")


# ---- the library ---------------------------------------------------------------


@pytest.mark.parametrize("name", leapray.__all__)
def test_every_public_name_is_documented(name, library):
    constant = make_library.is_constant(name)
    text = make_library.CONSTANTS[name] if constant else inspect.getdoc(getattr(leapray, name))
    assert text, f"{name} needs a docstring"
    heading = re.search(rf"^### {re.escape(name)}\n(.*?)(?=^##|\Z)", library, re.M | re.S)
    assert heading, f"{name} is not on the page"
    assert text.splitlines()[0] in heading[1].replace("\\", "")


def public_members() -> list[tuple[type, str]]:
    classes = [getattr(leapray, name) for name in leapray.__all__]
    return [
        (cls, member)
        for cls in classes
        if inspect.isclass(cls)
        for member in make_library.documented_members(cls)
    ]


@pytest.mark.parametrize(("cls", "member"), public_members())
def test_every_public_method_is_documented(cls, member, library):
    text = inspect.getdoc(getattr(cls, member))
    assert text, f"{cls.__name__}.{member} needs a docstring"
    assert f"\n#### {cls.__name__}.{member}\n" in library
    assert make_library.text_of(getattr(cls, member)) in library


def test_no_docstring_is_one_that_python_made_itself():
    for name in leapray.__all__:
        thing = getattr(leapray, name)
        if inspect.isclass(thing):
            assert not (thing.__doc__ or "").startswith(f"{name}("), name


def test_the_page_of_the_library_is_what_its_script_makes(library):
    assert make_library.page() == library, "run docs/make_library.py"


def test_the_worked_example_prints_what_the_page_says(library):
    code, output = re.search(r"```python\n(.*?)```.*?\n```\n(.*?)```", library, re.S).groups()
    assert code == make_library.EXAMPLE.read_text(encoding="utf-8")
    assert output == make_library.run_example()
    assert "solid of" in output  # the mesh is closed
    assert " t 1.55 and inf" in f" {output}".replace("\n", " ")  # the ring is hit, the hole is not


# ---- the architecture ----------------------------------------------------------


def test_the_page_and_the_pictures_of_the_architecture_are_current():
    for path, made in make_architecture.outputs().items():
        assert path.read_text(encoding="utf-8") == made, f"{path.name}: run make_architecture.py"


def test_every_module_is_on_the_page_of_the_architecture():
    text = make_architecture.PAGE.read_text(encoding="utf-8")
    for path in (ROOT / "addon").rglob("*.py"):
        if path.name != "__init__.py":
            assert f"| `{path.relative_to(ROOT / 'addon').as_posix()}` | " in text, path
    for path in (ROOT / "native" / "src").rglob("*.c"):
        module = path.parent.relative_to(ROOT / "native" / "src").as_posix()
        assert f"| `{module}` | " in text, module


def test_arrows_that_are_left_out_follow_from_others():
    graph = {"top": {"middle", "base"}, "middle": {"base"}, "base": set()}
    assert make_architecture.reduced(graph) == {**graph, "top": {"middle"}}
    assert make_architecture.ranks(graph) == {"top": 2, "middle": 1, "base": 0}


# ---- the methods ---------------------------------------------------------------


@pytest.mark.parametrize("entry", leapray.traversers(), ids=lambda entry: entry.name)
def test_every_traverser_has_a_page(entry):
    index = (make_methods.FOLDER / "README.md").read_text(encoding="utf-8")
    assert f"| [{entry.label}]({entry.name}.md) | `{entry.name}` | {entry.source} | " in index
    text = (make_methods.FOLDER / f"{entry.name}.md").read_text(encoding="utf-8")
    assert text.startswith(f"# {entry.label}\n")
    assert f"](pictures/{entry.name}.svg)" in text
    for part in ("Idea", "Guarantee", "How it fails", "When to use it", "Source"):
        assert f"\n## {part}\n" in text
    assert f"(../../native/src/traversers/{entry.name}.c)" in text


@pytest.mark.parametrize("entry", leapray.image_methods(), ids=lambda entry: entry.name)
def test_every_whole_image_method_has_a_page(entry):
    index = (make_methods.FOLDER / "images.md").read_text(encoding="utf-8")
    assert f"| [{entry.label}]({entry.name}.md) | `{entry.name}` | {entry.source} | " in index
    text = (make_methods.FOLDER / f"{entry.name}.md").read_text(encoding="utf-8")
    assert text.startswith(f"# {entry.label}\n")
    for part in ("Idea", "Guarantee", "How it fails", "Figures", "Source"):
        assert f"\n## {part}\n" in text
    assert f"(../../native/src/imaging/{entry.name}.c)" in text


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("filters", tuple(voxelization.FILTERS)),
        ("interpolation", tuple(arrays.INTERPOLATIONS)),
        ("hit_tests", tuple(leapray.HIT_TESTS)),
        ("roots", tuple(leapray.ROOTS)),
        ("normals", tuple(leapray.NORMALS)),
    ],
)
def test_every_other_method_is_on_its_page(page, names):
    text = (make_methods.FOLDER / f"{page}.md").read_text(encoding="utf-8")
    assert not [name for name in names if f"`{name}`" not in text]
    assert f"]({page}.md)" in (make_methods.FOLDER / "README.md").read_text(encoding="utf-8")


def test_the_tables_and_pictures_of_the_methods_are_current():
    for path, made in make_methods.outputs().items():
        assert path.read_text(encoding="utf-8") == made, f"{path.name}: run make_methods.py"


def test_every_picture_is_on_a_page():
    for folder in ("methods/pictures", "architecture"):
        shown = "".join(page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md"))
        for picture in (DOCS / folder).glob("*.svg"):
            assert f"/{picture.name})" in shown, picture.name


def test_the_walk_that_is_drawn_is_the_one_that_goes_through_every_cell():
    """Plane crossings sorted by hand name the same cells as the counters do."""
    structure = leapray.build(walks.volume(), "aw")
    entries = walks.growth(structure)
    end = float(walks.trace(structure).t[0])
    crossed = sorted(
        t
        for axis, size in ((0, walks.WIDTH), (1, walks.HEIGHT))
        for plane in range(-1, size + 1)
        if (t := (plane - walks.ORIGIN[axis]) / walks.DIRECTION[axis]) >= 2.0 - 1e-9
        if t <= end + 1e-9
    )
    assert len(entries) == len(crossed)
    assert entries == pytest.approx(crossed, abs=walks.CLOSE)


def test_regions_that_are_drawn_are_empty():
    surface = walks.surface()
    for entry in leapray.traversers():
        kind = make_methods.SHOWN[entry.name]
        if not entry.exact or kind in ("nodes", "spheres"):
            continue
        structure = leapray.build(walks.volume(), entry)
        boxes = walks.regions(kind, structure, walks.growth(structure))
        assert None not in boxes[:-1], entry.name  # the last is the cell of the hit
        for box in boxes[:-1]:
            cells = {(i, j) for i in range(box[0], box[1] + 1) for j in range(box[2], box[3] + 1)}
            assert not cells & surface, entry.name


def test_the_drift_that_is_drawn_is_that_of_sums_in_32_bits():
    exact = walks.far_cells("aw")
    assert len(exact) > 12
    assert walks.far_cells("aw_accumulate") == exact
    assert walks.far_cells("aw_accumulate:precision=f32") != exact


# ---- the settings --------------------------------------------------------------


def test_the_page_of_the_settings_is_what_its_script_makes():
    found = make_settings.PAGE.read_text(encoding="utf-8")
    assert make_settings.page() == found, "run docs/make_settings.py"


# ---- links ---------------------------------------------------------------------


def pages() -> list[Path]:
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]


@pytest.mark.parametrize("path", pages(), ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_leads_somewhere(path):
    text = path.read_text(encoding="utf-8")
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", prose):
        if re.match(r"\w+:", target):
            continue
        file, _, anchor = target.partition("#")
        there = (path.parent / file) if file else path
        assert there.exists(), f"{path.name} links to {target}"
        if anchor and there.suffix == ".md":
            links = make_library.anchors(there.read_text(encoding="utf-8"))
            assert f"#{anchor}" in links.values(), f"{path.name} links to {target}"


@pytest.mark.parametrize("path", sorted(DOCS.rglob("*.svg")), ids=lambda path: path.name)
def test_pictures_are_small(path):
    assert path.stat().st_size < 40_000
