# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects of labels: bodies with materials, colours of a table, indices, cuts."""

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import colored, diffuse, light, mesh, nodes_of, put, read, sunlit

import addon
import leapray
from addon import pipeline
from addon.blender import open_file
from addon.blender.read import labels as read_labels

nib = pytest.importorskip("nibabel")

SIZE = 80, 60
PASSES = "Combined", "Depth", "Position", "Normal", "Object Index", "Material Index", "Volume"
N = 32
RADIUS = 0.8


@pytest.fixture
def scene():
    return sunlit(SIZE)


def axes():
    """x, y and z of the samples, 2 / N apart round the origin."""
    place = (np.arange(N) - (N - 1) / 2) * 2 / N
    return np.meshgrid(place, place, place, indexing="ij")


def quarters(numbers=(2, 5, 9, 40)):
    """A ball in four labels by the signs of x and y."""
    x, y, z = axes()
    return np.choose((x > 0) + 2 * (y > 0), numbers) * (x * x + y * y + z * z < RADIUS**2)


def show(path, samples, *materials, kind="label", **settings):
    """A volume object of labels, whose pass index is 3."""
    matrix = np.diag([2 / N] * 3 + [1.0])
    matrix[:3, 3] = -(N - 1) / N
    image = nib.Nifti1Image(np.asarray(samples), matrix, dtype=np.asarray(samples).dtype)
    image.header.set_intent(kind)
    file = path / "labels.nii"
    nib.save(image, file)
    data = bpy.data.volumes.new("Labels")
    data.leapray.file = str(file)
    for key, value in settings.items():
        setattr(data.leapray, key, value)
    for each in materials:
        data.materials.append(each)
    return put("Labels", data, pass_index=3)


def shining(name, color=(1, 1, 1), index=0):
    made = bpy.data.materials.new(name)
    tree = nodes_of(made)
    tree.nodes.clear()
    bsdf, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Emission", "OutputMaterial"))
    bsdf.inputs["Color"].default_value = (*color, 1)
    tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    made.pass_index = index
    return made


def see_through(name, kind="BsdfTransparent", color=(1, 1, 1), index=0):
    made = bpy.data.materials.new(name)
    tree = nodes_of(made)
    tree.nodes.clear()
    bsdf, output = (tree.nodes.new(f"ShaderNode{each}") for each in (kind, "OutputMaterial"))
    bsdf.inputs["Color"].default_value = (*color, 1)
    tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    made.pass_index = index
    return made


