# SPDX-License-Identifier: GPL-3.0-or-later
"""Write docs/library.md, the page of the Python API, from signatures and docstrings.

    python docs/make_library.py            writes the page
    python docs/make_library.py --check    fails where the page is not what it would write

What a name does is said in its docstring; this file says which topic it belongs to, and what
the constants hold, which have no docstring.
"""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT / "native"))

import generated  # noqa: E402

import leapray  # noqa: E402

PAGE = ROOT / "docs" / "library.md"
EXAMPLE = ROOT / "docs" / "library_example.py"
WIDTH = 96  # of a signature's line

# Every public name in one topic, in the order of the page.
TOPICS = {
    "Volumes": (
        "A volume is a lattice of occupancy samples, 0 outside and 1 inside. Its surface is where "
        "the trilinear field of the samples equals the threshold T. Sample (i, j, k) lies at "
        "index coordinates (i, j, k); cell (i, j, k) is the cube between eight samples. Arrays of "
        "samples have the shape (nz, ny, nx), so that x varies fastest; triples are in x, y, z "
        "order. The core stores samples in sparse bricks of 8 x 8 x 8.",
        "Volume VolumeInfo VolumeBuilder merge",
    ),
    "Isosurfaces": (
        "A scalar grid is a field as files hold it: numbers on a lattice and what they mean. An "
        "isosurface is a volume of them: the solid on one side of a threshold. Filters make "
        "grids of grids.",
        "isosurface Isosurfaces labels label_numbers coarser smooth without_islands",
    ),
    "Visible volumes": (
        "A transfer function says what values of a field look like. A visible volume is a field "
        "seen by one, without a surface: `trace` adds up light along rays through it, without "
        "steps, or finds extremes and means of values.",
        "visible_volume FieldSamples TransferFunction",
    ),
    "Voxelization": (
        "`voxelize` turns triangles into a volume. Attributes let hits take colours and smooth "
        "normals from the triangles.",
        "voxelize FILTERS MeshInfo mesh_layers mesh_edges Attributes Texture VERTEX WHITE",
    ),
    "Measured volumes": (
        "Files of scanners, microscopes and simulations become a scalar grid: numbers on a "
        "lattice, and where it lies. [formats.md](formats.md) says what is read of each format.",
        "read_volume volume_grids RawLayout ScalarGrid Leaves first_threshold histogram Histogram",
    ),
    "Texture programs": (
        "A texture may carry a program that computes the colour from what is looked up in the "
        "image. A program is compiled from three values, red, green and blue; a value is a number "
        "or depends on the inputs.",
        "Value INPUTS Step operate Table compile_program Program inputs_of numbers_of is_affine",
    ),
    "Traversers and structures": (
        "A traverser is the method that takes a ray to the next cell that can hold surface. "
        "[methods/](methods/README.md) describes each. A structure is what the traverser needs "
        "beside the volume.",
        "traversers traverser variants Traverser Entry Option build Structure",
    ),
    "Tracing": (
        "Rays are P = origin + t direction in object space. All rays of a call are traced with "
        "one set of options.",
        "trace Hits Phong MODES VISIBLE_MODES HIT_TESTS ROOTS NORMALS SAMPLINGS trace_options "
        "add_counters",
    ),
    "Distance transforms": (
        "Distances between cells, as several traversers use them.",
        "distance METRICS",
    ),
    "Whole images": (
        "Methods that do not trace rays one by one, but render an image at once; "
        "[methods/](methods/images.md) describes each. A method prepares what it needs beside the "
        "volume, and renders any number of images with it.",
        "image_methods image_method image_variants ImageMethod prepare Prepared Voxels "
        "render_image Image "
        "Misses camera_rays",
    ),
    "Rendering": (
        "A scene places structures in the world, lights them and gives them materials. It is "
        "rendered tile by tile by a path tracer. [leapray.h](../native/include/leapray.h) defines "
        "the units and conventions of each member.",
        "Scene Camera Instance Clip FieldColor Light Material Lobe World PASSES SAMPLING "
        "PIXEL_FILTERS Record",
    ),
    "Errors and cancellation": (
        "The core refuses what it cannot do with an exception whose text is one sentence. Long "
        "calls take a watch: `Watch.stop()`, called on any thread, ends them within 100 ms by "
        "`Stopped`. Ctrl-C ends a call on the main thread by KeyboardInterrupt. Calls release the "
        "interpreter lock, so that several threads may call the core side by side.",
        "LeapRayError OutOfMemory Stopped Watch __version__",
    ),
}

