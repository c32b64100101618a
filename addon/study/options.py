# SPDX-License-Identifier: GPL-3.0-or-later
"""Options of the studies beside `--quick` (no bpy)."""

from __future__ import annotations

import argparse

from .. import descriptions


def number(parser: argparse.ArgumentParser, name: str, words: str, *, least: int = 1) -> None:
    """An integer `--name N`; None where it is not given."""
    parser.add_argument(f"--{name}", type=descriptions.number(least), metavar="N", help=words)


def numbers(parser: argparse.ArgumentParser, name: str, words: str, *, least: int = 1) -> None:
    """One or more integers `--name N N ...`; None where they are not given."""
    parser.add_argument(
        f"--{name}", type=descriptions.number(least), metavar="N", nargs="+", help=words
    )


def chosen(args: argparse.Namespace, name: str, quick, full):
    """What was asked for, else the one or the other default."""
    value = getattr(args, name, None)
    return (quick if getattr(args, "quick", False) else full) if value is None else value
