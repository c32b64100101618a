# SPDX-License-Identifier: GPL-3.0-or-later
"""Small SVG pictures, drawn by hand: no dependency, the same bytes everywhere."""

from __future__ import annotations

from html import escape
from pathlib import Path

INK, GREY, PALE = "#222222", "#888888", "#dddddd"
BLUE, RED, GREEN, ORANGE = "#1f6fb4", "#c0392b", "#2e8b57", "#d98218"


def number(x: float) -> str:
    return f"{x:.1f}".rstrip("0").rstrip(".")


class Picture:
    """Shapes on white, in pixels from the upper left corner."""

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self._parts: list[str] = []

    def rect(
        self, x, y, w, h, fill="none", stroke=None, *, round=0.0, width=1.0, dash="", opacity=1.0
    ) -> None:
        place = " ".join(
            f'{k}="{number(v)}"' for k, v in (("x", x), ("y", y), ("width", w), ("height", h))
        )
        extra = f' rx="{number(round)}"' * bool(round) + _line(stroke, width, dash)
        extra += f' fill-opacity="{opacity:g}"' * (opacity != 1.0)
        self._parts.append(f'<rect {place} fill="{fill}"{extra}/>')

    def circle(self, x, y, radius, fill="none", stroke=None, *, width=1.0, opacity=1.0) -> None:
        extra = _line(stroke, width, "") + f' fill-opacity="{opacity:g}"' * (opacity != 1.0)
        place = f'cx="{number(x)}" cy="{number(y)}" r="{number(radius)}"'
        self._parts.append(f'<circle {place} fill="{fill}"{extra}/>')

    def line(self, points, stroke=INK, *, width=1.0, dash="", arrow=False, bend=False) -> None:
        """Through the points; bend: by vertical S-curves from each to the next."""
        (x, y), *rest = points
        path = f"M{number(x)} {number(y)}"
        for x1, y1 in rest:
            if bend:
                middle = number((y + y1) / 2)
                path += f"C{number(x)} {middle} {number(x1)} {middle} {number(x1)} {number(y1)}"
            else:
                path += f"L{number(x1)} {number(y1)}"
            x, y = x1, y1
        extra = _line(stroke, width, dash) + ' marker-end="url(#tip)"' * arrow
        self._parts.append(f'<path d="{path}" fill="none"{extra}/>')

    def text(self, x, y, words, *, size=12, fill=INK, anchor="middle", bold=False) -> None:
        extra = ' font-weight="bold"' * bold
        self._parts.append(
            f'<text x="{number(x)}" y="{number(y)}" font-size="{size}" fill="{fill}" '
            f'text-anchor="{anchor}"{extra}>{escape(words, quote=False)}</text>'
        )

    def source(self) -> str:
        w, h = number(self.width), number(self.height)
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{w}" height="{h}" '
            f'viewBox="0 0 {w} {h}" font-family="Helvetica, Arial, sans-serif">'
        )
        tip = (
            '<defs><marker id="tip" viewBox="0 0 8 8" refX="7.5" refY="4" markerWidth="7" '
            f'markerHeight="7" orient="auto"><path d="M0 0L8 4L0 8z" fill="{GREY}"/></marker>'
            "</defs>"
        )
        back = f'<rect width="{w}" height="{h}" fill="#ffffff"/>'
        return "\n".join([head, tip, back, *self._parts, "</svg>", ""])

    def save(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.source(), encoding="utf-8")


def _line(stroke: str | None, width: float, dash: str) -> str:
    if stroke is None:
        return ""
    extra = f' stroke-width="{width:g}"' * (width != 1.0) + f' stroke-dasharray="{dash}"' * bool(
        dash
    )
    return f' stroke="{stroke}"{extra}'