def mixed(name, share, color, index=0):
    """So much of an emission, the rest transparent."""
    made = shining(name, color, index)
    tree = made.node_tree
    glow, output = tree.nodes["Emission"], tree.nodes["Material Output"]
    clear, mix = tree.nodes.new("ShaderNodeBsdfTransparent"), tree.nodes.new("ShaderNodeMixShader")
    mix.inputs[0].default_value = share
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(glow.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return made


def render(size=SIZE, **settings):
    bpy.context.view_layer.update()
    made = replace(read(*size), passes=PASSES)
    return pipeline.render(replace(made, settings=replace(made.settings, **settings)))


def label_at(frame, samples, inset=0.3):
    """The label of the sample nearest to what each pixel shows, a bit beneath; 0 at the rims."""
    place = frame.passes["Position"] - inset * 2 / N * frame.passes["Normal"]
    at = np.rint(place * N / 2 + (N - 1) / 2).astype(int)
    seen = frame.passes["Object Index"][..., 0] != 0
    clear = np.abs(place[..., :2]).min(axis=2) > 1.5 / N
    at = at.clip(0, N - 1)
    return np.where(seen & clear, samples[at[..., 0], at[..., 1], at[..., 2]], 0)


def test_the_nth_label_has_the_nth_material_and_the_last_is_for_the_rest(scene, tmp_path):
    samples = quarters().astype(np.uint8)
    show(tmp_path, samples, *(shining(f"M{n}", index=20 + n) for n in range(3)))
    frame = render()
    assert frame.warnings == []
    found = label_at(frame, samples)
    for label, index in ((2, 20), (5, 21), (9, 22), (40, 22)):
        here = found == label
        assert here.sum() > 100
        assert (frame.passes["Material Index"][here] == index).all()
    assert (frame.passes["Object Index"][found > 0] == 3).all()
    (row,) = frame.report["volumes"]
    assert (row["kind"], row["why"], row["labels"], row["name"]) == (
        "labels", "4 labels", 4, "Labels"
    )  # fmt: skip


@pytest.mark.parametrize("given", ["no material", "one", "one for all"])
def test_without_materials_each_label_has_a_color(given, scene, tmp_path):
    samples = quarters((1, 2, 3, 300)).astype(np.int16)
    worn = [] if given == "no material" else [shining("Glow")]
    show(tmp_path, samples, *worn, label_colors=given != "one for all", label_index=True)
    frame = render()
    found = label_at(frame, samples)
    colors = []
    for label in (1, 2, 3, 300):
        here = found == label
        index = 0 if given == "one for all" else label
        assert (frame.passes["Material Index"][here] == index).all()
        assert (frame.passes["Object Index"][here] == label).all()
        color = frame.passes["Combined"][here][:, :3].mean(axis=0)
        colors.append(color / np.linalg.norm(color))
    apart = min(np.linalg.norm(a - b) for n, a in enumerate(colors) for b in colors[:n])
    assert (apart > 0.05) == (given == "no material")  # an emission keeps its own


def test_a_table_gives_colors_that_differ():
    made = np.array([read_labels.of_table(number) for number in range(1, 25)])
    apart = np.linalg.norm(np.sqrt(made)[:, None] - np.sqrt(made), axis=2) + np.eye(24)
    assert made.min() >= 0 and made.max() <= 1
    assert apart[:12, :12].min() > 0.2 and apart.min() > 0.07


def test_a_files_own_colors_are_taken(scene, tmp_path):
    grid = leapray.ScalarGrid("map", np.ones((2, 2, 2), int), np.eye(4), kind="labels",
                              label_names={1: "Bone"},
                              label_colors={1: (1.0, 0.5, 0.0)})  # fmt: skip
    (made,) = read_labels.materials(
        read_labels.model.Material("", (leapray.Lobe("diffuse"),)), grid, [1]
    )
    assert made.name == "Bone" and made.index == 1
    assert made.lobes[0].color == pytest.approx((1.0, 0.2140, 0.0), abs=1e-4)


@pytest.mark.parametrize(("shown", "kind"), [("labels", "none"), ("auto", "label")])
def test_the_user_may_say_that_data_are_labels(shown, kind, scene, tmp_path):
    show(tmp_path, quarters().astype(np.float32), kind=kind, shown=shown)
    assert render().report["volumes"][0]["kind"] == "labels"


@pytest.mark.parametrize(("shown", "kind"), [("threshold", "label"), ("auto", "none")])
def test_other_data_have_thresholds(shown, kind, scene, tmp_path):
    show(tmp_path, quarters().astype(np.uint8), kind=kind, shown=shown)
    assert render().report["volumes"][0]["kind"] == "isosurface"


def test_borders_of_labels_do_not_show_the_voxels(scene, tmp_path):
    """A slanting border between two labels: nearest samples would be off by up to half a sample."""
    x, y, z = axes()
    slant = 0.4
    samples = np.where(y > slant * x, 1, 2) * (np.abs(z) < 0.5)
    show(tmp_path, samples.astype(np.uint8), shining("A", index=11), shining("B", index=12))
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 1.2
    frame = render((256, 192))
    top = frame.passes["Normal"][..., 2] > 0.99
    top &= frame.passes["Object Index"][..., 0] == 3
    assert top.sum() > 10000
    x, y = frame.passes["Position"][top][:, :2].T
    off = (y - slant * x) / np.hypot(1, slant) * N / 2  # in samples
    wrong = (frame.passes["Material Index"][top][:, 0] == 11) != (off > 0)
    assert np.abs(off[wrong]).max() < 0.45
    assert wrong.mean() * len(off) / (np.abs(off) < 0.5).sum() < 0.13  # by nearest ones: 0.25


# ---- light ---------------------------------------------------------------------


def shell():
    """A hollow ball of three labels, a sample or two thick."""
    x, y, z = axes()
    r = np.sqrt(x * x + y * y + z * z)
    turn = np.floor((np.arctan2(y, x) / np.pi + 1) * 1.4999).astype(int)
    return (np.choose(turn, (1, 2, 3)) * (abs(r - RADIUS) < 1.2 / N * 1.5)).astype(np.uint8)


def test_no_light_leaves_through_where_labels_touch(scene, tmp_path):
    """A light within three thin labels, seen from six sides by its light on walls around."""
    scene.objects["Sun"].data.energy = 0
    show(tmp_path, shell(), *(diffuse(f"M{n}") for n in range(3)))
    put("Lamp", light("POINT", energy=1000.0, shadow_soft_size=0.1))
    scene.camera.location = (1.7, 1.2, 6)
    put("Room", mesh(size=20.0))
    frame = render()
    assert (frame.passes["Object Index"] == 3).any()
    assert frame.passes["Combined"][..., :3].max() == 0
    bpy.data.objects["Labels"].hide_render = True
    bpy.data.objects.remove(bpy.data.objects["Labels"])
    assert render().passes["Combined"][..., :3].min() > 0  # there was light to see


def nested():
    """Label 1 in label 2 in label 3, each touching the next, and beside them label 4."""
    x, y, z = axes()
    r = np.sqrt(x * x + y * y + z * z)
    made = np.select([r < 0.25, r < 0.5, r < 0.8], [1, 2, 3], 0)
    made[(made == 3) & (x > 0.45)] = 4
    return made.astype(np.uint8)


def test_see_through_labels_show_what_lies_in_them(scene, tmp_path):
    """Each surface covers a third of what is behind: that of 3, of 2, then 1 itself."""
    worn = [shining("In", (0, 0, 1)), mixed("Mid", 1 / 3, (0, 1, 0)),
            mixed("Out", 1 / 3, (1, 0, 0)), shining("Side", (1, 1, 1))]  # fmt: skip
    show(tmp_path, nested(), *worn)
    frame = render(samples=400)
    assert frame.warnings == []
    assert [row["labels"] for row in frame.report["volumes"]] == [1, 1, 2]
    middle = frame.passes["Combined"][
        SIZE[1] // 2 - 1 : SIZE[1] // 2 + 1, SIZE[0] // 2 - 1 : SIZE[0] // 2 + 1
    ]
    # the inner side of 3's surface round 2 lies a third of a voxel in it, and is seen as well
    share = 1 / 3
    through = 1 - share
    want = (share + through**2 * share, through * share, through**3)
    assert middle.mean(axis=(0, 1))[:3] == pytest.approx(want, abs=0.04)


@pytest.mark.parametrize("nested_media", [True, False])
def test_glass_in_and_beside_glass_neither_makes_nor_loses_light(nested_media, scene, tmp_path):
    """A furnace: all that is seen is as bright as the world, but for paths that never end."""
    bpy.data.objects.remove(bpy.data.objects["Sun"])
    world = nodes_of(scene.world).nodes["Background"].inputs["Color"]
    world.default_value = (0.5, 0.6, 0.7, 1)
    worn = [see_through(name, "BsdfGlass") for name in ("Glass", "Water")]
    show(tmp_path, nested(), *worn, see_through("Air"), see_through("Side", "BsdfGlass"))
    bounces = dict.fromkeys(("max_bounces", "transmission_bounces", "glossy_bounces"), 64)
    frame = render(samples=64, nested=nested_media, transparent_bounces=64, **bounces)
    assert len(frame.report["volumes"]) == 4
    seen = frame.passes["Combined"][frame.passes["Object Index"][..., 0] == 3][:, :3]
    assert len(seen) > 600
    assert seen.mean(axis=0) == pytest.approx((0.5, 0.6, 0.7), rel=0.04)
    assert (seen <= np.array((0.5, 0.6, 0.7)) * 1.0001).all()


# ---- cuts, memory, what is refused ---------------------------------------------


@pytest.mark.parametrize("clear", [False, True])
def test_the_face_of_a_cut_shows_the_labels(clear, scene, tmp_path):
    samples = quarters().astype(np.uint8)
    worn = [shining(f"M{n}", index=20 + n) for n in range(4)]
    if clear:
        worn[1] = see_through("Clear", index=21)
    cube = put("Cutter", mesh(), location=(0, 0, 1.25))
    cube.hide_render = cube.hide_viewport = True
    show(tmp_path, samples, *worn, clip_object=cube)
    frame = render()
    assert frame.warnings == []
    kinds = [row["kind"] for row in frame.report["volumes"]]
    assert kinds == ["labels"] * (1 + clear) + ["clip"]
    face = frame.passes["Volume"][..., 0] == len(kinds)
    assert face.sum() > 500
    assert frame.passes["Position"][face][:, 2] == pytest.approx(0.25, abs=1e-3)
    x, y = frame.passes["Position"][face][:, :2].T
    clear_of_rims = np.minimum(abs(x), abs(y)) > 1 / N
    want = 20 + (x > 0) + 2 * (y > 0)
    assert (frame.passes["Material Index"][face][clear_of_rims, 0] == want[clear_of_rims]).all()


def test_labels_beyond_the_budget_are_coarser_and_stay_labels(scene, tmp_path, monkeypatch):
    samples = quarters((2, 5, 9, 40)).astype(np.uint8)
    show(tmp_path, samples, label_index=True)
    whole = render()
    needed = whole.report["volumes"][0]["nbytes"]
    from addon.plan import fields

    monkeypatch.setattr(fields, "MB", needed * 0.8 / 16)
    monkeypatch.setattr("addon.plan.plan.MB", needed * 0.8 / 16)
    frame = render(memory_mb=16)
    (warning,) = frame.warnings
    assert "16 x 16 x 16 samples of its 32 x 32 x 32" in warning
    assert set(np.unique(frame.passes["Object Index"])) == {0, 2, 5, 9, 40}
    both = (whole.passes["Object Index"] != 0) & (frame.passes["Object Index"] != 0)
    same = whole.passes["Object Index"][both] == frame.passes["Object Index"][both]
    assert same.mean() > 0.9  # borders are off by half a sample


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: (
                np.arange(N**3).reshape(N, N, N) * 2
                + np.arange(2).repeat(N**3 // 2).reshape(N, N, N)
            ),
            "",
        ),
        (lambda: np.zeros((N, N, N)), "no labels, but 0 alone"),
        (lambda: np.full((N, N, N), 0.5), "must be whole numbers"),
        (lambda: np.full((N, N, N), -3.0), "must be whole numbers"),
    ],
)
def test_what_are_no_labels_is_a_sentence(make, words, scene, tmp_path, monkeypatch):
    if not words:
        monkeypatch.setattr(read_labels, "MOST", 1000)
        words = "has 32767 labels; ids hold 1001"
        words = "labels; ids hold 1001"
    show(tmp_path, make().astype(np.float32), shown="labels")
    put("Cube", mesh())
    frame = render()
    (warning,) = frame.warnings
    assert "'Labels'" in warning and words in warning


