# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes that scatter light, beside Cycles, and what is said of their phase functions."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from blender_scenes import diffuse, light, mesh, nodes_of, plane, put, read
from engines import render, warnings
from test_volume_looks import before_white, driven, folded, ramped, shader_of, smoke
from test_volume_looks import shaded as plain_shaded
from vdb_files import VOXEL

from addon import model, pipeline, pixel_report
from addon.blender.read import phases
from addon.plan import looks

FLAT = (1.0, 1.0, 0.7)
SUN = dict(energy=3.0, angle=0.0)
POINT = dict(energy=300.0, shadow_soft_size=0.1)
COLOR = (0.8, 0.5, 0.3, 1)


def shaded(kind, phase=None, **inputs):
    made = plain_shaded(kind, **inputs)
    if phase:
        shader_of(made).phase = phase
    return made


def dark():
    """A scene without light, 16 x 16 pixels."""
    scene = before_white(16)
    nodes_of(scene.world).nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    return scene


def under(kind, **more):
    place = (0, 0, 2.5) if kind == "POINT" else (0, 0, 0)
    return put(kind, light(kind, **{"SUN": SUN, "POINT": POINT}[kind], **more), location=place)


def beside(scene, things, samples=256, bounces=0):
    """Both engines' pictures; before 5.0 Cycles shows fog half a voxel from its place."""
    scene.cycles.diffuse_bounces = scene.leapray.diffuse_bounces = bounces
    ours = render(scene, "LEAPRAY", samples, bounces)
    told = warnings()
    for thing in things if bpy.app.version < (5, 0) else ():
        thing.location = np.array(thing.location) - VOXEL / 2 * np.array(thing.scale)
    theirs = render(scene, "CYCLES", samples, bounces)
    return theirs, ours, told


def agree(theirs, ours, share=0.02, fold=folded):
    a, b = (fold(passes)[..., :3] for passes in (theirs, ours))
    assert a.max() > 0.01
    assert np.abs(a - b).max() < share * a.max()
    assert abs(b.mean() / a.mean() - 1) < share / 2


@pytest.mark.parametrize(
    ("lamp", "g", "bounces"),
    [("SUN", 0.0, 0), ("POINT", 0.5, 0), ("SUN", 0.5, 3), ("POINT", 0.0, 3), ("SUN", -0.6, 0)],
)
def test_volumes_scatter_as_in_cycles(lamp, g, bounces, tmp_path):
    scene = dark()
    material = shaded("VolumePrincipled", Color=COLOR, Density=1.5, Anisotropy=g)
    fog = smoke(material, tmp_path, scale=FLAT)
    under(lamp)
    scene.cycles.volume_bounces = scene.leapray.volume_bounces = bounces
    theirs, ours, told = beside(scene, [fog])
    assert not told
    agree(theirs, ours, 0.03 if bounces else 0.02)  # light scattered often has more noise


SHADERS = {
    "scatter": lambda: driven(shaded("VolumeScatter", Color=(0.6, 0.6, 0.6, 1)), "Density"),
    "rayleigh": lambda: driven(
        shaded("VolumeScatter", "RAYLEIGH", Color=(0.6, 0.6, 0.6, 1)), "Density"
    ),
    "coefficients": lambda: ramped(
        shaded("VolumeCoefficients", Absorption_Coefficients=(0, 0, 0), Anisotropy=0.3),
        "Scatter Coefficients",
        [(0.0, (0, 0, 0)), (1.0, (1, 1, 1))],
    ),
    "emission": lambda: shaded(
        "VolumePrincipled", Color=COLOR, Density=1.0, Emission_Strength=0.0, Anisotropy=0.2
    ),
}


@pytest.mark.parametrize("name", SHADERS)
def test_every_shader_that_scatters_does_as_in_cycles(name, tmp_path):
    scene = before_white(16)  # the world lights it, too
    fog = smoke(SHADERS[name](), tmp_path, scale=FLAT)
    under("SUN")
    theirs, ours, told = beside(scene, [fog])
    assert not told
    agree(theirs, ours)


def test_surfaces_and_fog_shade_and_light_each_other_as_in_cycles(tmp_path):
    scene = dark()
    fog = smoke(shaded("VolumePrincipled", Color=COLOR, Density=1.5), tmp_path)
    red = diffuse("Red", (1, 0.2, 0.2))
    for name, made, at in (
        ("Floor", plane(size=3.0), (0, 0, -1.2)),
        ("Cube", mesh(size=0.8), (0, 0, 0.1)),
        ("Lid", plane(size=0.3), (0, 0, 1.3)),
    ):
        put(name, made, location=at).data.materials.append(red)
    under("SUN")
    scene.cycles.volume_bounces = scene.leapray.volume_bounces = 1
    theirs, ours, told = beside(scene, [fog], samples=400, bounces=1)
    assert not told
    agree(theirs, ours)


