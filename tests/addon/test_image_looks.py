# SPDX-License-Identifier: GPL-3.0-or-later
"""Images are looked up as in Cycles: alpha modes, depths, colour spaces, interpolation, ramps."""

import itertools

import bpy
import numpy as np
import pytest
from blender_scenes import fresh
from cycles_values import emitter, middles, picture
from test_materials import node

import leapray
from addon.blender.read import images, materials
from addon.blender.read.warnings import Warnings

SIDE = 8
WIDTH, HEIGHT = 7, 5
MODES = ("STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE")
SPACES = ("sRGB", "Non-Color", "Linear Rec.709", "Linear Rec.2020", "ACEScg", "Filmic Log")


def colors(channels=4):
    """Rows from above, straight alpha; some of it 0 and 1."""
    rng = np.random.default_rng(11)
    made = rng.uniform(0.05, 0.95, (HEIGHT, WIDTH, 4)).astype(np.float32)
    made[0, :, 3], made[1, :3, 3] = 1, 0
    return made[..., [0, 3]] if channels == 2 else made[..., :channels]


def stored(folder, suffix, kind, channels=4, straight=True):
    """An image in a file; its colours are straight, or multiplied by alpha."""
    bpy.utils.expose_bundled_modules()
    import OpenImageIO as oiio

    pixels = colors(channels).copy()
    spec = oiio.ImageSpec(WIDTH, HEIGHT, channels, kind)
    if straight and channels in (2, 4):
        spec.attribute("oiio:UnassociatedAlpha", 1)
    elif channels == 4:
        pixels[..., :3] *= pixels[..., 3:]
    path = str(folder / f"{kind}{channels}{straight:d}.{suffix}")
    out = oiio.ImageOutput.create(path)
    assert out.open(path, spec) and out.write_image(pixels)
    out.close()
    return bpy.data.images.load(path)


def generated(is_float):
    made = bpy.data.images.new("Made", WIDTH, HEIGHT, alpha=True, float_buffer=is_float)
    made.pixels.foreach_set(colors()[::-1].ravel())
    return made


def look(image, use="color", after=None, **settings):
    """A material that emits an image's colour or alpha, with its alpha used or not."""

    def build(tree):
        texture = node(tree, "TexImage")
        texture.image = image
        for name, value in settings.items():
            setattr(texture, name, value)
        if settings.get("extension"):
            place = node(tree, "TexCoord")
            mapping = node(tree, "Mapping", Vector=place.outputs["UV"], Location=(-0.5, -0.6, 0),
                           Scale=(2, 2.2, 1))  # fmt: skip
            tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
        if use == "both":  # the alpha is used, and counts for nothing
            none = node(tree, "Math", Value=texture.outputs["Alpha"], Value_001=1e-7)
            none.operation = "MULTIPLY"
            mix = node(tree, "Mix", Factor_Float=none)
            mix.data_type = "RGBA"
            a = next(s for s in mix.inputs if s.identifier == "A_Color")
            tree.links.new(texture.outputs["Color"], a)
            return next(s for s in mix.outputs if s.type == "RGBA")
        found = texture.outputs["Alpha" if use == "alpha" else "Color"]
        return after(tree, found) if after else found

    return emitter(build, shift=0)


def ours(made):
    """(SIDE, SIDE, 3) of the material's texture, and the sentences it gives."""
    notes = Warnings()
    read, texture = materials.read(made, notes)
    if read.image is None:
        return np.broadcast_to(read.lobes[0].color, (SIDE, SIDE, 3)), notes.sentences()
    uvs = np.concatenate([middles(SIDE), np.zeros((SIDE * SIDE, 1), np.float32)], axis=1)
    image = read.image
    core = leapray.Texture(image.pixels, image.interpolation, image.extension, image.program)
    looks = core.sample(texture.place(uvs)[:, :2])
    return looks.reshape(SIDE, SIDE, 3), notes.sentences()


def agree(made, names):
    """Each material is in LeapRay what it is in Cycles, within its precision of halves, which
    logarithms multiply."""
    got = [ours(each) for each in made]
    want = picture(made, SIDE)
    bad = []
    for name, (mine, sentences), theirs in zip(names, got, want, strict=True):
        mine, theirs = np.maximum(mine, 0), np.maximum(theirs, 0)  # of negative light
        error = (np.abs(mine - theirs) / np.maximum(theirs, 1)).max()
        tolerance = 0.03 if "Filmic Log" in name else 4e-3
        if error > tolerance or sentences:
            bad.append((name, round(float(error), 4), sentences))
    assert not bad, f"{len(bad)} of {len(names)}: {bad}"


FILES = [("png", "uint8", 4, True), ("png", "uint8", 3, True), ("png", "uint8", 2, True),
         ("png", "uint8", 1, True), ("png", "uint16", 4, True), ("png", "uint16", 1, True),
         ("tif", "uint8", 4, True), ("tif", "uint16", 4, False), ("tga", "uint8", 4, True),
         ("exr", "half", 4, False), ("exr", "float", 4, False), ("exr", "float", 3, False),
         ("jpg", "uint8", 3, True), ("tif", "float", 4, False)]  # fmt: skip


