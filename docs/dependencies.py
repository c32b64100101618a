# SPDX-License-Identifier: GPL-3.0-or-later
"""Which module of the project uses which, read from its sources: imports and includes.

Graphs are dictionaries: a name -> the names that it uses. A C module is a directory of
native/src; a Python module is a file.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
Graph = dict[str, set[str]]


def c_modules() -> Graph:
    """The directories of native/src, by #include."""
    source = ROOT / "native" / "src"
    graph: Graph = {}
    for path in sorted(source.rglob("*.[ch]")):
        uses = graph.setdefault(path.parent.relative_to(source).as_posix(), set())
        for target in re.findall(r'^#include "([^"]+)/[^"/]+"', path.read_text("utf-8"), re.M):
            uses.add(target)
    return {name: uses - {name} for name, uses in graph.items()}


def c_files() -> Graph:
    """The files of native/src, by #include: x.h, x.c and what x.c is made of, x_impl.h, are one."""
    source = ROOT / "native" / "src"
    graph: Graph = {}
    for path in sorted(source.rglob("*.[ch]")):
        uses = graph.setdefault(_stem(path.relative_to(source)), set())
        for target in re.findall(r'^#include "([^"]+/[^"]+)"', path.read_text("utf-8"), re.M):
            uses.add(_stem(Path(target)))
    for target in set().union(*graph.values()) - set(graph):  # lists: *.def
        graph[target] = set()
    return {name: uses - {name} for name, uses in graph.items()}


def _stem(path: Path) -> str:
    return path.with_name(path.stem.removesuffix("_impl")).as_posix()


def python_modules(package: Path) -> Graph:
    """The modules of a package, by their dotted names within it; by import, anywhere in them."""
    paths = {
        ".".join(path.relative_to(package).with_suffix("").parts): path
        for path in sorted(package.rglob("*.py"))
    }
    return {name: _imports(name, path, package, paths) for name, path in paths.items()}


def _imports(name: str, path: Path, package: Path, known: dict[str, Path]) -> set[str]:
    here = [package.name, *name.split(".")][:-1]
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if not isinstance(node, ast.ImportFrom):
            continue
        base = [*here[: len(here) - node.level + 1]] if node.level else []
        base += node.module.split(".") if node.module else []
        if base[:1] != [package.name]:
            continue
        for alias in node.names:
            inside, whole = ".".join(base[1:]), ".".join([*base[1:], alias.name])
            found |= {target for target in (whole, inside) if target in known}
    return found - {name}


def grouped(graph: Graph, group: dict[str, str]) -> Graph:
    """The graph with some nodes put together: a name, or what begins with it, -> its group."""

    def of(name: str) -> str:
        fits = [p for p in group if name == p or name.startswith(f"{p}.")]
        return group[max(fits, key=len)] if fits else name

    made: Graph = {}
    for name, uses in graph.items():
        made.setdefault(of(name), set()).update(map(of, uses))
    return {name: uses - {name} for name, uses in made.items()}


def reduced(graph: Graph) -> Graph:
    """Without the edges that a longer path implies. The graph must have no circle."""
    below = {name: _reached(graph, name) for name in graph}
    return {
        name: {t for t in uses if not any(t in below[other] for other in uses)}
        for name, uses in graph.items()
    }


def _reached(graph: Graph, name: str) -> set[str]:
    """All that a module uses, what those use, and so on."""
    seen = set(graph[name])
    todo = list(graph[name])
    while todo:
        for target in graph[todo.pop()]:
            if target not in seen:
                seen.add(target)
                todo.append(target)
    return seen


def ranks(graph: Graph) -> dict[str, int]:
    """0 for what uses nothing; else one more than the highest that is used."""
    found: dict[str, int] = {}

    def rank(name: str, path: tuple[str, ...] = ()) -> int:
        assert name not in path, " -> ".join((*path, name))
        if name not in found:
            found[name] = 1 + max((rank(t, (*path, name)) for t in graph[name]), default=-1)
        return found[name]

    for name in graph:
        rank(name)
    return found