CONSTANTS = {
    "FILTERS": "Names of the filters of `voxelize`; see [filters](methods/filters.md).",
    "HIT_TESTS": "Names of the hit tests, for `trace`; see [hit tests](methods/hit_tests.md).",
    "INPUTS": "The four steps that stand for red, green, blue and alpha of what is looked up.",
    "METRICS": "Names of the metrics of `distance`.",
    "MODES": "What `trace` looks for: the surface, or the first object cell.",
    "VISIBLE_MODES": "What `trace` adds up or finds along rays through visible volumes.",
    "SAMPLINGS": "How light along a ray is added up: by integrals, or samples at equal steps.",
    "NORMALS": "Names of the normals, for `trace`; see [normals](methods/normals.md).",
    "PASSES": "The passes of `Scene.render_tile`, and how many channels each has.",
    "PIXEL_FILTERS": "Names of the pixel filters, for `pixel_filter` in SAMPLING.",
    "ROOTS": "Names of the root finders, for `trace`; see [root finders](methods/roots.md).",
    "SAMPLING": "The sampling options of `Scene.render_tile` and their defaults. Bounces and "
    "clamps count as in Cycles; distances are in world space.",
    "VERTEX": "The colour source of triangles that take the colours of their corners.",
    "Value": "The type of what programs compute with: a number, or a Step.",
    "WHITE": "The colour source of triangles without colours.",
    "__version__": "The version of the package and of the compiled core.",
}

HEAD = """# The library

The core of LeapRay is a Python package of its own, `leapray`: numpy arrays in, numpy arrays out.
It does not depend on Blender. `python3 build.py build` makes its wheel. This page is written by
[make_library.py](make_library.py) from the docstrings; change those, not the page.

{contents}

## A worked example

[library_example.py](library_example.py) goes from a mesh to a picture.

```python
{code}```

It prints:

```
{output}```
"""


def names(topic: str) -> list[str]:
    return TOPICS[topic][1].split()


def documented_members(cls: type) -> list[str]:
    """Public methods and properties that the class itself defines, in their order."""
    kinds = (classmethod, staticmethod, property)
    return [
        name
        for name, member in vars(cls).items()
        if not name.startswith("_") and (inspect.isfunction(member) or isinstance(member, kinds))
    ]


def is_constant(name: str) -> bool:
    thing = getattr(leapray, name)
    return not (inspect.isclass(thing) or inspect.isroutine(thing))


def annotation(text: object) -> str:
    return text if isinstance(text, str) else getattr(text, "__name__", str(text))


def value(default: object) -> str:
    """A default as source has it: strings in double quotes, constants by their names."""
    if isinstance(default, str):
        return f'"{default}"'
    return next((n for n in leapray.__all__ if getattr(leapray, n) is default), repr(default))


def signature(title: str, thing: object, lead: str = "") -> str:
    """A call as Python writes it, on one line or with a line per parameter."""
    found = inspect.signature(thing)
    parts: list[str] = []
    star = False
    for p in found.parameters.values():
        if p.name in ("self", "cls"):
            continue
        if p.kind is p.KEYWORD_ONLY and not star:
            parts.append("*")
            star = True
        text = "**" * (p.kind is p.VAR_KEYWORD) + "*" * (p.kind is p.VAR_POSITIONAL) + p.name
        star = star or p.kind is p.VAR_POSITIONAL
        typed = p.annotation is not p.empty
        text += f": {annotation(p.annotation)}" if typed else ""
        if p.default is not p.empty:
            text += f" = {value(p.default)}" if typed else f"={value(p.default)}"
        parts.append(text)
    back = found.return_annotation
    tail = "" if back in (found.empty, "None", None) else f" -> {annotation(back)}"
    line = f"{lead}{title}({', '.join(parts)}){tail}"
    if len(line) <= WIDTH:
        return line
    return "\n".join([f"{lead}{title}(", *(f"    {part}," for part in parts), f"){tail}"])


