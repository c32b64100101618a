# SPDX-License-Identifier: GPL-3.0-or-later
"""The descriptions of settings hold everywhere: command line, Blender, presets, renders."""

from __future__ import annotations

import math
from dataclasses import replace

import bpy
import pytest
from blender_scenes import fresh, mesh, put

from addon import arguments, cli, pipeline
from addon.blender import properties
from addon.blender.presets import PRESETS
from addon.descriptions import described
from addon.settings import SETTINGS, Isosurfaces, Modelling, Settings
from leapray import LeapRayError


def outside():
    """Of each number a value below, one above and none."""
    for name, setting in SETTINGS.items():
        if setting.minimum is None:
            continue
        yield name, setting.minimum - (1 if setting.kind is int else 1e-3 * setting.maximum)
        yield name, setting.maximum + (setting.kind is int or setting.maximum)
        if setting.kind is float:
            yield name, math.nan


@pytest.mark.parametrize(("name", "value"), list(outside()))
def test_what_is_out_of_range_is_refused_before_work_begins(name, value, capfd):
    with pytest.raises(LeapRayError, match=f"^{name} must be at (least|most) "):
        pipeline.check(replace(Settings(), **{name: value}))
    if SETTINGS[name].option:
        option = f"--{name.replace('_', '-')}"
        assert cli.main(["render", "a.blend", f"{option}={value}"]) == 2
        assert capfd.readouterr().err.startswith(f"leapray: {option} must be at ")


def within():
    """Of each setting the command line's words for its ends or choices, and what they mean."""
    for name, setting in SETTINGS.items():
        option = f"--{name.replace('_', '-')}"
        if not setting.option:
            continue
        if setting.kind is bool:
            yield from ((name, [option], True), (name, [option.replace("--", "--no-")], False))
        elif setting.minimum is not None:
            least = setting.zero_word or setting.minimum
            yield name, [option, str(least)], setting.minimum
            yield name, [option, str(setting.maximum)], setting.maximum
        else:
            yield from ((name, [option, word], word) for word in setting.names() or ["somewhere"])


@pytest.mark.parametrize(("name", "words", "value"), list(within()))
def test_an_option_takes_what_the_setting_may_be(name, words, value):
    args = vars(arguments.parse(["render", "a.blend", *words]))
    assert args[name] == value
    assert [other for other in SETTINGS if args.get(other) is not None] == [name]
    pipeline.check(replace(Settings(), **{name: value}))


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_holds_sound_values_that_are_not_the_defaults(preset):
    differs = PRESETS[preset].differs
    pipeline.check(replace(Settings(), **PRESETS[preset].values()))
    assert not [name for name, value in differs.items() if value == SETTINGS[name].default]


def test_blender_holds_what_is_described():
    fresh(settings={})
    cube = put("Cube", mesh())
    cloud = bpy.data.volumes.new("Cloud")
    for owner, has in (
        (Settings, bpy.context.scene),
        (Modelling, cube),
        (Isosurfaces, cloud),
    ):
        known = has.leapray.bl_rna.properties
        for name, setting in described(owner).items():
            if not setting.in_blender:
                assert name not in known
                continue
            told = known[name]
            assert (told.name, told.description) == (setting.label, setting.tooltip)
            assert told.is_animatable == setting.animates
            if setting.choices:
                assert [each.identifier for each in told.enum_items] == setting.names()
                continue
            assert told.subtype == setting.unit
            if setting.minimum is not None:
                limits = (told.hard_min, told.hard_max)
                assert limits == pytest.approx((setting.minimum, setting.maximum))


@pytest.mark.parametrize("end", ["hard_min", "hard_max"])
def test_what_the_panel_takes_can_be_rendered(end):
    scene = fresh(settings={})
    known = scene.leapray.bl_rna.properties
    for name, setting in SETTINGS.items():
        if setting.in_blender and setting.minimum is not None:
            setattr(scene.leapray, name, getattr(known[name], end))
    pipeline.check(properties.settings(scene))