def test_volumes_that_overlap_scatter_as_in_cycles(tmp_path):
    scene = dark()
    fogs = []
    for name, color, place in (("a", (0.9, 0.2, 0.2, 1), 0.4), ("b", (0.2, 0.4, 0.9, 1), -0.4)):
        (tmp_path / name).mkdir()
        material = shaded("VolumePrincipled", Color=color, Density=0.8)
        fogs.append(smoke(material, tmp_path / name, location=(0, 0, place), scale=FLAT))
    under("POINT")
    theirs, ours, _ = beside(scene, fogs)
    agree(theirs, ours)


@pytest.mark.parametrize("flag", ["Floor", "Sun", "World"])
def test_what_scattered_rays_do_not_see_as_in_cycles(flag, tmp_path):
    scene = before_white(16)
    fog = smoke(shaded("VolumePrincipled", Color=COLOR, Density=1.5), tmp_path)
    bright = bpy.data.materials.new("Bright")
    tree = nodes_of(bright)
    shine = tree.nodes.new("ShaderNodeEmission")
    shine.inputs["Strength"].default_value = 2.0
    tree.links.new(shine.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    floor = put("Floor", plane(size=1.5), location=(0, 0, -1.3))
    floor.data.materials.append(bright)
    sun = under("SUN")
    if flag == "World":
        scene.world.cycles_visibility.scatter = False
    else:
        {"Floor": floor, "Sun": sun}[flag].visible_volume_scatter = False
    theirs, ours, told = beside(scene, [fog])
    assert not told
    agree(theirs, ours)


def test_volumes_that_scattered_rays_do_not_see(tmp_path):
    dark()
    fog = smoke(shaded("VolumePrincipled"), tmp_path)
    fog.visible_volume_scatter = False
    fog.visible_glossy = False
    (found,) = read(8, 8).field_instances
    assert (found.visible_volume_scatter, found.visible_glossy) == (False, False)
    assert found.visible_transmission


def test_limits_and_numbers_out_of_range_are_those_of_cycles(tmp_path):
    scene = dark()
    fog = smoke(shaded("VolumePrincipled", Color=(0.7, 0.7, 0.7, 1), Density=1.5), tmp_path)
    shader_of(fog.data.materials[0]).inputs["Color"].default_value = (1.5, 1.5, 1.5, 1)
    under("POINT")
    scene.cycles.volume_bounces = scene.leapray.volume_bounces = 1
    theirs, ours, _ = beside(scene, [fog])
    agree(theirs, ours)


# ---- what stands in for what is not there ------------------------------------------------


def told_of(material, tmp_path):
    scene = dark()
    scene.render.resolution_x = scene.render.resolution_y = 4
    smoke(material(), tmp_path)
    under("SUN")
    render(scene, "LEAPRAY", 1)
    return warnings()


@pytest.mark.parametrize(
    ("phase", "name"),
    [("DRAINE", "Draine"), ("MIE", "Mie"), ("FOURNIER_FORAND", "Fournier Forand")],
)
def test_other_phase_functions_are_named(phase, name, tmp_path):
    got = told_of(lambda: driven(shaded("VolumeScatter", phase), "Density"), tmp_path)
    assert got[0].startswith(f"The phase function {name}, in place of which stands")
    assert "'VolumeScatter'" in got[0]
    assert read(8, 8).fields[0].look.phase == "henyey_greenstein"


@pytest.mark.parametrize(("g", "phase"), [(0.9, None), (0.2, None), (0.2, "RAYLEIGH")])
def test_mixtures_of_phase_functions_are_named(g, phase, tmp_path):
    def material():
        made = driven(shaded("VolumeScatter", Anisotropy=0.2), "Density")
        tree = made.node_tree
        other, both = (tree.nodes.new(f"ShaderNode{n}") for n in ("VolumeScatter", "AddShader"))
        other.inputs["Density"].default_value = 0.0
        other.inputs["Anisotropy"].default_value = g
        other.phase = phase or other.phase
        output = tree.nodes["Material Output"]
        first = output.inputs["Volume"].links[0].from_socket
        tree.links.new(first, both.inputs[0])
        tree.links.new(other.outputs[0], both.inputs[1])
        tree.links.new(both.outputs[0], output.inputs["Volume"])
        return made

    got = told_of(material, tmp_path)
    assert len(got) == (g == 0.9 or phase is not None)
    if got:
        assert got[0].startswith("A mixture of phase functions, in place of which stands one of")


def test_an_anisotropy_that_varies_is_named(tmp_path):
    (sentence,) = told_of(
        lambda: driven(shaded("VolumePrincipled", Density=1.0), "Anisotropy"), tmp_path
    )
    assert sentence.startswith("All values of 'Fog' scatter by one anisotropy, the mean of their")


def test_the_mean_of_an_anisotropy_is_by_what_is_scattered():
    def part(values):
        return lambda v: np.interp(v, [0, 1], values)[:, None] * np.ones(3)

    look = model.Look(part([0, 4]), part([0, 0]), part([0, 2]), part([0, 1]))
    got = looks.transfer(look, 0.0, 1.0)
    assert got.anisotropy == pytest.approx(0.5)
    assert got.even
    assert got.grey
    assert np.abs(got.function.scattering[-1] - 2).max() < 1e-9
    look = model.Look(part([0, 4]), part([0, 0]), part([1, 1]), lambda v: 0.3 * part([2, 0])(v))
    got = looks.transfer(look, 0.0, 1.0)
    assert got.anisotropy == pytest.approx(0.3, abs=1e-3)
    assert not got.even


def test_densities_of_any_size_are_those_of_a_wall(tmp_path):
    """Lit from before, scattered once: as bright at any density from some on."""
    pictures = []
    for density in (1e6, 1e20, 1e30, np.inf):
        scene = dark()
        under("SUN")
        material = ramped(shaded("VolumeScatter"), "Color", [(0, (0, 0, 0)), (0.1, (1, 1, 1))])
        shader_of(material).inputs["Density"].default_value = density
        smoke(material, tmp_path)
        pictures.append(render(scene, "LEAPRAY", 16)["Combined"][6:10, 6:10])
        assert not warnings()
        assert (pictures[-1][..., 3] == 1.0).all()
    for picture in pictures[1:]:
        assert picture.mean() == pytest.approx(pictures[0].mean(), rel=0.02)


@pytest.mark.parametrize("density", [1e6, 1e20, 1e36])
def test_what_shines_within_is_as_bright_at_any_density(density, tmp_path):
    scene = dark()
    material = shaded("VolumePrincipled", Color=(0, 0, 0, 1), Density=density)
    tree = driven(material, "Emission Strength").node_tree
    half = tree.nodes.new("ShaderNodeMath")
    half.operation, half.inputs[1].default_value = "MULTIPLY", 0.5 * density
    link = shader_of(material).inputs["Emission Strength"].links[0]
    tree.links.new(link.from_socket, half.inputs[0])
    tree.links.new(half.outputs[0], shader_of(material).inputs["Emission Strength"])
    smoke(material, tmp_path)
    picture = render(scene, "LEAPRAY", 1)["Combined"][6:10, 6:10, :3]
    np.testing.assert_allclose(picture, 0.5, rtol=1e-4)
    assert not warnings()


@pytest.mark.parametrize("g", [-0.8, 0.0, 0.5, 0.9])
@pytest.mark.parametrize("alpha", [0.0, 1.0, 250.0])
def test_the_mean_cosine_of_draines_function(g, alpha):
    x = (np.arange(200000) + 0.5) / 100000 - 1
    p = (1 + alpha * x * x) / (1 + g * g - 2 * g * x) ** 1.5
    assert phases.draine(g, alpha) == pytest.approx((p * x).sum() / p.sum(), abs=1e-4)


def test_the_mean_cosine_of_fournier_and_forands_function():
    """Of their density, by a sum over directions."""
    n, b = 1.33, 0.1
    s = ((np.arange(400000) + 0.5) / 400000) ** 4
    within = phases._within(s, n, b)
    assert within[-1] == pytest.approx(1, abs=1e-5)
    assert np.interp(0.5, s, within) == pytest.approx(1 - b, abs=1e-4)
    mean = (np.diff(within) * (1 - s[1:] - s[:-1])).sum()
    assert phases.fournier_forand(n, b) == pytest.approx(mean, abs=1e-3)


def test_droplets_scatter_the_more_forwards_the_larger_they_are():
    means = [phases.mie(d) for d in (0.0, 0.05, 0.5, 5.0, 20.0, 50.0)]
    assert means[0] == 0
    assert means[1] < 0.1 < means[2]
    assert np.diff(means[2:]).min() > 0
    assert means[-1] < 0.95
    for d in (0.1, 1.5, 5.0):  # where the fit changes
        assert phases.mie(d) == pytest.approx(phases.mie(d + 1e-9), abs=0.03)


def test_a_recorded_pixel_tells_where_it_was_scattered(tmp_path):
    scene = dark()
    scene.leapray.volume_bounces = 1
    smoke(shaded("VolumePrincipled", Density=1.5), tmp_path)
    under("SUN")
    told = pipeline.render(read(8, 8), pixel=(4, 4)).report["pixel"]
    points = [ray["scattered"] for ray in told["rays"] if ray["scattered"]]
    assert points
    assert points[0]["object"] == "Fog"
    assert np.linalg.norm(points[0]["position"]) < 1.3
    assert told["rays"][0]["volumes"][0]["cells"] > 10
    text = "\n".join(pixel_report.lines(told))
    assert "is scattered in Fog at t " in text
    assert "volume, after ray 0" in text
    assert np.abs(np.array(told["sum"]) - told["value"][:3]).max() < 1e-6
