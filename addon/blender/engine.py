# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine: Blender calls it, and it hands on."""

from __future__ import annotations

import threading
from dataclasses import replace
from functools import partial

import bpy

import leapray

from .. import methods, pipeline
from ..plan import fields, other_grids
from ..plan.levels import MB
from ..store.memory_cache import Cache
from . import properties, result
from .read import scene, volumes

# How the last render of each view layer went: what the JSON file holds, or why there is none.
reports: dict[str, dict] = {}
failures: dict[str, leapray.LeapRayError] = {}  # without tracebacks, which hold on to memory
interrupt = threading.Event()  # set from outside to end the render, as Esc does
pixel: tuple[int, int] | None = None  # set from outside to render and record this one alone
NO_VIEWPORT = "LeapRay does not render in the viewport yet: press F12, or use Material Preview"
_volumes = Cache()  # kept between frames and renders, within the memory budget


class LeapRayEngine(bpy.types.RenderEngine):
    """Renders a scene's meshes as volumes."""

    bl_idname = "LEAPRAY"
    bl_label = "LeapRay"
    bl_use_preview = True
    bl_use_shading_nodes_custom = False  # Blender's own shader nodes
    bl_use_eevee_viewport = True  # for the viewport's material preview

    def update_render_passes(self, scene=None, renderlayer=None) -> None:
        result.register_passes(self, scene, renderlayer)

    def render(self, depsgraph) -> None:
        """The one place where errors become reports: Blender swallows what is raised here."""
        layer = depsgraph.view_layer_eval.name
        reports.pop(layer, None)
        failures.pop(layer, None)
        try:
            self._render(depsgraph, layer)
        except leapray.Stopped:
            failures[layer] = leapray.Stopped("The render was cancelled")
        except KeyboardInterrupt:
            failures[layer] = leapray.Stopped("The render was interrupted")
            self.report({"ERROR"}, "The render was interrupted")
        except leapray.LeapRayError as error:
            failures[layer] = leapray.LeapRayError(str(error))
            self.report({"ERROR"}, str(error))
        except BaseException as error:
            sentence = f"LeapRay broke off by a fault of its own: {type(error).__name__}: {error}"
            failures[layer] = leapray.LeapRayError(sentence)
            self.report({"ERROR"}, sentence)
            raise

    def view_update(self, context, depsgraph) -> None:
        """Blender asks for a picture in the viewport."""
        self.update_stats("", NO_VIEWPORT)

    def view_draw(self, context, depsgraph) -> None:
        """There is none to draw; Blender shows the sentence in the viewport's corner."""

    def _render(self, depsgraph, layer: str) -> None:
        status = f"{depsgraph.scene_eval.name}, {layer} | "
        self.update_stats("", status + "Reading")

        def reading(share: float, what: str) -> None:
            self.update_stats("", f"{status}Reading {what}, {share:.0%}")

        job = scene.read(
            depsgraph,
            self.resolution_x,
            self.resolution_y,
            settings=self._settings(depsgraph),
            camera=self.camera_override,
            stop=self._asked_to_stop,
            progress=reading,
        )
        volumes.kept.trim(job.settings.memory_mb * MB)

        def progress(share: float, phase: str) -> None:
            self.update_progress(share)
            self.update_stats("", f"{status}{phase}, {share:.0%}")

        self._keep(depsgraph.scene_eval)
        done = False
        try:
            frame = pipeline.render(
                job,
                stop=self._asked_to_stop,
                progress=progress,
                on_tile=partial(result.write_tile, self, layer),
                cache=None if self.is_preview else _volumes,
                pixel=self._pixel(depsgraph.scene_eval.render),
            )
            done = True
        finally:
            self._keep(depsgraph.scene_eval, used=done)
        if self.is_preview:
            return
        reports[layer] = frame.report
        used, peak = (
            sum(frame.report["bytes"][name] for name in names) / 1e6
            for names in (("volumes", "structures"), ("peak",))
        )
        self.update_memory_stats(memory_used=used, memory_peak=peak)
        for warning in frame.warnings:
            self.report({"WARNING"}, warning)

    def _asked_to_stop(self) -> bool:
        return interrupt.is_set() or self.test_break()

    def _settings(self, depsgraph):
        """The scene's settings; those of a material's preview are Blender's, so small ones."""
        chosen = properties.settings(depsgraph.scene_eval, depsgraph.view_layer_eval)
        if self.is_preview:
            chosen = replace(chosen, method=methods.RAYS.spec)
            return replace(chosen, samples=4, pixel_error=1.0, memory_mb=128, cache_folder="")
        return chosen

    def _pixel(self, render) -> tuple[int, int] | None:
        """The one that is asked for, in the part of the picture that is rendered."""
        if pixel is None or not render.use_border or render.use_crop_to_border:
            return pixel
        width, height = self.resolution_x, self.resolution_y
        pipeline.check_pixel(pixel, width, height)
        border = scene.render_border(render, width, height)
        x, y = pixel[0] - border.x, pixel[1] - border.y
        if not (0 <= x < border.width and 0 <= y < border.height):
            raise leapray.LeapRayError(
                f"Pixel {pixel[0]},{pixel[1]} lies outside the render region, which holds "
                f"{border.x},{border.y} to {border.x + border.width - 1},"
                f"{border.y + border.height - 1}"
            )
        return x, y

    def _keep(self, evaluated_scene, used: bool = False) -> None:
        """Keep volumes where the scene asks for it, or its render method gains by the frame before;
        else of fields alone the samples, so that a threshold can move without reading them again.
        used: those of the last frame."""
        method = methods.find(evaluated_scene.leapray.method)
        asked = evaluated_scene.render.use_persistent_data
        if not (self.is_preview or asked or (method.image and method.image.frames)):
            _volumes.keep(fields.SAMPLES, other_grids.SAMPLES, used=used)


def register() -> None:
    bpy.utils.register_class(LeapRayEngine)


def unregister() -> None:
    _volumes.clear()
    bpy.utils.unregister_class(LeapRayEngine)
