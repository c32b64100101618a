# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes without a surface, by their volume shaders: beside Cycles, and what is said of them."""

from __future__ import annotations

import dataclasses
import itertools

import bpy
import numpy as np
import pytest
import vdb_files
from blender_scenes import diffuse, light, mesh, nodes_of, plane, put, ramp_of, read
from engines import bare, blocks, both, render, warnings

from addon import model, pipeline
from addon.plan import looks


def shaded(kind, **inputs):
    """A material whose volume is one shader of that kind."""
    made = bpy.data.materials.new(kind)
    tree = nodes_of(made)
    tree.nodes.clear()
    shader, output = tree.nodes.new(f"ShaderNode{kind}"), tree.nodes.new("ShaderNodeOutputMaterial")
    for name, value in inputs.items():
        shader.inputs[name.replace("_", " ")].default_value = value
    tree.links.new(shader.outputs[0], output.inputs["Volume"])
    return made


def shader_of(material):
    return next(n for n in material.node_tree.nodes if n.outputs and n.outputs[0].type == "SHADER")


def driven(material, socket):
    """Let a socket of the material's shader be the density."""
    told = material.node_tree.nodes.new("ShaderNodeAttribute")
    told.attribute_name = "density"
    material.node_tree.links.new(told.outputs["Fac"], shader_of(material).inputs[socket])
    return material


def ramped(material, socket, stops):
    """Let a socket of the material's shader depend on the density by a colour ramp."""
    ramp = ramp_of(material.node_tree, "density", high=2.0)
    elements = ramp.color_ramp.elements
    while len(elements) < len(stops):
        elements.new(0.5)
    for element, (at, color) in zip(elements, stops, strict=True):
        element.position, element.color = at, (*color, 1)
    material.node_tree.links.new(ramp.outputs["Color"], shader_of(material).inputs[socket])
    return material


def smoke(material, folder, **attributes):
    """A ball of fog of radius 1, seen by its volume shader."""
    volume = bpy.data.volumes.new("Fog")
    volume.filepath = vdb_files.write(folder / "fog.vdb", vdb_files.fog())
    volume.leapray.shown = "volume"
    volume.render.step_size = 0.01
    if material:
        volume.materials.append(material)
    return put("Fog", volume, **attributes)


def before_white(size=24):
    """A scene whose world is grey, seen from four metres."""
    scene = bare(size, size)
    scene.camera.location.z = 4.0
    background = nodes_of(scene.world).nodes["Background"]
    background.inputs["Color"].default_value = (0.3, 0.5, 0.7, 1)
    return scene


def folded(passes):
    """Means of blocks, and of a block and its mirror images, which show the same."""
    mean = blocks(passes["Combined"], 4)
    mean = mean + mean[::-1]
    return (mean + mean[:, ::-1]) / 4


BLACK = (0, 0, 0, 1)
MATERIALS = {
    "absorption": lambda: driven(shaded("VolumeAbsorption", Color=BLACK), "Density"),
    "principled": lambda: shaded("VolumePrincipled", Color=BLACK, Density=0.8),
    "emission": lambda: driven(shaded("Emission", Color=(1, 0.5, 0.2, 1)), "Strength"),
    "both": lambda: ramped(
        shaded("VolumePrincipled", Color=BLACK, Density=1.0, Emission_Strength=2.0),
        "Emission Color",
        [(0.1, (0, 0, 0)), (0.5, (1.0, 0.1, 0.0)), (0.6, (0.0, 0.2, 1.0)), (0.9, (1, 1, 1))],
    ),
}


@pytest.mark.parametrize("name", MATERIALS)
def test_volumes_absorb_and_emit_as_in_cycles(name, tmp_path):
    scene = before_white()
    smoke(MATERIALS[name](), tmp_path, scale=(1.0, 1.0, 0.7))
    theirs, ours = both(scene, samples=256)
    a, b = folded(theirs), folded(ours)
    assert not warnings()
    assert a[..., :3].std() > 0.02
    assert np.abs(a - b)[..., :3].max() < 0.02 * max(a.max(), 1)


@pytest.mark.parametrize("sampling", ["post", "pre"])
def test_samples_at_steps_come_nearer_to_integrals_the_smaller_the_step(sampling, tmp_path):
    """Samples of classified corners keep an error, that of what lies between corners."""
    before_white()
    smoke(MATERIALS["both"](), tmp_path)
    plain = read(24, 24)
    settings = dataclasses.replace(plain.settings, samples=16, noise_threshold=0.0)

    def picture(**more):
        scene = dataclasses.replace(plain, settings=dataclasses.replace(settings, **more))
        return blocks(pipeline.render(scene).passes["Combined"], 4)[..., :3]

    exact = picture()
    off = [
        np.abs(picture(volume_sampling=sampling, step=step) - exact).max()
        for step in (16.0, 2.0, 0.25)
    ]
    assert off[0] > 3 * off[1] > 0
    if sampling == "post":
        assert off[1] > 3 * off[2] and off[2] < 0.02 * exact.max()
    else:
        assert off[2] > 1e-3