def fields(cls: type) -> str:
    """The members of a dataclass as its source has them, comments included."""
    source = textwrap.dedent(inspect.getsource(cls))
    body = next(node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)).body
    members = [node for node in body if isinstance(node, ast.AnnAssign)]
    rest = [node for node in body if isinstance(node, ast.FunctionDef)]
    first = members[0].lineno
    last = min(
        (min([node.lineno, *(d.lineno for d in node.decorator_list)]) for node in rest),
        default=len(source.splitlines()) + 1,
    )
    return textwrap.dedent("\n".join(source.splitlines()[first - 1 : last - 1])).rstrip()


def text_of(thing: object) -> str:
    """A docstring as Markdown: paragraphs as they are, no mark of Markdown's in them."""
    return re.sub(r"([*<])", r"\\\1", inspect.getdoc(thing) or "")


def code(text: str) -> str:
    return f"```python\n{text}\n```\n"


def constant(name: str) -> str:
    value = getattr(leapray, name)
    if isinstance(value, dict):
        numbers = all(type(v) in (int, float, str) for v in value.values())
        told = ", ".join(f"`{k}`" + f" {v!r}" * numbers for k, v in value.items())
        return f"{CONSTANTS[name]}\n\n{told}.\n"
    return f"{CONSTANTS[name]}\n"


def entry(name: str) -> str:
    """One name of the package, with its members."""
    thing, parts = getattr(leapray, name), [f"### {name}\n"]
    if is_constant(name):
        return "\n".join([*parts, constant(name)])
    if inspect.isclass(thing) and issubclass(thing, Exception):
        parts.append(code(f"class {name}({thing.__bases__[0].__name__})"))
    elif inspect.isclass(thing) and hasattr(thing, "__dataclass_fields__"):
        above = thing.__bases__[0].__name__
        bases = "" if above == "object" else f"({above})"
        parts.append(code(f"class {name}{bases}:\n{textwrap.indent(fields(thing), '    ')}"))
    else:
        parts.append(code(signature(name, thing)))
    parts.append(f"{text_of(thing)}\n")
    for member in documented_members(thing) if inspect.isclass(thing) else ():
        parts += [f"#### {name}.{member}\n", *member_text(thing, member)]
    return "\n".join(parts)


def member_text(cls: type, member: str) -> list[str]:
    found = vars(cls)[member]
    told = f"{text_of(getattr(cls, member))}\n"
    if isinstance(found, property):
        returned = annotation(inspect.signature(found.fget).return_annotation)
        return [code(f"{member}: {returned}  # property"), told]
    lead = "@classmethod\n" if isinstance(found, classmethod) else ""
    return [code(lead + signature(member, getattr(cls, member))), told]


def anchors(page: str) -> dict[str, str]:
    """The first link to every heading, as GitHub makes them."""
    seen: dict[str, int] = {}
    links = {}
    for title in re.findall(r"^#+ (.+)$", re.sub(r"```.*?```", "", page, flags=re.DOTALL), re.M):
        slug = re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
        number = seen.get(slug, 0)
        seen[slug] = number + 1
        links.setdefault(title, f"#{slug}-{number}" if number else f"#{slug}")
    return links


def run_example() -> str:
    command = [sys.executable, str(EXAMPLE)]
    place = {"PYTHONPATH": str(ROOT / "native")}
    return subprocess.run(command, env=place, capture_output=True, text=True, check=True).stdout


def page() -> str:
    listed = [name for topic in TOPICS for name in names(topic)]
    assert sorted(listed) == sorted(leapray.__all__), set(listed) ^ set(leapray.__all__)
    body = "\n".join(
        "\n".join([f"## {topic}\n", f"{TOPICS[topic][0]}\n", *(entry(n) for n in names(topic))])
        for topic in TOPICS
    )
    example = {"code": EXAMPLE.read_text(encoding="utf-8"), "output": run_example()}
    links = anchors(HEAD.format(contents="", **example) + "\n" + body)
    rows = [
        f"- [{topic}]({links[topic]}): "
        + ", ".join(f"[`{name}`]({links[name]})" for name in names(topic))
        for topic in TOPICS
    ]
    return HEAD.format(contents="\n".join(rows), **example) + "\n" + body.rstrip() + "\n"


if __name__ == "__main__":
    sys.exit(generated.write({PAGE: page()}, "docs/make_library.py"))
