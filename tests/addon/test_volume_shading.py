# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes shaded by their gradient in Blender: what the panel's numbers mean, presets, warnings."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from blender_scenes import fresh, light, put, read
from engines import render, warnings
from test_volume_looks import driven, ramped, shaded, smoke
from test_volume_presets import choose, fog
from test_volume_scatter import dark
from vdb_files import VOXEL

from addon import model
from addon.blender import ui
from addon.blender.presets import LOOKS
from addon.plan import looks

SHADED = [name for name, look in LOOKS.items() if look.shading]


def light_of(field):
    """What instances of a field whose values go from 0 to 2 are told."""
    return looks.light_of(field, looks.transfer(field.look, 0.0, 2.0))


def test_the_panel_s_numbers_reach_the_look(tmp_path):
    dark()
    ob = smoke(driven(shaded("VolumeScatter"), "Density"), tmp_path)
    assert read(8, 8).fields[0].look.shading == model.GradientShading()
    own = ob.data.leapray
    assert not own.use_gradient_shading
    own.use_gradient_shading = True
    assert own.gradient_shading == 1.0
    own.gradient_shading, own.gradient_scale = 0.5, 4.0
    own.gradient_roughness, own.gradient_specular = 0.25, 0.75
    bpy.context.view_layer.update()
    assert read(8, 8).fields[0].look.shading == model.GradientShading(0.5, 4.0, 0.25, 0.75)
    assert light_of(read(8, 8).fields[0])["roughness"] == 0.25


@pytest.mark.parametrize(
    ("stops", "width"),
    [
        ([(0.0, (0, 0, 0)), (1.0, (1, 1, 1))], 2.0),  # a ramp over all values
        ([(0.25, (0, 0, 0)), (0.5, (1, 1, 1))], 0.5),  # constant beyond 1
        ([(0.25, (0, 0, 0)), (0.3, (1, 1, 1)), (0.5, (0.5, 0.1, 1))], 0.5),
        ([(0.5, (0, 0, 0)), (0.50001, (1, 1, 1))], 2.0),  # a jump has no range
    ],
)
def test_a_scale_is_for_a_change_by_a_voxel_as_a_share_of_what_the_look_shows(
    stops, width, tmp_path
):
    """The colour ramp lies over values from 0 to 2."""
    dark()
    scatter = ramped(shaded("VolumeCoefficients"), "Scatter Coefficients", stops)
    ob = smoke(scatter, tmp_path)
    ob.data.leapray.gradient_shading = 1.0
    told = light_of(read(8, 8).fields[0])
    # A change by a tenth of the width over a voxel is 1, whatever the units.
    slope = width / 10 / VOXEL
    assert told["gradient_scale"] * slope == pytest.approx(1.0, rel=0.01)


def test_modulation_is_by_the_same_changes_and_thins_what_is_even(tmp_path):
    """Of the ball of fog, whose values fall over eight voxels, the even inside goes."""
    scene = dark()
    ob = smoke(driven(shaded("VolumeAbsorption", Color=(0, 0, 0, 1)), "Density"), tmp_path)
    scene.render.film_transparent = True
    seen = {}
    for modulation in (0.0, 0.125, 0.25):  # of a range of 2; the fog falls by 1/4 over a voxel
        ob.data.leapray.gradient_modulation = modulation
        bpy.context.view_layer.update()
        field = read(8, 8).fields[0]
        told = looks.transfer(field.look, 0.0, 2.0, looks.voxel(field))
        assert told.function.full_gradient == pytest.approx(2 * modulation / VOXEL, rel=1e-5)
        alpha = render(scene, "LEAPRAY", 4)["Combined"][..., 3]
        seen[modulation] = -np.log(1 - alpha[7:9, 7:9]).mean()
    assert not warnings()
    # 2 x 14 of 36 voxels of the inside have the density 2, 8 at each end 1 in the mean.
    assert seen[0.0] == pytest.approx((28 * 2 + 16) * VOXEL, rel=0.05)
    assert seen[0.125] == pytest.approx(16 * VOXEL, rel=0.1)
    assert seen[0.25] == pytest.approx(8 * VOXEL, rel=0.1)


