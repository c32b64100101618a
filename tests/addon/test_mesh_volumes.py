# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes filled by the volume of their material: as Blender's nodes say, and beside Cycles."""

from __future__ import annotations

import bpy
import flip_evaluator
import numpy as np
import pytest
from blender_scenes import diffuse, light, mesh, nodes_of, plane, put, read
from engines import blocks, both, render, warnings
from test_volume_looks import before_white, shaded, shader_of

from addon import pipeline
from addon.arrays import srgb

COLOR = (0.8, 0.5, 0.3, 1)
TURNED = (0.3, 0.4, 0.1)
PIXELS = 32


def dark(pixels=PIXELS):
    scene = before_white(pixels)
    nodes_of(scene.world).nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    return scene


def box(material, size=2.0, **more):
    ob = put("Box", mesh(size=size), **{"rotation_euler": TURNED, **more})
    ob.data.materials.append(material)
    return ob


def with_surface(volume, kind, **inputs):
    """That material with a surface shader beside its volume."""
    tree = volume.node_tree
    shader = tree.nodes.new(f"ShaderNode{kind}")
    for name, value in inputs.items():
        shader.inputs[name].default_value = value
    tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return volume


def sphere(material, radius=1.0):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius, segments=48, ring_count=24)
    ball = bpy.context.object
    ball.data.shade_smooth()
    ball.data.materials.append(material)
    return ball


def floor(z, material=None, size=6.0):
    put("Floor", plane(size=size), location=(0, 0, z)).data.materials.append(
        material or diffuse("Grey", (0.8, 0.8, 0.8))
    )


def sun(**more):
    return put("Sun", light("SUN", energy=3.0, angle=0.3), rotation_euler=(0.5, 0.2, 0), **more)


def agree(scene, samples=64, bounces=0, share=0.02, flip=0.03):
    """FLIP of pixels where there is no noise, else of means of 2 x 2, whose noise is half."""
    scene.cycles.volume_bounces = scene.leapray.volume_bounces = bounces
    theirs, ours = (p["Combined"] for p in both(scene, samples, min(bounces, 1)))
    assert not warnings()
    a, b = (blocks(p, 8)[..., :3] for p in (theirs, ours))
    assert a.max() > 0.01 and a.std() > 0.002
    assert np.abs(a - b).max() < share * a.max()
    pictures = (srgb(np.clip(blocks(p, 2)[..., :3], 0, 1)) for p in (theirs, ours))
    found, _, _ = flip_evaluator.evaluate(*(p.astype(np.float32) for p in pictures), "LDR")
    assert found.mean() < flip


# ---- beside Cycles ---------------------------------------------------------------------

