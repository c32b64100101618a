# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages of studies: one file each, pictures inside, nothing fetched (no bpy)."""

from __future__ import annotations

import base64
import html
from pathlib import Path

STYLE = """
:root { --ink: #1d2126; --soft: #5d6672; --line: #e3e6ea; --back: #fafbfc; --card: #fff;
  --good: #00724f; --bad: #b8430a; }
* { box-sizing: border-box }
body { margin: 0; background: var(--back); color: var(--ink);
  font: 15px/1.5 system-ui, "Segoe UI", Roboto, sans-serif }
main { max-width: 1180px; margin: 0 auto; padding: 40px 24px 80px }
h1 { font-size: 30px; line-height: 1.2; margin: 0 0 4px; font-weight: 650 }
h2 { font-size: 19px; margin: 52px 0 12px; font-weight: 650 }
p, li { max-width: 76ch } .soft { color: var(--soft) }
h1, p, li, figcaption, summary { overflow-wrap: anywhere }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 14px;
  background: var(--card); width: 100% }
th, td { padding: 6px 12px; text-align: right; border-bottom: 1px solid var(--line) }
th:first-child, td:first-child { text-align: left }
th { color: var(--soft); font-weight: 500 }
td { white-space: nowrap }
td:first-child { white-space: normal; min-width: 9em }
th:first-child, td:first-child { position: sticky; left: 0; background: var(--card) }
.wide { overflow-x: auto; border: 1px solid var(--line); border-radius: 8px; margin: 10px 0 }
.wide table tr:last-child td { border-bottom: 0 }
.good { color: var(--good) } .bad { color: var(--bad); font-weight: 600 }
.two figure { margin: 0 }
.two { margin: 18px 0; display: grid; gap: 18px;
  grid-template-columns: repeat(auto-fit, minmax(min(440px, 100%), 1fr)) }
figure { margin: 18px 0; background: var(--card); border: 1px solid var(--line); border-radius: 8px;
  overflow: hidden }
figure img { display: block; width: 100%; height: auto; cursor: zoom-in }
figcaption { padding: 8px 12px; font-size: 13.5px; color: var(--soft) }
figcaption b { color: var(--ink); font-weight: 600 }
.slider { position: relative; user-select: none; touch-action: pan-y; cursor: ew-resize }
.slider img { display: block; width: 100%; cursor: ew-resize }
.slider .over { position: absolute; inset: 0; clip-path: inset(0 0 0 50%) }
.slider .bar { position: absolute; top: 0; bottom: 0; left: 50%; width: 2px; margin-left: -1px;
  background: #fff; box-shadow: 0 0 4px #0008 }
.slider span { position: absolute; bottom: 10px; padding: 2px 9px; background: #0009; color: #fff;
  border-radius: 4px; font-size: 13px }
dialog { border: 0; padding: 0; max-width: 100vw; max-height: 100vh; background: #111 }
dialog img { display: block; image-rendering: pixelated; cursor: zoom-out }
details { margin: 8px 0 } summary { cursor: pointer }
@media (max-width: 600px) {
  main { padding: 20px 14px 60px } h1 { font-size: 24px } h2 { margin-top: 36px }
  th, td { padding: 5px 8px } th:first-child, td:first-child { max-width: 42vw }
}
"""

SCRIPT = """
for (const slider of document.querySelectorAll('.slider')) {
  const move = event => {
    const box = slider.getBoundingClientRect();
    const at = Math.min(100, Math.max(0, 100 * (event.clientX - box.left) / box.width));
    slider.querySelector('.over').style.clipPath = `inset(0 0 0 ${at}%)`;
    slider.querySelector('.bar').style.left = at + '%';
  };
  slider.addEventListener('pointermove', move);
  slider.addEventListener('pointerdown', move);
  slider.addEventListener('dragstart', event => event.preventDefault());
}
const dialog = document.querySelector('dialog'), large = dialog.querySelector('img');
for (const image of document.querySelectorAll('figure img')) image.addEventListener('click', () => {
  large.src = image.src;
  large.style.width = 2 * image.naturalWidth + 'px';
  dialog.showModal();
});
dialog.addEventListener('click', () => dialog.close());
"""


def esc(words: str) -> str:
    return html.escape(words)


def table(head: list[str], rows: list[list[str]]) -> str:
    """An HTML table; cells are HTML."""
    top = "".join(f"<th>{cell}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f'<div class="wide"><table><tr>{top}</tr>{body}</table></div>'


def findings(sentences: list[str]) -> str:
    """What a study found, a line for each sentence."""
    return "<ul>" + "".join(f"<li>{esc(sentence)}</li>" for sentence in sentences) + "</ul>"


def data(folder: Path, name: str) -> str:
    """A picture as a data URI."""
    return "data:image/png;base64," + base64.b64encode((folder / name).read_bytes()).decode()


def figure(folder: Path, name: str, title: str, caption: str) -> str:
    """A picture of the folder with its caption; a click magnifies it."""
    return (
        f'<figure><img alt="{esc(title)}" src="{data(folder, name)}">'
        f"<figcaption><b>{esc(title)}</b>: {esc(caption)}</figcaption></figure>"
    )


def whole(title: str, body: list[str]) -> str:
    """The page."""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{esc(title)}</title><style>{STYLE}</style></head><body>"
        f'<main>{"".join(body)}</main><dialog><img alt=""></dialog>'
        f"<script>{SCRIPT}</script></body></html>"
    )