@pytest.mark.parametrize("packed", [False, True])
def test_files_of_every_depth_in_every_alpha_mode(tmp_path, packed):
    fresh()
    made, names = [], []
    for file, mode in itertools.product(FILES, MODES):
        image = stored(tmp_path, *file)
        image.alpha_mode = mode
        if packed:
            image.pack()
        for use in ("color", "alpha", "both"):
            names.append((*file, mode, use, image.colorspace_settings.name))
            made.append(look(image, use))
    agree(made, names)


def test_generated_images_in_every_alpha_mode():
    fresh()
    made, names = [], []
    for is_float, mode, use in itertools.product((False, True), MODES, ("color", "alpha", "both")):
        image = generated(is_float)
        image.alpha_mode = mode
        names.append((is_float, mode, use))
        made.append(look(image, use))
    agree(made, names)


def test_every_colour_space(tmp_path):
    fresh()
    made, names = [], []
    for file, space, use in itertools.product(
        FILES[:2] + FILES[3:5] + FILES[9:11], SPACES, ("color", "both")
    ):
        for packed in (False, True):
            image = stored(tmp_path, *file)
            image.colorspace_settings.name = space
            if packed:
                image.pack()
            names.append((*file, space, use, packed))
            made.append(look(image, use))
    agree(made, names)


def ramp(tree, found):
    """Black, and white from 0.5 on, by a step."""
    made = node(tree, "ValToRGB", Fac=found)
    made.color_ramp.interpolation = "CONSTANT"
    made.color_ramp.elements[1].position = 0.5
    return made.outputs["Color"]


def steep(tree, found):
    """A slope of 20 by Map Range, and a power of what comes out of it."""
    made = node(tree, "MapRange", Value=found)
    made.inputs["From Min"].default_value, made.inputs["From Max"].default_value = 0.45, 0.5
    power = node(tree, "Math", Value=made, Value_001=3.0)
    power.operation = "POWER"
    return power.outputs[0]


def curves(tree, found):
    made = node(tree, "RGBCurve", Color=found)
    made.mapping.curves[0].points.new(0.4, 0.9)
    made.mapping.curves[3].points.new(0.5, 0.1)
    made.mapping.update()
    return made.outputs[0]


def hue(tree, found):
    return node(tree, "HueSaturation", Color=found, Hue=0.8, Saturation=1.5).outputs[0]


@pytest.mark.parametrize("is_float", [False, True])
def test_nodes_after_an_image_work_on_what_is_looked_up(is_float):
    fresh()
    image = generated(is_float)
    afters = (None, ramp, steep, curves, hue)
    interpolations = ("Linear", "Closest", "Cubic", "Smart")
    names = list(itertools.product(afters, interpolations, ("color", "alpha")))
    made = [
        look(image, use, after, interpolation=interpolation) for after, interpolation, use in names
    ]
    names = [(after.__name__ if after else "", kind, use) for after, kind, use in names]
    agree(made, names)


def test_what_lies_outside(tmp_path):
    fresh()
    image = stored(tmp_path, *FILES[0])
    names = list(itertools.product(("REPEAT", "EXTEND", "CLIP", "MIRROR"),
                                   ("Linear", "Closest", "Cubic"), ("color", "both")))  # fmt: skip
    made = [look(image, use, extension=e, interpolation=i) for e, i, use in names]
    agree(made, names)


def test_without_openimageio_blenders_own_pixels_are_taken(tmp_path, monkeypatch):
    """In Blenders of distributions; what they cannot tell is named."""
    fresh()
    monkeypatch.setattr(images, "openimageio", lambda: None)
    monkeypatch.setattr(images, "_to_scene_linear", lambda space: None)
    made, names = [], []
    for file, mode in itertools.product((FILES[0], FILES[1], FILES[10]), ("STRAIGHT", "NONE")):
        if file == FILES[10] and mode == "STRAIGHT":
            continue  # its alpha mode is that of no such file
        image = stored(tmp_path, *file)
        image.alpha_mode = mode
        for use in ("color", "both"):
            names.append((*file, mode, use))
            made.append(look(image, use))
    agree(made, names)
    image = stored(tmp_path, *FILES[0])
    image.colorspace_settings.name = "Filmic Log"
    _, sentences = ours(look(image))
    assert sentences == (f"Image '{image.name}' is taken for sRGB, it is Filmic Log",)


def test_a_file_that_is_no_image_is_pink_and_named(tmp_path):
    fresh()
    for name, content in (("text.png", b"no image"), ("empty.exr", b"")):
        (tmp_path / name).write_bytes(content)
        image = bpy.data.images.new(name, 4, 4)
        image.source, image.filepath = "FILE", str(tmp_path / name)
        looks, sentences = ours(look(image))
        assert (looks == (1, 0, 1)).all()
        assert sentences == (f"Image '{name}' cannot be read and is shown in pink",)