SHADERS = {
    "absorption": lambda: shaded("VolumeAbsorption", Color=(0.2, 0.5, 0.9, 1), Density=0.8),
    "scatter": lambda: shaded("VolumeScatter", Color=COLOR, Density=0.7, Anisotropy=0.3),
    "rayleigh": lambda: shaded("VolumeScatter", Color=COLOR, Density=0.7),
    "principled": lambda: shaded(
        "VolumePrincipled", Color=COLOR, Density=1.0, Anisotropy=-0.3,
        Absorption_Color=(0.1, 0.4, 0.2, 1), Emission_Strength=0.1, Emission_Color=(0, 0.2, 1, 1),
    ),
    "coefficients": lambda: shaded(
        "VolumeCoefficients", Absorption_Coefficients=(0.1, 0.5, 1),
        Scatter_Coefficients=(0.5, 0.3, 0.2), Emission_Coefficients=(0.1, 0.05, 0.2),
    ),
    "emission": lambda: shaded("Emission", Color=(1, 0.5, 0.2, 1), Strength=0.3),
    "blackbody": lambda: shaded(
        "VolumePrincipled", Color=(0, 0, 0, 1), Density=0.5, Blackbody_Intensity=0.5,
        Temperature=1800.0, Blackbody_Tint=(1, 0.8, 0.6, 1),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SHADERS)
def test_every_volume_shader_fills_a_mesh_as_in_cycles(name):
    scene = before_white(PIXELS)
    material = SHADERS[name]()
    if name == "rayleigh":
        shader_of(material).phase = "RAYLEIGH"
    box(material)
    sun()
    agree(scene)


def test_meshes_that_are_scaled_keep_their_density_per_unit_of_the_world():
    scene = before_white(PIXELS)
    box(SHADERS["absorption"](), scale=(0.5, 0.7, 1.4))
    agree(scene, samples=16)


def test_light_is_scattered_often_by_coloured_fog_as_in_cycles():
    scene = before_white(PIXELS)
    box(shaded("VolumeCoefficients", Absorption_Coefficients=(0, 0, 0),
               Scatter_Coefficients=(0.4, 1.0, 2.5)))  # fmt: skip
    sun()
    agree(scene, samples=256, bounces=8)


@pytest.mark.slow
def test_a_room_of_fog_from_within_as_in_cycles():
    scene = dark()
    box(shaded("VolumePrincipled", Color=COLOR, Density=0.15, Anisotropy=0.2), size=12)
    floor(-1.0)
    put("Cube", mesh(size=1.0)).data.materials.append(diffuse("Red", (1, 0.2, 0.2)))
    sun()
    agree(scene, samples=256, bounces=2)


@pytest.mark.slow
def test_a_spot_in_fog_as_in_cycles():
    scene = dark()
    box(shaded("VolumeScatter", Color=(1, 1, 1, 1), Density=0.1), size=8, rotation_euler=(0, 0, 0))
    floor(-2.0)
    lamp = light("SPOT", energy=1000, spot_size=0.6, spot_blend=0.3, shadow_soft_size=0.1)
    put("Spot", lamp, location=(-2.5, 0, 2.5), rotation_euler=(0, -0.8, 0))
    scene.camera.location, scene.camera.rotation_euler = (0, -6, 1), (1.45, 0, 0)
    agree(scene, samples=256, share=0.03)


@pytest.mark.slow
def test_glass_in_fog_and_fog_in_glass_as_in_cycles():
    scene = before_white(PIXELS)
    box(shaded("VolumeScatter", Color=(0.9, 0.9, 0.9, 1), Density=0.3), 3, rotation_euler=(0, 0, 0))
    glass = shaded("VolumeAbsorption", Color=(0.9, 0.6, 0.3, 1), Density=1.0)
    sphere(with_surface(glass, "BsdfGlass", Roughness=0.0, IOR=1.45), 0.8)
    agree(scene, samples=128, bounces=2)


def test_scattering_in_glass_as_in_cycles():
    scene = before_white(PIXELS)
    milk = shaded("VolumeScatter", Color=(0.9, 0.6, 0.3, 1), Density=1.0)
    sphere(with_surface(milk, "BsdfGlass", Roughness=0.0, IOR=1.45), 1.2)
    agree(scene, samples=128, bounces=4)


@pytest.mark.slow
def test_fog_before_a_mirror_and_in_it_as_in_cycles():
    """Lit by the world: a lamp in a mirror, which light samples do not find, is noise."""
    scene = before_white(PIXELS)
    box(shaded("VolumeScatter", Color=(0.9, 0.9, 0.9, 1), Density=0.5), 1.5, location=(0, 0, 0.3))
    mirror = with_surface(diffuse("Mirror"), "BsdfGlossy", Roughness=0.0)
    put("Mirror", plane(size=3.0), location=(0, 0, -1.0), rotation_euler=(0.5, 0.1, 0))
    bpy.data.objects["Mirror"].data.materials.append(mirror)
    floor(-2.0)
    agree(scene, samples=256, bounces=1)


@pytest.mark.parametrize("kind", ["BsdfTransparent", "BsdfDiffuse"])
def test_surfaces_of_filled_meshes_as_in_cycles(kind):
    scene = before_white(PIXELS)
    box(with_surface(shaded("VolumeScatter", Density=0.5), kind, Color=(0.9, 0.7, 0.5, 1)))
    sun()
    agree(scene)


def test_filled_meshes_overlap_and_cast_coloured_shadows_as_in_cycles():
    scene = dark()
    for x, color in ((-0.4, (1, 0.2, 0.2, 1)), (0.4, (0.2, 0.3, 1, 1))):
        box(shaded("VolumeAbsorption", Color=color, Density=0.8), 1.0, location=(x, 0, 0.2))
    floor(-1.0)
    sun()
    agree(scene)


@pytest.mark.parametrize("flag", ["camera", "shadow"])
def test_what_rays_do_not_see_as_in_cycles(flag):
    scene = before_white(PIXELS)
    hidden = box(shaded("VolumeAbsorption", Color=(0.2, 0.5, 0.9, 1), Density=0.8), 1.5)
    setattr(hidden, f"visible_{flag}", False)
    floor(-1.2)
    sun()
    agree(scene)


# ---- what is read, and said ------------------------------------------------------------


def rendered(pixels=4):
    """Warnings, and the mean colour."""
    frame = pipeline.render(read(pixels, pixels))
    assert np.isfinite(frame.passes["Combined"]).all()
    return frame.warnings, frame.passes["Combined"][..., :3].mean((0, 1))


def close():
    """A scene in which the box fills the picture."""
    scene = before_white(4)
    scene.camera.data.lens = 500
    return scene


def test_values_of_the_nodes():
    dark()
    box(shaded("VolumePrincipled", Color=(0.5, 0.25, 2.0, 1), Density=2.0, Anisotropy=0.25,
               Absorption_Color=(0.25, 0, 0, 1), Emission_Strength=3.0,
               Emission_Color=(1, 0.5, 0, 1)))  # fmt: skip
    (made,) = read().materials
    assert made.bare and made.lobes == () and made.fills
    np.testing.assert_allclose(made.scattering, (1, 0.5, 4))
    np.testing.assert_allclose(made.absorption, (0.5, 1.5, 0), atol=1e-6)
    np.testing.assert_allclose(made.glow, (3, 1.5, 0))
    assert (made.anisotropy, made.phase) == (0.25, "henyey_greenstein")


def test_a_density_that_varies_is_named_and_its_own_value_taken():
    close()
    material = shaded("VolumeAbsorption", Color=(0, 0, 0, 1), Density=0.5)
    tree = material.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(noise.outputs[0], shader_of(material).inputs["Density"])
    box(material, rotation_euler=(0, 0, 0))
    told, color = rendered()
    (sentence,) = told
    assert "Noise Texture" in sentence and "'VolumeAbsorption'" in sentence
    np.testing.assert_allclose(color, np.array([0.3, 0.5, 0.7]) * np.exp(-1.0), rtol=1e-3)


def test_an_open_mesh_is_named_and_holds_nothing():
    close()
    put("Sheet", plane()).data.materials.append(shaded("VolumeScatter", Density=5.0))
    (sentence,), color = rendered()
    assert sentence.startswith("'Sheet' has no inside (open: 4 border edges), so the volume")
    np.testing.assert_allclose(color, (0.3, 0.5, 0.7), rtol=1e-5)


@pytest.mark.parametrize("density", [0.0, 1e-30, 1e30])
def test_densities_of_any_size(density):
    close()
    box(shaded("VolumeAbsorption", Color=(0, 0, 0, 1), Density=density), rotation_euler=(0, 0, 0))
    told, color = rendered()
    assert not told
    np.testing.assert_allclose(color, (0, 0, 0) if density > 1 else (0.3, 0.5, 0.7), rtol=1e-5)


def test_a_density_that_is_no_number_is_named():
    close()
    box(shaded("VolumeScatter", Density=np.nan))
    (sentence,), _ = rendered()
    assert "'VolumeScatter' has a value that is no number" in sentence


def test_instances_are_filled_as_well():
    scene = close()
    first = box(shaded("VolumeAbsorption", Color=(0, 0, 0, 1), Density=0.5),
                rotation_euler=(0, 0, 0), location=(0, 0, -2))  # fmt: skip
    put("Other", first.data, location=(0, 0, -4.5), scale=(1, 1, 0.5))
    scene.camera.data.clip_end = 1000
    told, color = rendered()
    assert not told
    np.testing.assert_allclose(color, np.array([0.3, 0.5, 0.7]) * np.exp(-1.5), rtol=1e-3)


def test_smoke_of_a_domain_is_named_and_left_out():
    close()
    domain = box(shaded("VolumePrincipled", Density=5.0))
    fluid = domain.modifiers.new("Fluid", "FLUID")
    fluid.fluid_type = "DOMAIN"
    assert fluid.domain_settings.domain_type == "GAS"
    put("Cube", mesh(), location=(0, 0, -9))
    found = read(4, 4)
    assert found.warnings == ("Smoke and fire of fluid domains are not supported yet: 'Box'",)
    assert [each.name for each in found.instances] == ["Cube"]


def test_a_holdout_without_a_surface_is_named():
    close()
    box(shaded("VolumeScatter")).is_holdout = True
    (sentence,), _ = rendered()
    assert sentence == "Holdout of volumes without a surface is not supported yet: 'Box'"


@pytest.mark.parametrize("density", [1e3, 1e17, 1e30, np.inf])
def test_fog_as_dense_as_a_wall_scatters_what_the_integral_says(density):
    """A sun behind the eye, upright: once scattered its light has gone in and out the same way,
    and is the integral of exp(-2 x), by the isotropic phase function."""
    scene = dark(8)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 1.0
    put("Sun", light("SUN", energy=3.0, angle=0.0))
    box(shaded("VolumeScatter", Density=density, Color=(1, 1, 1, 1)), rotation_euler=(0, 0, 0))
    picture = render(scene, "LEAPRAY", 64)["Combined"][..., :3]
    assert picture.mean() == pytest.approx(3 / (8 * np.pi), rel=0.01)
    assert not warnings()
