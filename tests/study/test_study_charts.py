# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts and pages of studies can be read: on any colour, on a phone, in the legend."""

import re

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib import colormaps
from matplotlib.colors import to_rgb

import leapray
from addon.study import charts, page, report

PHONE = 390  # pixels


def luminance(color):
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(color)]
    return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))


def contrast(a, b):
    """The ratio of the Web Content Accessibility Guidelines: 4.5 is asked of small text."""
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("name", ["OrRd", "Reds", "viridis", "inferno", "Greys", "Blues"])
def test_figures_are_read_on_every_colour_of_a_map(name):
    colors = [colormaps[name](fraction) for fraction in np.linspace(0, 1, 65)]
    inks = [charts.ink_on(color) for color in colors]
    assert len(set(inks)) == 2
    worst = min(contrast(color[:3], ink) for color, ink in zip(colors, inks, strict=True))
    assert worst > 3.9  # 4.58 is what black and white could do; INK is not quite black


def test_a_legend_tells_every_traverser_apart():
    looks = [tuple(charts.look(k).values()) for k in range(len(leapray.traversers()))]
    assert len(set(looks)) == len(looks)
    marks = [(look["color"], look["marker"]) for look in map(charts.look, range(len(looks)))]
    assert len(set(marks)) == len(marks)  # for points without lines, too
    assert charts.STYLE["legend.handlelength"] > 2.5


def test_nothing_on_a_page_asks_for_more_than_a_phones_width():
    for least in re.findall(r"minmax\(([^()]*(?:\([^()]*\))?)", page.STYLE):
        assert "100%" in least, least
    for width in re.findall(r"(?<!max-)width: (\d+)px", page.STYLE):
        assert int(width) < PHONE
    assert "touch-action: none" not in page.STYLE  # the slider lets the page be scrolled
    whole = page.whole("Title", [page.table(["", "a"], [["x", "1"]])])
    assert "width=device-width" in whole and '<div class="wide"><table>' in whole


def run(label, seconds, **phases):
    report_ = {"seconds": {**phases, "total": seconds}, "bytes": {"peak": 2**21}}
    errors = {"all": {"rmse": 0.25}, "but_rims": {"rmse": 0.125}}
    return {"label": label, "seconds": seconds, "report": report_, "light": errors}


@pytest.fixture
def told():
    errors = {"all": {"rmse": 0.5}, "but_rims": {"rmse": 0.375}}
    return {
        "runs": {"a": run("First", 3.0, read=1.0, trace=2.0), "b": run("Second", 5.0, plan=4.5)},
        "cycles": {"by_samples": {4: {"seconds": 7.0, **errors}}},
        "by_samples": {1: {"seconds": 0.5, **errors}},
        "samples": 4,
    }


def test_the_figures_of_a_chart_stand_in_a_table(told):
    rows = re.findall(r"<tr>(.*?)</tr>", report.time_table(told))
    cells = [re.findall(r"<t[hd]>(.*?)</t[hd]>", row) for row in rows]
    assert cells[0] == ["", "seconds", "read, s", "trace, s", "plan, s", "peak, MB"]
    assert cells[1] == ["LeapRay, First", "3.00", "1.00", "2.00", report.NONE, "2.0"]
    assert cells[2][4:] == ["4.50", "2.0"] and cells[3][:2] == ["Cycles, samples: 4", "7.00"]
    rows = re.findall(r"<tr>(.*?)</tr>", report.error_table(told))
    cells = [re.findall(r"<td>(.*?)</td>", row) for row in rows[1:]]
    assert ["Cycles, samples: 4", "7.00", "0.5000", "0.3750"] in cells
    assert ["LeapRay, Second", "5.00", "0.2500", "0.1250"] in cells and len(cells) == 4


def test_the_charts_of_a_report_are_narrow(told, tmp_path):
    from PIL import Image

    for file, *_ in report.draw_charts(tmp_path, told):
        with Image.open(tmp_path / file) as image:
            assert image.width < 2.5 * PHONE, file  # letters of 21 pixels become 9 on a phone
