# SPDX-License-Identifier: GPL-3.0-or-later
"""The result folder of a study, and its files (no bpy)."""

from __future__ import annotations

import argparse
import contextlib
import csv
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import leapray
from leapray import LeapRayError

from .. import process
from ..store import files
from . import charts


@contextlib.contextmanager
def result_folder(output: Path, last: str) -> Iterator[Path]:
    """A folder beside output whose files move there at the end, the file named `last` last.

    Nothing is left behind where the work fails, and other files in output stay. Raises
    LeapRayError before any work where output cannot be.
    """
    parent = output.absolute().parent
    figures = (output / last).with_suffix(".json")
    files.check_replaceable(figures, lambda data: "leapray" in data, "choose another --output")
    if output.is_file():
        raise LeapRayError(f"--output must be a folder, and {output} is a file")
    if not parent.is_dir():
        raise LeapRayError(f"The output folder {parent} does not exist")
    try:
        if output.is_dir():
            tempfile.TemporaryFile(dir=output).close()
        with process.signals_deferred():
            prefix = f".{output.name}."
            part = Path(tempfile.mkdtemp(prefix=prefix, suffix=".part", dir=parent))
            process.temporary_folders.add(part)
    except OSError as error:
        raise LeapRayError(f"{output} cannot be written to: {error.strerror}") from error
    try:
        yield part
        output.mkdir(exist_ok=True)
        with process.signals_deferred():
            for path in sorted(part.iterdir(), key=lambda each: each.name == last):
                os.replace(path, output / path.name)
    finally:
        shutil.rmtree(part, ignore_errors=True)
        process.temporary_folders.discard(part)


@contextlib.contextmanager
def study_folder(args: argparse.Namespace, name: str) -> Iterator[Path]:
    """The result folder of a study, which says at the end where its page lies."""
    output = Path(args.output or name)
    with result_folder(output, f"{name}.html") as folder:
        yield folder
    print(f"{output / name}.html, and its figures in {output / name}.csv", flush=True)


def write_figures(folder: Path, name: str, told: dict, **tables: list) -> dict:
    """name.json, with the machine and with the rows of all tables, which are dataclasses, and a
    CSV file per table; the first is name.csv. Returns what the JSON file holds."""
    rows = {key: [asdict(row) for row in table] for key, table in tables.items()}
    whole = {"machine": charts.machine(), "leapray": leapray.__version__, **told, **rows}
    files.write_json(folder / f"{name}.json", whole)
    for k, (key, table) in enumerate(rows.items()):
        ending = f"-{key.replace('_', '-')}" if k else ""
        with (folder / f"{name}{ending}.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, list(table[0]))
            writer.writeheader()
            writer.writerows(table)
    return whole
