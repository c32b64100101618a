# SPDX-License-Identifier: GPL-3.0-or-later
"""The architecture holds: dependencies, modules, names, licences, lengths.

What is checked here is read from the source text, by Python's own parser or by
line; nothing but the traversers' names comes from the running core.
"""

from __future__ import annotations

import ast
import ctypes
import importlib.metadata
import re
import shutil
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

import build
import build_core
import leapray
from leapray import _abi, _lib

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "docs"))

import dependencies  # noqa: E402

LONGEST = 600  # lines; a file past some 500 usually has two purposes

# Each layer imports from layers above it in this list, or from its own.
LAYERS = {
    "leapray": [
        "_abi",
        "_lib",
        "arrays file_samples options scalar_grid threads",
        "programs thresholds formats.common",
        "formats.mrc formats.nifti formats.nrrd formats.raw formats.slices formats.tiff",
        "formats.dicom formats.vdb",
        "formats",
        "transfer volume attributes",
        "scalar_source",
        "isosurfaces label_volume leaf_filters scalar_filters",
        "visible_volumes",
        "voxelization tracing",
        "scene_parts",
        "rendering",
        "imaging",
        "__init__",
    ],
    "bench": [
        "__init__",
        "inputs libraries",
        "benchmarks results",
        "run worker",
    ],
    "addon": [
        "blender blender.read plan store",
        "arrays descriptions memory",
        "methods",
        "settings",
        "model process",
        "store.files",
        "plan.culling plan.light_planes plan.mesh_colors plan.objects plan.planned",
        "plan.fastest plan.mesh_split",
        "plan.probes",
        "tiles store.volume_files",
        "plan.error_metric plan.field_filters plan.proximity plan.sample_types",
        "store.disk_cache store.grid_cache store.memory_cache",
        "plan.ahead plan.clips plan.label_solids plan.levels plan.looks plan.other_grids",
        "plan.doubts plan.fields plan.separation",
        "plan.refinement",
        "plan.plan",
        "pixel_report",
        "film",
        "image_method projection",
        "pipeline",
        "blender.read.colors blender.read.links blender.read.node_values blender.read.nodes",
        "blender.read.phases",
        "blender.read.images blender.read.matrices blender.read.warnings",
        "blender.read.shaders blender.read.textures",
        "blender.read.looks",
        "blender.read.materials",
        "blender.read.lights blender.read.meshes",
        "blender.read.clips blender.read.labels blender.read.sequences",
        "blender.read.scene blender.read.volumes blender.result blender.properties blender.presets",
        "blender.engine blender.volume_data blender.volume_looks",
        "blender.open_file",
        "blender.data_scene",
        "study",
        "arguments",
        "cli blender.operators blender.ui_report",
        "blender.ui",
        "__init__",
    ],
}
C_LAYERS = [
    "base",
    "grid grid/attributes",
    "mesh distance",
    "voxelize trace",
    "traversers render/film render/lights render/bsdf",
    "imaging render/scene",
    "render/integrator",
]
WITHOUT_BLENDER = (
    *("addon.model", "addon.blender.presets", "addon.plan.plan", "addon.pipeline", "addon.tiles"),
    *("leapray", "bench"),
)
BLENDER = {"bpy", "bpy_extras", "bmesh", "gpu", "mathutils", "bl_math", "blf", "imbuf"}