@pytest.mark.parametrize("ends", [(-600.0, 1200.0), (150.0, 1500.0), (-1000.0, 300.0)])
def test_the_range_of_a_look_is_that_of_its_ramp_however_far_data_go(ends):
    """Within data as of a CT; where it is constant, rounding is no change."""
    low, high = ends

    def ramp(values):
        share = np.float32(1 / (high - low)) * (values - low).astype(np.float32)
        return np.repeat(np.clip(share, 0, 1)[:, None], 3, axis=1).astype(float) ** 2

    for most in (2136.0, 1e6):  # one wild sample
        width = looks.transfer(model.Look(ramp, ramp, named=ends), -1000.0, most).width
        assert width == pytest.approx(high - low, rel=0.02)


def test_of_even_data_nothing_is_a_boundary():
    even = model.Look(*[lambda v: np.ones((len(v), 3))] * 2)
    assert looks.transfer(even, 3.0, 3.0).width == 0.0
    assert looks.transfer(replace(even, modulation=0.5), 3.0, 3.0).function.full_gradient > 0


def test_boundaries_are_darker_where_they_turn_from_the_light(tmp_path):
    """By a sun that casts no shadows fog is lit alike on both sides, unless it is shaded."""
    scene = dark()
    material = ramped(
        shaded("VolumeCoefficients", Absorption_Coefficients=(0, 0, 0)),
        "Scatter Coefficients",
        [(0.3, (0, 0, 0)), (0.5, (900, 900, 900))],
    )
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 3.0
    ob = smoke(material, tmp_path)
    sun = put("Sun", light("SUN", energy=3.0), rotation_euler=(0, 0.6, 0))  # from +x
    sun.data.use_shadow = False
    ratios = []
    ob.data.leapray.gradient_scale, ob.data.leapray.gradient_specular = 1000.0, 0.0
    for amount in (0.0, 1.0):
        ob.data.leapray.gradient_shading = amount
        seen = render(scene, "LEAPRAY", 32)["Combined"][..., 0]
        ratios.append(seen[:, 8:].sum() / seen[:, :8].sum())
    assert not warnings()
    assert ratios[0] == pytest.approx(1.0, abs=0.1)
    # Lambert's cosine over the halves of a disc.
    x, y = np.meshgrid(*[(np.arange(400) + 0.5) / 200 - 1] * 2)
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    cosine = np.where(z > 0, np.maximum(x * np.sin(0.6) + z * np.cos(0.6), 0), 0)
    assert ratios[1] == pytest.approx(cosine[:, 200:].sum() / cosine[:, :200].sum(), rel=0.1)


def test_what_scatters_no_light_is_named(tmp_path):
    scene = dark()
    ob = smoke(driven(shaded("VolumeAbsorption", Color=(0, 0, 0, 1)), "Density"), tmp_path)
    ob.data.leapray.gradient_shading = 1.0
    render(scene, "LEAPRAY", 1)
    (told,) = warnings()
    assert told == "'Fog' is not shaded by its gradient, for its shader scatters no light."


@pytest.mark.parametrize("name", SHADED)
def test_a_shaded_preset_scatters_what_the_other_emits(name, tmp_path):
    fresh()
    ob, found = fog(tmp_path), {}
    for each in (name.removesuffix("_shaded"), name):
        choose(ob, each)
        found[each] = read(8, 8).fields[0].look
        assert ob.data.leapray.gradient_shading == LOOKS[each].shading
    plain, made = found.values()
    values = np.linspace(0, 2, 101)
    assert made.extinction(values) == pytest.approx(plain.extinction(values), rel=1e-5)
    assert made.scattering(values) == pytest.approx(plain.emission(values), rel=1e-5)
    assert not made.emission(values).any()
    assert not plain.scattering(values).any()


class Column:
    """A layout that notes which properties are drawn."""

    def __init__(self):
        self.shown = []

    def prop(self, owner, name, **_):
        self.shown.append(name)

    def row(self, **_):
        return self


def test_the_panel_shows_its_numbers_where_it_is_on():
    fresh()
    own = bpy.data.volumes.new("Fog").leapray
    for on in (False, True):
        own.use_gradient_shading, column = on, Column()
        column.use_property_decorate = False
        ui._draw_shading(column, own)
        assert ("gradient_scale" in column.shown) == on