def test_rays_that_end_early_are_off_by_what_is_behind_at_most(tmp_path):
    before_white()
    smoke(shaded("VolumePrincipled", Color=BLACK, Density=9.0), tmp_path)
    plain = read(24, 24)
    settings = dataclasses.replace(plain.settings, samples=16, noise_threshold=0.0)
    whole, ended = (
        pipeline.render(
            dataclasses.replace(plain, settings=dataclasses.replace(settings, stop_opacity=stop))
        ).passes["Combined"][..., :3]
        for stop in (1.0, 0.8)
    )
    off = np.abs(whole - ended).max()
    assert 0.02 < off < 0.2 * 0.7 + 1e-3  # of a world as bright as 0.7


def test_surfaces_stand_in_front_within_and_behind(tmp_path):
    scene = before_white()
    smoke(MATERIALS["both"](), tmp_path)
    red = diffuse("Red", (1, 0, 0))
    for name, made, at in (
        ("Floor", plane(size=3.0), (0, 0, -1.2)),
        ("Cube", mesh(size=0.8), (0, 0, 0.1)),
        ("Lid", plane(size=0.3), (0, 0, 1.3)),
    ):
        put(name, made, location=at).data.materials.append(red)
    put("Sun", light("SUN", energy=3.0))
    theirs, ours = both(scene, samples=256)
    a, b = folded(theirs), folded(ours)
    assert np.abs(a - b)[..., :3].max() < 0.02 * a.max()


def test_objects_that_share_data_have_looks_of_their_own(tmp_path):
    before_white()
    first = smoke(MATERIALS["absorption"](), tmp_path)
    second = put("Other", first.data)
    second.material_slots[0].link = "OBJECT"
    second.material_slots[0].material = MATERIALS["emission"]()
    assert len({each.look.key for each in read(16, 16).fields}) == 2
    first.data.leapray.shown = "threshold"
    assert len(read(16, 16).fields) == 1


def test_thresholds_are_not_asked_and_rows_tell_what_is_shown(tmp_path):
    before_white()
    smoke(MATERIALS["absorption"](), tmp_path)
    report = pipeline.render(read(16, 16)).report
    (row,) = report["volumes"]
    assert (row["kind"], row["why"]) == ("volume", "a volume shader")
    assert row["nbytes"] > 0


@pytest.mark.parametrize(
    ("material", "sentence"),
    [
        (None, "Skipped 'Fog': its material 'None' has no volume shader"),
        (
            lambda: shaded("VolumeAbsorption", Density=0.0),
            "'Fog' shows nothing, for nothing of its values is opaque or emits.",
        ),
        (
            lambda: driven(shaded("VolumeAbsorption", Color=(1, 0, 0, 1)), "Density"),
            "'Fog' absorbs all colors alike: the mean of its own.",
        ),
        (
            lambda: shaded("VolumeAbsorption", Color=BLACK, Density=1.0),
            "'Fog' is skipped: the background is visible by this transfer function: the volume "
            "would fill all of space.",
        ),
        (
            lambda: driven(
                shaded("VolumePrincipled", Color=BLACK, Density_Attribute="flame"), "Density"
            ),
            "Not understood, so the sockets' own values stand in: Density Attribute 'flame' in "
            "'VolumePrincipled'",
        ),
    ],
)
def test_what_is_not_shown_as_in_cycles_is_named(material, sentence, tmp_path):
    scene = before_white(8)
    smoke(material and material(), tmp_path)
    put("Floor", plane()).data.materials.append(diffuse("White"))
    render(scene, "LEAPRAY", 1)
    assert warnings() == [sentence]


def test_holdouts_and_cuts_of_what_has_no_surface_are_named(tmp_path):
    scene = before_white(8)
    ob = smoke(MATERIALS["absorption"](), tmp_path)
    ob.is_holdout = True
    ob.data.leapray.clip_object = put("Box", mesh())
    render(scene, "LEAPRAY", 1)
    told = " ".join(warnings())
    assert "A cut through a volume that has no surface is not supported yet: 'Fog'" in told
    assert "Holdout of volumes without a surface is not supported yet: 'Fog'" in told


@pytest.mark.parametrize("wild", [1e5, 1e30, np.inf])
def test_a_single_wild_sample_changes_nothing_elsewhere(wild, tmp_path):
    """It lies near a corner, and the picture's middle does not see it."""
    pictures = []
    for number in (0.5, wild):
        scene = before_white(8)
        material = ramped(
            shaded("VolumePrincipled", Color=BLACK, Density=3.0, Emission_Strength=2.0),
            "Emission Color",
            [(0.1, (0, 0, 0)), (0.25, (1.0, 0.1, 0.0)), (0.3, (0.0, 0.2, 1.0)), (0.5, (1, 1, 1))],
        )
        values = np.broadcast_to(np.linspace(0, 1, 36)[:, None, None], (36, 36, 36)).copy()
        values[2, 2, 2] = number
        volume = smoke(material, tmp_path).data
        volume.filepath = vdb_files.write(
            tmp_path / f"{number}.vdb", vdb_files.grid(values, "density")
        )
        pictures.append(render(scene, "LEAPRAY", 4)["Combined"][3:5, 2:6])
        assert not warnings()
    assert np.ptp(pictures[0]) > 0.5
    assert np.abs(pictures[1] - pictures[0]).max() < 2e-4