def test_settings_that_labels_do_not_take_are_named(scene, tmp_path):
    show(tmp_path, quarters().astype(np.uint8), invert=True, least=7, interpolation="cubic")
    (warning,) = render().warnings
    assert "'Labels' shows labels, for which Interpolation, Smallest Part, Invert do" in warning


def test_materials_of_labels_that_ask_for_attributes_are_named(scene, tmp_path):
    show(tmp_path, quarters().astype(np.uint8), colored("Values", "value"), shining("Other"))
    (warning,) = render().warnings
    assert "Textures on labels" in warning and "'Labels'" in warning


def test_smoothing_makes_normals_those_of_the_ball(scene, tmp_path):
    ob = show(tmp_path, quarters().astype(np.uint8))
    off = []
    for smoothing in (0.0, 2.0):
        ob.data.leapray.smoothing = smoothing
        frame = render()
        seen = frame.passes["Object Index"][..., 0] == 3
        place, normal = frame.passes["Position"][seen], frame.passes["Normal"][seen]
        radius = np.linalg.norm(place, axis=1)
        assert np.abs(radius - RADIUS).max() < 1.5 * 2 / N  # a sample and what rounds its corner
        turned = (place / radius[:, None] * normal).sum(axis=1).clip(-1, 1)
        off.append(np.degrees(np.arccos(turned)).mean())
    assert off[1] < 0.7 * off[0] and off[1] < 3