@cache
def files(*patterns: str) -> list[Path]:
    """Files of the project that git knows or would add."""
    safe = f"safe.directory={ROOT}"  # another user's checkout, too
    command = ["git", "-c", safe, "ls-files", "-co", "--exclude-standard", "-z", "--", *patterns]
    if not (ROOT / ".git").exists() or not shutil.which("git"):
        found = (path for pattern in patterns for path in ROOT.rglob(pattern))
        return sorted(path for path in found if ".venv" not in path.parts)
    listing = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout
    paths = (ROOT / name for name in listing.decode().split("\0") if name)
    return sorted(path for path in paths if path.exists())


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def name_of(path: Path) -> str:
    """The dotted name of a module, without a trailing __init__."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[1:] if parts[0] == "native" else parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> dict[str, Path]:
    paths = files("addon/*.py", "native/leapray/*.py", "native/bench/*.py")
    return {name_of(path): path for path in paths}


def package_of(name: str) -> str:
    return name.rpartition(".")[0]


@cache
def imports(name: str) -> frozenset[str]:
    """All that a module imports, anywhere in it: our modules in full, others by their top name."""
    path = modules()[name]
    package = name if path.name == "__init__.py" else package_of(name)
    found: set[str] = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1]
            base = ".".join(above if node.level else []) + "." * bool(node.level and node.module)
            base += node.module or ""
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                found.add(whole if whole in modules() else base)
    return frozenset(item if item in modules() else item.partition(".")[0] for item in found)


def layer_of(name: str) -> int | None:
    top, _, rest = name.partition(".")
    module = "study" if rest.startswith("study") else rest or "__init__"
    for index, layer in enumerate(LAYERS[top]):
        if module in layer.split():
            return index
    return None


# ---- dependencies ----------------------------------------------------------------


def test_every_module_has_its_layer():
    homeless = [name for name in modules() if layer_of(name) is None]
    assert not homeless, f"name a layer for {homeless} in this file"


def test_no_import_runs_back():
    back = []
    for name in modules():
        for target in imports(name) & modules().keys():
            if target.partition(".")[0] != name.partition(".")[0]:
                if not target.startswith("leapray"):
                    back.append(f"{name} -> {target}: of other packages only leapray is imported")
            elif not name.startswith(f"{target}.") and layer_of(target) > layer_of(name):
                back.append(f"{name} -> {target}")
    assert not back, back


def test_no_import_runs_in_a_circle():
    done: set[str] = set()

    def visit(name: str, path: tuple[str, ...]) -> None:
        assert name not in path, " -> ".join((*path, name))
        if name not in done:
            for target in imports(name) & modules().keys() - {name}:
                if not name.startswith(f"{target}."):  # a package imports its own modules
                    visit(target, (*path, name))
            done.add(name)

    for name in modules():
        visit(name, ())
    assert len(done) == len(modules())


def test_modules_without_blender_reach_none_of_it():
    todo = [name for name in modules() if name.startswith(WITHOUT_BLENDER)]
    assert len(todo) > 8
    seen = set(todo)
    while todo:
        name = todo.pop()
        guilty = imports(name) & BLENDER
        assert not guilty, f"{name} imports {guilty}"
        new = (imports(name) & modules().keys()) - seen - {"addon"}
        seen |= new
        todo += new


def test_modules_of_the_core_include_no_module_above_them():
    rank = {module: index for index, layer in enumerate(C_LAYERS) for module in layer.split()}
    back = []
    for path in files("native/src/*.[ch]", "native/src/*.def"):
        module = path.relative_to(ROOT / "native" / "src").parent.as_posix()
        for target in re.findall(r'^#include "([^"]+)"', path.read_text(), re.MULTILINE):
            if target == "leapray.h":
                continue
            above = target.rpartition("/")[0]
            assert module in rank and above in rank, f"name a layer for {module} and {above}"
            beside = rank[above] == rank[module] and above != module
            if rank[above] > rank[module] or (beside and not module.startswith("grid")):
                back.append(f"{path.name} includes {target}")
    assert not back, back


# ---- files of the core -----------------------------------------------------------

SOURCE = ROOT / "native" / "src"

# What only grid/ may write: the store's arrays, entries, bits and sizes.
LAYOUT = re.compile(
    r"->table\b|\.table\[|(?<!counters)(?<!tile)(?<!record)->samples\b|->cells\[|->ids\[|->block_of\b"
    r"|\bLR_BRICK\w*|\bLR_FIRST_STORED\b|\blr_(?:word|bit)_of\b|\bentry\w* >> 8"
    r"|>> 3\b|& ~?7\b|\b512\b|\b(?:8|64) \*|\[8\]\[8\]"
)
NO_LAYOUT = {  # what looks like it, and is
    ("distance/chamfer.c", "8 *"): "the weight of a step eight cells on",
    ("mesh/closest_triangle.h", ">> 3"): "lanes of a tile",
    ("render/film/pixel_filter.h", "512"): "entries of a filter's table",
    ("traversers/smart.c", ">> 3"): "a digit of a Morton code",
    ("traversers/smart.c", "& 7"): "a digit of a Morton code",
    ("voxelize/brick_jobs.c", "64 *"): "bytes of a cache line",
    ("voxelize/triangle_bins.c", "512"): "parts that threads run",
}
GENERATED = ("albedo_glass.c", "albedo_reflection.c")


@cache
def code(path: Path) -> str:
    """A C file without comments and preprocessor lines; lines stay where they are."""
    text = re.sub(
        r"/\*.*?\*/", lambda m: "\n" * m[0].count("\n"), path.read_text("utf-8"), flags=re.DOTALL
    )
    return re.sub(r"^[ \t]*#(?:[^\n\\]|\\\n|\\.)*", "", text, flags=re.MULTILINE)


def outermost(text: str) -> str:
    """C code where what stands in braces is left out, with a semicolon behind."""
    depth, kept = 0, []
    for part in re.split(r"([{}])", text):
        depth += part == "{"
        if depth == 0:
            kept.append(part)
        if part == "}":
            depth -= 1
            kept.append("{};" if depth == 0 else "")
    return "".join(kept)


def test_only_grid_knows_how_samples_and_cells_lie():
    found, excused, inside = [], set(), 0
    for path in files("native/src/*.[ch]"):
        name = path.relative_to(SOURCE).as_posix()
        for number, line in enumerate(code(path).splitlines(), 1):
            for match in LAYOUT.findall(line) if path.name not in GENERATED else ():
                if name.startswith("grid/"):
                    inside += 1
                elif (name, match) in NO_LAYOUT:
                    excused.add((name, match))
                else:
                    found.append(f"{name}:{number}: {match}")
    assert inside > 100  # the store itself
    assert not found, found
    assert excused == NO_LAYOUT.keys()


def test_no_files_of_the_core_include_each_other():
    graph = dependencies.c_files()
    assert len(graph) > 80 and graph["grid/brick_grid"] and graph["grid/volume"]
    dependencies.ranks(graph)  # which names the circle


def test_what_a_header_declares_its_source_defines():
    elsewhere, n = [], 0
    for header in files("native/src/*.h"):
        own = [header.with_suffix(".c"), header.with_name(f"{header.stem}_impl.h")]
        made = "".join(outermost(code(path)) for path in own if path.exists())
        for statement in outermost(code(header)).split(";"):
            if re.match(r"\s*(typedef|LR_INLINE)\b", statement) or statement.endswith("{}"):
                continue
            for name in re.findall(r"\b(lr_\w+)\(", statement)[:1]:
                n += 1
                if not re.search(rf"\b{name}\)?\([^;{{}}]*\{{\}}", made):
                    elsewhere.append(f"{header.relative_to(SOURCE)}: {name}")
    assert n > 100
    assert not elsewhere, elsewhere


# ---- traversers are named once ---------------------------------------------


def shared_words() -> set[str]:
    """Words that also name something else: a hit test, or plain English in code and messages."""
    return {*leapray.HIT_TESTS, *leapray.ROOTS, *leapray.NORMALS, "lines"}


def traverser_names() -> set[str]:
    names = {name for item in leapray.traversers() for name in (item.name, item.label)}
    assert len(names) >= 6
    return {name.lower() for name in names} - shared_words()


def words_of(text: str) -> set[str]:
    """The items of a short string that may be a list of names."""
    return {text.lower(), *re.split(r"[\s,;|/]+", text.lower())} if len(text) < 60 else set()


def sources_outside_the_registry() -> list[Path]:
    free = ("tests", "docs")
    return [p for p in files("*.py") if p.relative_to(ROOT).parts[0] not in free]


@pytest.mark.parametrize("path", sources_outside_the_registry(), ids=name_of)
def test_no_traverser_is_named_in_python(path):
    found = []
    for node in ast.walk(tree(path)):
        text = getattr(node, "value", None) if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and words_of(text) & traverser_names():
            found.append(f"{path.name}:{node.lineno}: {text!r}")
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            named = any("traverser" in ast.dump(side).lower() for side in sides)
            numbers = [s for s in sides if isinstance(s, ast.Constant) and type(s.value) is int]
            if named and numbers and not any(isinstance(s, ast.Call) for s in sides):
                found.append(f"{path.name}:{node.lineno}: compared with {numbers[0].value}")
    assert not found, found


def test_no_traverser_is_named_in_c():
    names = {item.name for item in leapray.traversers()}
    registry = ROOT / "native" / "src" / "trace" / "traversers.def"
    assert names <= set(re.findall(r"\w+", registry.read_text()))
    names -= shared_words()
    found = []
    for path in files("native/*.c", "native/*.h"):
        if path.parent.name == "traversers":
            continue
        text = re.sub(r"/\*.*?\*/|//[^\n]*", "", path.read_text(), flags=re.DOTALL)
        for literal in re.findall(r'"((?:[^"\\]|\\.)*)"', text):
            if words_of(literal) & names:
                found.append(f'{path.name}: "{literal}"')
        for word in set(re.findall(r"\b[A-Za-z]\w*", text)):
            parts = word.lower().split("_")
            if len(parts) > 1 and names & set(parts):
                found.append(f"{path.name}: {word}")
        found += re.findall(r"\btraverser\w*\s*[!=]=\s*\d+", text)
    assert not found, found


# ---- lights are told apart in one place ---------------------------------------


def test_no_code_asks_for_the_type_of_a_light_but_through_the_list():
    folder = ROOT / "native" / "src" / "render" / "lights"
    rows = re.findall(r"^LR_LIGHT_TYPE\((\w+), (\w+)\)", (folder / "lights.def").read_text(), re.M)
    assert [kind for kind, _ in rows] == [kind.name for kind in _abi.lr_light_kind]
    types = [folder / f"{name}.c" for _, name in rows]
    assert all(path.exists() for path in types)
    named = re.compile(rf"\b({'|'.join(kind for kind, _ in rows)})\b")
    asked = re.compile(r"light\w*(\[[^]]*\])?(->|\.)kind")
    found = []
    for path in files("native/src/*.[ch]", "native/leapray/*.py", "addon/*.py"):
        text = re.sub(r"/\*.*?\*/", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        if path not in [*types, ROOT / "native" / "leapray" / "_abi.py"]:
            found += [f"{path.name} names {kind}" for kind in named.findall(text)]
        elsewhere = path.suffix != ".py" and path not in [*types, folder / "light.c"]
        if elsewhere and asked.search(text):
            found.append(f"{path.name} asks for the kind of a light")
    assert not found, found


# ---- text ------------------------------------------------------------------


def test_every_source_file_names_its_licence():
    kinds = ("*.py", "*.c", "*.cpp", "*.h", "*.def", "*.toml", "*.sh", ".ci/*", "requirements*.txt")
    sources = files(*kinds)
    assert len(sources) > 30
    missing = [str(path.relative_to(ROOT)) for path in sources if licences(path) != 1]
    assert not missing, f"one SPDX line is wanted in {missing}"


def licences(path: Path) -> int:
    """How many lines of a file's head say its licence."""
    head = path.read_text(encoding="utf-8").splitlines()[:25]
    return sum(bool(re.search(r"SPDX-License-Identifier: GPL-3\.0-or-later\b", s)) for s in head)


