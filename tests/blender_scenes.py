# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes of Blender's for the tests of the add-on."""

import bpy
import numpy as np

import addon

# Quick, and easy to reckon with: light that comes straight, each sample for its own pixel.
PLAIN = {"samples": 16, "noise_threshold": 0.0, "pixel_filter": "box", "diffuse_bounces": 0}


def fresh(settings=PLAIN):
    """An empty scene with LeapRay chosen, a black world and a camera on the z axis.

    settings: of LeapRay's, those that are not to be its defaults."""
    if not hasattr(bpy.types.Scene, "leapray"):
        addon.register()
    from addon.blender import engine

    engine.reports.clear()
    engine.failures.clear()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "LEAPRAY"
    for name, value in settings.items():
        setattr(scene.leapray, name, value)
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    scene.render.resolution_percentage = 100
    scene.world = bpy.data.worlds.new("World")
    nodes_of(scene.world).nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    scene.camera = put("Camera", bpy.data.cameras.new("Camera"), location=(0, 0, 10))
    return scene


def sunlit(size, eye=(0, 0, 6)):
    """A fresh scene of so many pixels in the light of a sun, its camera there."""
    made = fresh()
    made.render.resolution_x, made.render.resolution_y = size
    made.camera.location = eye
    put("Sun", light("SUN", energy=3.0), rotation_euler=(0.4, 0.3, 0.0))
    return made


def nodes_of(block):
    """The node tree of a material, light or world, in use in every version."""
    if bpy.app.version < (5, 0):
        block.use_nodes = True
    return block.node_tree


def put(name, data, **attributes):
    """A new object in the scene."""
    ob = bpy.data.objects.new(name, data)
    for key, value in attributes.items():
        setattr(ob, key, value)
    bpy.context.scene.collection.objects.link(ob)
    return ob


def mesh(name="Cube", size=2.0):
    """A cube of quads."""
    h = size / 2
    corners = [(x, y, z) for z in (-h, h) for y in (-h, h) for x in (-h, h)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return polygons(name, corners, faces)


def plane(name="Plane", size=2.0):
    h = size / 2
    return polygons(name, [(-h, -h, 0), (h, -h, 0), (h, h, 0), (-h, h, 0)], [(0, 1, 2, 3)])


def polygons(name, corners, faces):
    made = bpy.data.meshes.new(name)
    made.from_pydata(corners, [], faces)
    return made


def diffuse(name, color=(1, 1, 1)):
    """A material whose surface is one Diffuse BSDF."""
    made = bpy.data.materials.new(name)
    tree = nodes_of(made)
    tree.nodes.clear()
    bsdf = tree.nodes.new("ShaderNodeBsdfDiffuse")
    bsdf.inputs["Color"].default_value = (*color, 1)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    return made


def ramp_of(tree, attribute, socket="Fac", low=0.0, high=3.0):
    """A new colour ramp, which an attribute's values from low to high go through."""
    told, mapped, ramp = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("Attribute", "MapRange", "ValToRGB")
    )
    told.attribute_name = attribute
    mapped.inputs["From Min"].default_value, mapped.inputs["From Max"].default_value = low, high
    tree.links.new(told.outputs[socket], mapped.inputs["Value"])
    tree.links.new(mapped.outputs["Result"], ramp.inputs["Fac"])
    return ramp


def colored(name, attribute="density", socket="Fac", low=0.0, high=3.0, **settings):
    """A material that shines by a ramp from red at low to green at high of an attribute."""
    made = bpy.data.materials.new(name)
    tree = nodes_of(made)
    tree.nodes.clear()
    ramp = ramp_of(tree, attribute, socket, low, high)
    bsdf, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Emission", "OutputMaterial"))
    ramp.color_ramp.elements[0].color = (1, 0, 0, 1)
    ramp.color_ramp.elements[1].color = (0, 1, 0, 1)
    tree.links.new(ramp.outputs["Color"], bsdf.inputs["Color"])
    tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    return made


def light(kind, **attributes):
    made = bpy.data.lights.new(kind.capitalize(), kind)
    for key, value in attributes.items():
        setattr(made, key, value)
    return made


def read(width=64, height=48):
    """The scene as LeapRay reads it, at render visibility as far as Blender gives it here."""
    from addon.blender.read import scene

    return scene.read(bpy.context.evaluated_depsgraph_get(), width, height)


def exr(path):
    """All channels of an EXR as {"layer.pass.channel": (h, w) array}, rows from below."""
    bpy.utils.expose_bundled_modules()
    import OpenImageIO as oiio

    found = {}
    image = oiio.ImageInput.open(str(path))
    part = 0
    while image.seek_subimage(part, 0):
        spec = image.spec()
        pixels = image.read_image(part, 0, 0, spec.nchannels, oiio.FLOAT)
        for index, channel in enumerate(spec.channelnames):
            found[channel] = np.array(pixels)[::-1, :, index]
        part += 1
    image.close()
    return found


def combined(scene):
    """The Combined pass of what was rendered last, (h, w, 4), linear, rows from below."""
    import tempfile
    from pathlib import Path

    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGBA"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "combined.exr")
        bpy.data.images["Render Result"].save_render(str(path))
        image = bpy.data.images.load(str(path))
        pixels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
        image.pixels.foreach_get(pixels)
        pixels = pixels.reshape(image.size[1], image.size[0], 4)
        bpy.data.images.remove(image)
    return pixels


def cycles_radiance(scene):
    """Mean radiance of a white diffuse plane under the camera, by Cycles without bounces."""
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.max_bounces = 64, 0
    scene.cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 0.01
    bpy.ops.render.render()
    return combined(scene)[..., :3].mean(axis=(0, 1))
