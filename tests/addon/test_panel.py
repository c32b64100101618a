# SPDX-License-Identifier: GPL-3.0-or-later
"""What an artist meets in the panels: tooltips, names, defaults, presets, the last render."""

import re
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import fresh, light, mesh, plane, put, read

import addon
import leapray
from addon import model, pipeline
from addon.blender import engine, operators, presets, properties, ui, ui_report
from addon.settings import FASTEST, SETTINGS

SAMPLES = sorted((Path(addon.__file__).resolve().parent.parent / "blend_samples").glob("*.blend"))


@pytest.fixture
def scene():
    """A cube above a plane, at the settings that a new scene has."""
    made = fresh(settings={})
    put("Cube", mesh(), location=(0, 0, 1))
    put("Ground", plane(size=6.0))
    put("Sun", light("SUN", energy=3.0), rotation_euler=(0.5, 0.3, 0.0))
    made.render.resolution_x, made.render.resolution_y = 24, 18
    bpy.context.view_layer.update()
    return made


# ---- tooltips and names ------------------------------------------------------


def groups():
    """What of Blender's data model is LeapRay's, as (name, rna)."""
    yield from ((group.__name__, group.bl_rna) for _, group, _ in properties.OWNERS)
    for each in operators.CLASSES:
        module, name = each.bl_idname.split(".")
        yield each.bl_idname, getattr(getattr(bpy.ops, module), name).get_rna_type()


def own(rna):
    """The properties that a group adds to what every group and every file dialog has."""
    base = {p.identifier for p in bpy.types.PropertyGroup.bl_rna.properties}
    base |= {"check_existing", "filepath"}  # of Blender's ExportHelper
    return [p for p in rna.properties if p.identifier not in base]


def test_nothing_is_without_a_tooltip():
    fresh()
    bare, seen = [], 0
    for name, rna in groups():
        assert rna.description or "." not in name, name  # of operators
        for each in own(rna):
            seen += 1
            bare += [] if each.description and each.name else [f"{name}.{each.identifier}"]
            items = each.enum_items if each.type == "ENUM" else ()
            bare += [f"{name}.{each.identifier}: {i.name}" for i in items if not i.description]
    for owner, _, _ in properties.OWNERS:
        assert owner.bl_rna.properties["leapray"].description
    assert seen > 40 and bare == []


def test_a_setting_is_called_as_on_the_command_line():
    fresh()
    for each in own(bpy.context.scene.leapray.bl_rna):
        name = re.sub(r"\W+", "_", each.name.lower()).strip("_")
        asked = each.identifier.replace("auto_", "automatic_").replace("method", "render_method")
        assert name.startswith(asked), (each.identifier, each.name)
        if each.type == "ENUM":
            for item in each.enum_items:
                plain = item.name.lower().replace("-", "_")
                assert item.identifier in plain or item.identifier == "auto", item.name


def test_the_traversers_stand_below_what_they_promise():
    fresh()
    entries = bpy.context.scene.leapray.bl_rna.properties["traverser"]
    shown = [(item.identifier, item.name) for item in entries.enum_items_static_ui]
    heads = [number for number, (spec, _) in enumerate(shown) if not spec]
    assert [shown[number][1] for number in heads] == ["By Trial", "Exact", "Inexact"]
    assert heads[0] == 0 and [spec for spec, _ in shown[1 : heads[1]]] == [FASTEST]
    exact = {entry.spec: entry.exact for entry in leapray.variants()}
    assert len(shown) == len(exact) + 4
    for number, (spec, _) in enumerate(shown[heads[1] :], heads[1]):
        assert not spec or exact[spec] == (number < heads[2]), spec


def test_each_variant_of_a_traverser_says_what_is_true_of_it():
    told = {entry.spec: entry.about for entry in leapray.variants()}
    assert len(set(told.values())) == len(told)
    for entry in leapray.variants():
        faults = re.search(r"miss|drift|wrong|slip|off the ray", entry.about)
        assert bool(faults) != entry.exact, entry.about
        assert not re.search(r"[{}|]", entry.about), entry.about
        assert entry.about in leapray.traverser(entry.spec).about
    for entry in leapray.variants():  # a choice changes the sentence, not more
        for option, chosen in zip(entry.options, entry.chosen, strict=True):
            assert chosen in option.choices