def test_no_file_is_too_long():
    generated = [ROOT / "native" / "leapray" / "_abi.py"]
    whole = [ROOT / "native" / "include" / "leapray.h"]  # the interface is one page by design
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines())
        for path in files("*.py", "*.c", "*.h", "*.def")
        if path not in generated + whole
    }
    assert not {name: n for name, n in lengths.items() if n > LONGEST}


@pytest.mark.parametrize("words", [("check", "--quiet"), ("format", "--check")], ids=" ".join)
def test_ruff_finds_nothing(words):
    command = [sys.executable, "-m", "ruff", *words, "."]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr


def test_clang_format_changes_nothing():
    sources = files("native/*.[ch]", "tests/*.c", "addon/*.c", "addon/*.cpp")
    command = [Path(sys.executable).with_name("clang-format"), "--dry-run", "-Werror", *sources]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[:2000]


def test_mypy_finds_nothing():
    if sys.version_info[:2] != (3, 11):
        return  # the types of another numpy differ; pyproject.toml says 3.11
    result = subprocess.run(
        [sys.executable, "-m", "mypy"], cwd=ROOT, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stdout + result.stderr


# ---- the generated view of the header --------------------------------------


def test_the_generated_declarations_are_current():
    script = ROOT / "native" / "generate_abi.py"
    result = subprocess.run(
        [sys.executable, str(script), "--check"], capture_output=True, text=True
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_every_call_of_the_compiler_names_its_target():
    # Without a target it looks for the machine's own C library, and fails where that is broken.
    folders = ("native", "addon", "tests", "docs")
    sources = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    text = "\n".join(path.read_text() for path in sources if path != Path(__file__))
    calls = re.findall(r'\[.*"ziglang", "cc".*\]|\[.*compiler\(\).*\]', text)
    assert len(calls) >= 4
    assert [call for call in calls if "TARGET" not in call] == []


def test_the_library_holds_every_function_of_the_header():
    missing = [name for name in _abi.PROTOTYPES if not hasattr(_lib.lib, name)]
    assert not missing


def test_structs_lie_as_the_compiler_lays_them(tmp_path):
    lines = ["#include <stddef.h>", '#include "leapray.h"']
    structs = [
        item
        for item in vars(_abi).values()
        if isinstance(item, type) and issubclass(item, ctypes.Structure)
        if hasattr(item, "_fields_")  # the others are opaque
    ]
    assert len(structs) > 10
    for item in structs:
        name = item.__name__
        lines.append(f'_Static_assert(sizeof({name}) == {ctypes.sizeof(item)}, "{name}");')
        for field, *_ in item._fields_:
            offset = getattr(item, field).offset
            lines.append(f'_Static_assert(offsetof({name}, {field}) == {offset}, "{field}");')
    source = tmp_path / "layout.c"
    source.write_text("\n".join(lines) + "\n")
    command = [sys.executable, "-m", "ziglang", "cc", *build_core.TARGET]
    command += ["-I", str(ROOT / "native" / "include"), "-c", str(source), "-o"]
    result = subprocess.run([*command, str(tmp_path / "layout.o")], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


# ---- what is said twice ----------------------------------------------------


def test_the_readme_is_right_about_the_library():
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    names: dict = {}
    exec(compile(example, "README.md", "exec"), names)  # the project's own text
    hits = names["hits"]
    assert hits.t[0] == pytest.approx(10.0, abs=1e-6)  # the sphere's pole, on a lattice line
    assert hits.normal[0] == pytest.approx([0, 0, -1], abs=1e-6)


def test_the_extension_has_the_version_and_the_wheel_of_the_core():
    manifest = tomllib.loads((ROOT / "addon" / "blender_manifest.toml").read_text())
    assert manifest["version"] == leapray.__version__
    core, *readers = (Path(wheel).name for wheel in manifest["wheels"])
    assert core == f"leapray-{leapray.__version__}-py3-none-{build_core.PLATFORM}.whl"
    pins = re.findall(r"^(\w+)==(.*)", (ROOT / build.VOLUMES).read_text(), re.M)
    assert [name.split("-")[:2] for name in readers] == sorted(map(list, pins))
    assert all(name.endswith("-none-any.whl") for name in readers)
    extra = tomllib.loads((ROOT / "native" / "pyproject.toml").read_text())["project"]
    needed = {re.match(r"\w+", item)[0] for item in extra["optional-dependencies"]["volumes"]}
    assert needed < {name for name, _ in pins}


def test_the_pins_name_what_is_installed():
    pins = {}
    for line in "\n".join(path.read_text() for path in ROOT.glob("requirements*.txt")).splitlines():
        pin, _, marker = line.partition(";")
        version = re.search(r'python_version == "(.*)"', marker)
        if "==" in pin and (
            not version or version[1] == f"{sys.version_info[0]}.{sys.version_info[1]}"
        ):
            name, _, number = pin.partition("==")
            pins[name.strip().lower()] = number.strip()
    found = {name: importlib.metadata.version(name) for name in pins}
    assert found == pins