def fog_by_nodes(material, size=1.5):
    """A mesh object of which geometry nodes make a fog of that material."""
    tree = bpy.data.node_groups.new("Fog", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    kinds = "NodeGroupInput", "GeometryNodeMeshToVolume", "GeometryNodeSetMaterial"
    nodes = [tree.nodes.new(kind) for kind in (*kinds, "NodeGroupOutput")]
    nodes[2].inputs["Material"].default_value = material
    for one, other in itertools.pairwise(nodes):
        tree.links.new(one.outputs[0], other.inputs[0])
    ob = put("Cube", mesh(size=size))
    ob.modifiers.new("Fog", "NODES").node_group = tree
    return ob


def test_a_fog_that_nodes_make_of_a_mesh_is_a_volume_where_its_material_is():
    scene = before_white()
    material = shaded("VolumePrincipled", Color=BLACK, Density=1.0)
    fog_by_nodes(material)
    theirs, ours = both(scene, samples=16)
    assert not warnings()
    assert np.abs(folded(theirs) - folded(ours)).max() < 0.02
    assert ours["Combined"][12, 12, 2] < 0.4
    assert read(8, 8).fields[0].look is not None
    tree = material.node_tree
    bsdf = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(bsdf.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    assert read(8, 8).fields[0].look is None


def test_a_volume_whose_material_has_no_surface_is_one_as_in_cycles(tmp_path):
    """Without a setting, but where it is chosen otherwise, or the data are a level set."""
    scene = before_white()
    data = smoke(shaded("VolumePrincipled", Color=BLACK, Density=0.8), tmp_path).data
    data.leapray.shown = "auto"
    theirs, ours = both(scene, samples=16)
    assert not warnings()
    assert np.abs(folded(theirs) - folded(ours)).max() < 0.02
    data.leapray.shown = "threshold"
    assert read(8, 8).fields[0].look is None
    data.leapray.shown = "auto"
    data.filepath = vdb_files.write(tmp_path / "ball.vdb", vdb_files.level_set())
    assert read(8, 8).fields[0].look is None


def column(function):
    return lambda values: np.repeat(function(values)[:, None], 3, axis=1)


@pytest.mark.parametrize("high", [1.0, 1e6])
def test_looks_jump_and_end_where_they_do_to_the_last_bit_of_a_sample(high):
    def shown(values):
        return np.where(values < 0.7, np.clip(values - 0.3, 0, 0.1), 5.0)

    made = looks.transfer(model.Look(column(shown), model.nothing), 0.0, high).function
    assert len(made.values) < 12
    ulp = np.spacing(np.float32(0.7))
    at = np.concatenate([np.linspace(0, 1, 1001), [0.7 - 2 * ulp, 0.7 + 2 * ulp]])
    at = at[np.abs(at - 0.7) > ulp]
    got = np.interp(at, made.values, made.extinction)
    np.testing.assert_allclose(got, shown(at), atol=5 * looks.ACCURACY)
    assert made.greatest(0.0, 0.3 - 2 * ulp)[0] == 0.0 < made.greatest(0.0, 0.3 + 2 * ulp)[0]


@pytest.mark.parametrize("ends", [(-1e308, 1e308), (0.0, 1.7e308), (0.0, 5e-324), (1.0, 1 + 1e-12)])
def test_data_of_any_range_have_a_look(ends):
    """Numbers beyond those of f32 are the largest that nodes know."""
    look = model.Look(column(lambda v: np.clip(v, 0, 1)), model.nothing, named=(0.0, 1.0))
    made = looks.transfer(look, *ends).function
    at = np.linspace(max(ends[0], -1.0), min(ends[1], 2.0), 9)
    np.testing.assert_allclose(
        np.interp(at, made.values, made.extinction), np.clip(at, 0, 1), atol=looks.ACCURACY
    )


def test_looks_turn_between_values_that_nodes_name():
    """Between 1e6 and 1e6 + 4, of values from -1e9 to 1e9."""

    def shown(values):
        return np.clip(1 - np.abs(values - 1e6 - 2) / 2, 0, 1)

    look = model.Look(column(shown), model.nothing, named=(1e6, 4.0, 1e6 + 4))
    made = looks.transfer(look, -1e9, 1e9).function
    at = 1e6 + np.linspace(-4, 8, 97)
    np.testing.assert_allclose(
        np.interp(at, made.values, made.extinction), shown(at), atol=5 * looks.ACCURACY + 0.06
    )


def test_few_knots_give_what_many_values_do():
    x = np.linspace(-1, 3, looks.SAMPLES)
    columns = np.column_stack([np.clip(x, 0, 1), np.sin(3 * x), np.where(x > 1.3, 2.0, 0.0)])
    kept = looks.knots(x, columns)
    assert len(kept) < 500
    lines = np.column_stack([np.interp(x, x[kept], c[kept]) for c in columns.T])
    assert np.abs(lines - columns).max() <= 2 * looks.ACCURACY * np.abs(columns).max()