# ---- defaults and presets ----------------------------------------------------

CYCLES = {  # our settings, and what they are in Cycles
    "noise_threshold": "adaptive_threshold",
    "min_samples": "adaptive_min_samples",
    "filter_width": "filter_width",
    "max_bounces": "max_bounces",
    "diffuse_bounces": "diffuse_bounces",
    "glossy_bounces": "glossy_bounces",
    "transmission_bounces": "transmission_bounces",
    "transparent_bounces": "transparent_max_bounces",
    "volume_bounces": "volume_bounces",
    "clamp_direct": "sample_clamp_direct",
    "clamp_indirect": "sample_clamp_indirect",
    "seed": "seed",
}


def test_the_defaults_are_cycles_own(scene):
    for ours, theirs in CYCLES.items():
        want = getattr(scene.cycles, theirs)
        assert getattr(scene.leapray, ours) == want, ours
        assert getattr(model.Settings(), ours) == pytest.approx(want), ours
    assert scene.cycles.pixel_filter_type == scene.leapray.pixel_filter.upper()


def test_a_preset_gives_every_setting_its_value(scene):
    kept = [name for name, s in SETTINGS.items() if s.in_blender and not s.in_presets]
    before = {name: getattr(scene.leapray, name) for name in kept}
    seen = []
    for name, preset in presets.PRESETS.items():
        scene.leapray.resolution, scene.leapray.hit_test = 77, "uniform"
        assert bpy.ops.render.leapray_preset(preset=name) == {"FINISHED"}
        got = properties.settings(scene)
        for key, value in preset.values().items():
            assert getattr(got, key) == (np.float32(value) if isinstance(value, float) else value)
        seen.append(got)
        assert all(getattr(scene.leapray, key) == value for key, value in before.items())
        assert set(preset.differs) <= set(SETTINGS) - set(kept)
        pipeline.check(got)
        assert preset.label and preset.about
    assert len(set(seen)) == len(presets.PRESETS)
    scene.leapray.property_unset("resolution")
    bpy.ops.render.leapray_preset(preset="balanced")
    fresh(settings={})
    assert properties.settings(bpy.context.scene) == replace(seen[1])


@pytest.mark.parametrize("name", presets.PRESETS)
def test_a_preset_renders(scene, name):
    bpy.ops.render.leapray_preset(preset=name)
    scene.leapray.samples = min(scene.leapray.samples, 16)
    frame = pipeline.render(read(24, 18))
    assert frame.warnings == [] and np.isfinite(frame.passes["Combined"]).all()
    assert frame.passes["Combined"][9, 12, :3].min() > 0.1  # the cube, lit from above


def test_a_switch_stands_for_0(scene):
    s = scene.leapray
    for each in own(s.bl_rna):
        found = re.match(r"(auto|use)_(.+)", each.identifier)
        if not found:
            continue
        kind, name = found.groups()
        for on in (True, False, True):
            setattr(s, each.identifier, on)
            assert getattr(s, each.identifier) is on
            assert (getattr(s, name) == 0) == (on == (kind == "auto")), each.identifier
        setattr(s, name, 3)
        assert getattr(s, each.identifier) == (kind == "use")
        setattr(s, each.identifier, kind == "use")  # as it is: nothing changes
        assert getattr(s, name) == 3
    ob = bpy.data.objects["Cube"].leapray
    assert ob.auto_resolution and ob.resolution == 0
    ob.auto_resolution = False
    assert ob.resolution > 1


def test_settings_can_be_keyed(scene):
    s = scene.leapray
    for frame, samples in ((1, 4), (11, 24)):
        s.samples = samples
        s.keyframe_insert("samples", frame=frame)
    scene.frame_set(6)
    assert 4 < properties.settings(bpy.context.evaluated_depsgraph_get().scene_eval).samples < 24


