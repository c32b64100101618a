# SPDX-License-Identifier: GPL-3.0-or-later
"""One scene of Blender's by either engine, for tests that hold LeapRay against Cycles."""

import tempfile
from pathlib import Path

import bpy
import numpy as np
from blender_scenes import exr, fresh

PASSES = {
    "Combined": ("Combined", "RGBA"),
    "Depth": ("Depth", "Z"),
    "Object Index": ("IndexOB" if bpy.app.version < (5, 0) else "Object Index", "X"),
    "Emission": ("Emit" if bpy.app.version < (5, 0) else "Emission", "RGB"),
    "Environment": ("Env" if bpy.app.version < (5, 0) else "Environment", "RGB"),
}


def bare(width=24, height=24):
    """A scene without light or things, in which both engines take the same samples and paths."""
    scene = fresh()
    scene.render.resolution_x, scene.render.resolution_y = width, height
    cycles = scene.cycles
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.pixel_filter_type, cycles.blur_glossy = "BOX", 0.0
    cycles.sample_clamp_indirect = scene.leapray.clamp_indirect = 0.0
    scene.leapray.pixel_filter, scene.leapray.noise_threshold = "box", 0.0
    for layer in scene.view_layers:
        layer.use_pass_z = layer.use_pass_object_index = True
        layer.use_pass_emit = layer.use_pass_environment = True
    return scene


def render(scene, engine, samples=16, bounces=0, layer="ViewLayer"):
    """The passes {name: (h, w, n) float64, rows from below} of a view layer."""
    scene.render.engine = engine
    scene.cycles.samples = scene.leapray.samples = samples
    scene.cycles.diffuse_bounces = scene.leapray.diffuse_bounces = bounces
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder, "picture.exr"))
        bpy.ops.render.render(write_still=True)
        found = exr(scene.render.filepath)
    return {
        name: np.stack([found[f"{layer}.{theirs}.{c}"] for c in channels], -1).astype(float)
        for name, (theirs, channels) in PASSES.items()
        if f"{layer}.{theirs}.{channels[0]}" in found
    }


def both(scene, samples=16, bounces=0):
    """What Cycles and what LeapRay make of it."""
    return tuple(render(scene, engine, samples, bounces) for engine in ("CYCLES", "LEAPRAY"))


def warnings():
    """What LeapRay said about its last render."""
    from addon.blender import engine

    return [sentence for report in engine.reports.values() for sentence in report["warnings"]]


def blocks(picture, side=8):
    """The means of blocks of side x side pixels."""
    h, w = picture.shape[:2]
    cut = picture[: h // side * side, : w // side * side]
    return cut.reshape(h // side, side, w // side, side, -1).mean(axis=(1, 3))
