# SPDX-License-Identifier: GPL-3.0-or-later
"""What was left out of a scene, gathered by reason, each reason with the names it touches."""

from __future__ import annotations


class Warnings:
    """Each method adds a name to a sentence; `sentences` gives them all."""

    SHOWN = 5  # names in one sentence

    def __init__(self) -> None:
        self._names: dict[tuple[str, str], dict[str, None]] = {}  # by what stands around them

    def unsupported(self, feature: str, name: str) -> None:
        """feature: with its verb, as "Displacement is"."""
        self._add((f"{feature} not supported yet: ", ""), name)

    def skipped(self, reason: str, name: str) -> None:
        self._add(("Skipped ", f": {reason}"), name)

    def strange(self, things: tuple[str, ...], name: str) -> None:
        """What a material, a light or a world is made of and LeapRay does not understand."""
        what = f"Not understood, so the sockets' own values stand in: {', '.join(things)} in "
        self._add((what, ""), name)

    def missing(self, kind: str, name: str, what: str) -> None:
        """What is wrong with a thing of that kind, as a verb and the rest."""
        self._add((f"{kind} ", f" {what}"), name)

    def forget(self, reason: str, name: str) -> None:
        """Take back what `skipped` was told."""
        self._names.get(("Skipped ", f": {reason}"), {}).pop(name, None)

    def _add(self, around: tuple[str, str], name: str) -> None:
        self._names.setdefault(around, {})[name] = None

    def sentences(self) -> tuple[str, ...]:
        found = []
        for (before, after), names in self._names.items():
            if not names:
                continue
            shown = ", ".join(f"'{name}'" for name in list(names)[: self.SHOWN])
            more = len(names) - self.SHOWN
            found.append(before + shown + (f" and {more} more" if more > 0 else "") + after)
        return tuple(found)