# ---- panels ------------------------------------------------------------------


def test_ours_stand_above_simplify_and_open_for_beginners_alone():
    fresh()
    render = [c for c in ui.CLASSES if getattr(c, "bl_context", "") == "render"]
    names = [c.__name__ for c in render]
    assert names[0] == "RENDER_PT_leapray"
    assert ui.ENGINE not in bpy.types.RENDER_PT_simplify.COMPAT_ENGINES  # it would stand above
    assert names.index("RENDER_PT_leapray_simplify") == len(names) - 1
    is_open = {c.__name__ for c in render if "DEFAULT_CLOSED" not in getattr(c, "bl_options", ())}
    assert is_open == {"RENDER_PT_leapray", "RENDER_PT_leapray_last"}


def test_the_last_render_is_told_until_another_file_is_opened(scene, tmp_path):
    scene.leapray.samples = 1
    put("Nothing", bpy.data.meshes.new("Nothing"))
    assert not ui_report.RENDER_PT_leapray_last.poll(bpy.context)
    bpy.ops.render.render()
    assert ui_report.RENDER_PT_leapray_last.poll(bpy.context)
    (warning,) = ui_report.warnings_of()
    assert "'Nothing'" in warning
    assert ui_report.warnings_of("Nothing") == [warning] and ui_report.warnings_of("Cube") == []
    told = dict(ui_report.statistics(next(iter(engine.reports.values()))))
    assert told["Size"] == "24 x 18 px" and int(told["Rays"].replace(",", "")) >= 24 * 18
    assert told["Volumes"] == "2"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"))
    assert ui_report.warnings_of()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    assert not ui_report.RENDER_PT_leapray_last.poll(bpy.context)


class Drawn:
    """Stands in for a layout of Blender's, and for a region: notes what is written."""

    def __init__(self):
        self.lines, self.width = [], 300

    def column(self, **_):
        return self

    def label(self, text="", icon="NONE"):
        self.lines.append(text)


def test_what_is_never_rendered_says_so_where_it_stands(scene):
    render, camera = scene.render, scene.camera.data
    assert ui_report.unrendered_of_scene(bpy.context) == ""
    render.use_motion_blur = render.use_multiview = True
    assert "motion blur and stereoscopy" in ui_report.unrendered_of_scene(bpy.context)
    assert {name for name in ui_report.UNRENDERED if hasattr(bpy.types, name)} == set(
        ui_report._tellers
    )

    class Context:
        engine = ui.ENGINE

    context, panel = Context(), Drawn()
    context.camera, context.region, panel.layout = camera, panel, panel
    tell = ui_report._tellers["DATA_PT_lens"]
    tell(panel, context)
    assert panel.lines == []
    camera.dof.use_dof, camera.type = True, "PANO"
    tell(panel, context)
    assert "does not render panoramic or custom cameras and depth of field" in " ".join(panel.lines)
    assert max(map(len, panel.lines)) < 45
    context.engine, panel.lines = "CYCLES", []
    tell(panel, context)
    assert panel.lines == []


def test_a_viewport_set_to_rendered_is_answered_in_a_sentence():
    said = []

    class Engine:
        update_stats = staticmethod(lambda *words: said.append(words))

    engine.LeapRayEngine.view_update(Engine, None, None)
    engine.LeapRayEngine.view_draw(Engine, None, None)
    assert said == [("", engine.NO_VIEWPORT)] and "F12" in engine.NO_VIEWPORT


@pytest.mark.parametrize("path", SAMPLES, ids=lambda path: path.stem)
def test_a_sample_opens_with_leapray_and_its_own_settings(path):
    fresh()
    bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False)
    scene = bpy.context.scene
    assert scene.render.engine == ui.ENGINE
    stored = properties.settings(scene)
    assert stored.samples == (
        64 if path.stem in ("fog", "beam") else 16
    )  # what it scatters has noise
    assert (stored.pixel_filter, stored.noise_threshold) == ("box", 0.0)
    assert stored.diffuse_bounces == (4 if path.stem == "cornell" else 0)