def test_a_mesh_beside_keeps_its_index(scene, tmp_path):
    samples = quarters().astype(np.uint8)
    put("Cube", mesh(size=0.5), location=(1.4, 0, 0), pass_index=77)
    show(tmp_path, samples, label_index=True)
    for layout in ("objects", "scene"):
        frame = render(layout=layout)
        assert set(np.unique(frame.passes["Object Index"])) == {0, 2, 5, 9, 40, 77}


def test_the_sample_of_labels_shows_its_tissues():
    """Skin and brain on the face of the cut, eyes on the surface, each by its index."""
    path = Path(addon.__file__).resolve().parent.parent / "blend_samples" / "labels.blend"
    open_file.open_scene(path)
    got = replace(read(128, 128), passes=PASSES)
    assert got.warnings == ()
    frame = pipeline.render(replace(got, settings=replace(got.settings, samples=1)))
    assert frame.warnings == []
    index = frame.passes["Object Index"][..., 0]
    face = frame.passes["Volume"][..., 0] == 3
    assert set(np.unique(index[face])) >= {1, 2, 3} and set(np.unique(index)) == {0, 1, 2, 3, 4}
    assert (index[face] == 3).sum() > 500 and (index[~face] == 4).sum() > 50
    brain = frame.passes["Combined"][face & (index == 3)][:, :3].mean(axis=0)
    assert brain[0] > 1.8 * brain[1]
    assert sum(each.stat().st_size for each in path.parent.glob("*labels*")) < 400_000
