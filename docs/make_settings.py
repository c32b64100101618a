# SPDX-License-Identifier: GPL-3.0-or-later
"""Write docs/settings.md from the descriptions in addon/settings.py.

python docs/make_settings.py            writes the page
python docs/make_settings.py --check    fails where the page is not what it would write
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(ROOT / "native")]

import generated  # noqa: E402

from addon.blender.presets import PRESETS  # noqa: E402
from addon.descriptions import Setting, described  # noqa: E402
from addon.methods import PROJECTIONS  # noqa: E402
from addon.settings import SETTINGS, Isosurfaces, Modelling  # noqa: E402

PAGE = ROOT / "docs" / "settings.md"
OTHER_PAGES = {
    "method": "`rays`; the [whole-image methods](methods/images.md) with their options; the "
    f"projections {', '.join(f'`{each.spec}`' for each in PROJECTIONS)}, of which "
    "[volumes](volumes.md) tells",
    "traverser": "the [traversers](methods/README.md) with their options",
}
UNITS = {"PIXEL": "pixels", "DISTANCE": "scene units"}

HEAD = """# Settings

What can be chosen for a scene, an object and a volume, written by
[make_settings.py](make_settings.py) from [settings.py](../addon/settings.py); change that, not
the page. `samples` is `scene.leapray.samples` in Python and `--samples` on the command line of
`render`. What is out of its range is refused. All can be keyed, but for {unkeyed}.
"""


def listed(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def number(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def limits(setting: Setting) -> str:
    """The range of a number; the slider's, where that is narrower."""
    if setting.minimum is None:
        return ""
    told = f"{number(setting.minimum)} to {number(setting.maximum)}"
    soft = (setting.soft_minimum, setting.soft_maximum)
    if soft != (None, None):
        low, high = (hard if end is None else end for end, hard in
                     zip(soft, (setting.minimum, setting.maximum), strict=True))  # fmt: skip
        told += f"; slider {number(low)} to {number(high)}"
    return " ".join([told, UNITS.get(setting.unit, "")]).strip()


def default(setting: Setting) -> str:
    value = setting.default
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "on" if value else "off"
    if setting.choices:
        return f"`{value or setting.names()[0]}`"
    if setting.zero is not None and value == 0:
        return "0, automatic" if setting.zero.automatic else "0, off"
    return number(value) or "empty"


def option(name: str, setting: Setting) -> str:
    if not setting.option:
        return ""
    text = f"--{name.replace('_', '-')}"
    if setting.kind is bool:
        return f"`{text}`, `{text.replace('--', '--no-')}`"
    return f"`{text}`" + f", 0 is `{setting.zero_word}`" * bool(setting.zero_word)


def table(owner: dict[str, Setting], options: bool) -> str:
    rows = []
    for name, setting in owner.items():
        cells = [f"`{name}`", setting.label + " (Blender's)" * (not setting.in_blender)]
        cells += [default(setting), limits(setting)]
        cells += [option(name, setting)] * options + [setting.tooltip]
        rows.append(cells)
    head = ["setting", "in the panel", "default", "range", *["option"] * options, "what"]
    return generated.table(head, rows)


def choices(owner: dict[str, Setting]) -> str:
    """What each entry of the menus stands for."""
    parts = []
    for name, setting in owner.items():
        if name in OTHER_PAGES:
            parts.append(f"`{name}`: {OTHER_PAGES[name]}.\n")
        elif setting.choices:
            entries = [f"- `{each.name}`: {each.tooltip}" for each in setting.choices]
            parts.append("\n".join([f"`{name}`:\n", *entries, ""]))
    return "\n".join(parts)


def presets() -> str:
    parts = []
    for preset in PRESETS.values():
        told = ", ".join(f"`{name}` {number(value)}" for name, value in preset.differs.items())
        parts.append(f"- {preset.label}: {preset.about}." + f" {told}." * bool(told))
    return "\n".join(parts)


def page() -> str:
    own = described(Modelling)
    return "\n".join(
        [
            HEAD.format(unkeyed=listed(name for name, s in SETTINGS.items() if not s.animates)),
            "## Of a scene\n",
            table(SETTINGS, options=True),
            f"\n{choices(SETTINGS)}",
            "## Of an object\n",
            table(own, options=False),
            "\nWhat is `scene` is as the scene's settings say; its other choices are as there.\n",
            choices({name: own[name] for name in own if name not in SETTINGS}),
            "## Of a volume\n",
            "`volume.leapray` of a Volume datablock, in Python.\n",
            table(described(Isosurfaces), options=False),
            f"\n{choices(described(Isosurfaces))}",
            "## Presets\n",
            "What differs from the defaults. Presets leave alone "
            f"{listed(name for name, s in SETTINGS.items() if not s.in_presets)}.\n",
            presets(),
            "",
        ]
    )


if __name__ == "__main__":
    sys.exit(generated.write({PAGE: page()}, "docs/make_settings.py"))
