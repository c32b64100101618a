# SPDX-License-Identifier: GPL-3.0-or-later
"""The only reader of the depsgraph: one frame of one view layer as plain arrays.

Everything is copied while it is read, so that nothing of Blender's is touched
once `read` returns. What LeapRay cannot draw is left out with one warning per
feature, and a bad object with one per reason; both name the objects.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from leapray import LeapRayError, Stopped
from leapray.rendering import VISIBILITIES

from ... import methods, model
from ...descriptions import WHOLE_MAX
from ...memory import Resident
from ...process import POLL
from ...settings import Isosurfaces
from .. import properties, result
from . import labels, lights, looks, materials, matrices, volumes
from .meshes import NO_FACES, read_mesh, read_object_mesh
from .warnings import Warnings

UNSUPPORTED_TYPES = {
    "CURVES": "Hair and curves objects are",
    "POINTCLOUD": "Point clouds are",
    "GREASEPENCIL": "Grease pencil is",
}


@dataclass(frozen=True)
class Border:
    """The part of the frame to render, in pixels from its lower left corner."""

    x: int
    y: int
    width: int
    height: int


def read(
    depsgraph,
    width: int,
    height: int,
    settings: model.Settings | None = None,
    camera=None,
    stop: Callable[[], bool] = lambda: False,
    progress: Callable[[float, str], None] = lambda share, what: None,
) -> model.Scene:
    """The scene as the depsgraph has evaluated it.

    width, height: of the whole frame in pixels, resolution percentage included; a
    render border is taken from the scene and makes the result smaller. settings:
    the scene's own where None. camera: an evaluated object, the scene's where None.
    progress(share 0..1, what): called while a file of data is read.
    Raises LeapRayError, one sentence, where there is nothing to render, Stopped soon
    after stop() said so.
    """
    start, resident = time.perf_counter(), Resident.read()
    scene = depsgraph.scene_eval
    if settings is None:
        settings = properties.settings(scene, depsgraph.view_layer_eval)
    if width < 1 or height < 1:
        raise LeapRayError(f"The resolution is {width} x {height} pixels; it needs at least 1 x 1")
    border = render_border(scene.render, width, height)
    notes = Warnings()
    film = _camera(camera or scene.camera, scene, width, height, border, notes)
    _note_scene(scene, notes)
    _note_passes(depsgraph.view_layer, notes)
    _note_libraries(notes)
    projected = bool(methods.find(settings.method).mode)
    objects = _Objects(depsgraph, notes, volumes.Caller(stop, progress), projected)
    shown = objects.instances or objects.field_instances
    if not shown and depsgraph.view_layer_eval.use_solid:
        _nothing_shown(depsgraph, notes)
    world = getattr(depsgraph.view_layer_eval, "world_override", None) or scene.world
    sky = world if depsgraph.view_layer_eval.use_sky else None
    return model.Scene(
        meshes=tuple(objects.meshes),
        instances=tuple(objects.instances),
        fields=tuple(objects.fields),
        field_instances=tuple(objects.field_instances),
        materials=tuple(objects.materials),
        lights=tuple(objects.lights),
        camera=film,
        world=lights.of_world(sky, notes),
        film_transparent=scene.render.film_transparent,
        width=border.width,
        height=border.height,
        settings=settings,
        passes=result.wanted(depsgraph.view_layer),
        mist=_mist(world),
        film_exposure=_exposure(scene),
        warnings=notes.sentences(),
        seconds_read=time.perf_counter() - start,
        resident=resident,
    )


# ---- camera --------------------------------------------------------------


def render_border(render, width: int, height: int) -> Border:
    """The render border in whole pixels, cut as Blender cuts it; the frame where there is none."""
    if not render.use_border:
        return Border(0, 0, width, height)
    frame = np.array([width, height, width, height], np.float32)
    edges = [
        render.border_min_x,
        render.border_min_y,
        render.border_max_x,
        render.border_max_y,
    ]
    x0, y0, x1, y1 = (np.array(edges, np.float32) * frame).astype(int).tolist()
    if x1 <= x0 or y1 <= y0:
        raise LeapRayError("The render border holds no pixel")
    return Border(x0, y0, x1 - x0, y1 - y0)


def _camera(camera, scene, width, height, border, notes) -> model.Camera:
    """Film rays of Blender's camera.

    Source: the view plane as Blender documents it: the sensor's fitted side spans
    the frame's, shifts count in fitted sides, pixels may be oblong.
    """
    if camera is None:
        raise LeapRayError(f"Scene '{scene.name}' has no camera")
    if camera.type != "CAMERA":
        raise LeapRayError(f"The active camera '{camera.name}' is not a camera object")
    data, render = camera.data, scene.render
    matrix = np.array(camera.matrix_world, np.float64)
    if not matrices.invertible(matrix):
        raise LeapRayError(f"The matrix of the camera '{camera.name}' cannot be inverted")
    right, up, back = (matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)).T

    if data.type not in ("PERSP", "ORTHO"):
        notes.unsupported("Panoramic and custom cameras are", camera.name)
    if data.dof.use_dof:
        notes.unsupported("Depth of field is", camera.name)

    oblong = render.pixel_aspect_y / render.pixel_aspect_x
    fit = data.sensor_fit
    if fit == "AUTO":
        wide = width * render.pixel_aspect_x >= height * render.pixel_aspect_y
        sensor, horizontal = data.sensor_width, wide
    else:
        horizontal = fit == "HORIZONTAL"
        sensor = data.sensor_width if horizontal else data.sensor_height
    fitted = width if horizontal else height * oblong
    orthographic = data.type == "ORTHO"
    pixel = (data.ortho_scale if orthographic else sensor / data.lens) / fitted

    dx, dy = right * pixel, up * (pixel * oblong)
    left = data.shift_x * fitted - width / 2 + border.x
    below = data.shift_y * fitted / oblong - height / 2 + border.y
    corner = dx * left + dy * below
    return model.Camera(
        projection="orthographic" if orthographic else "perspective",
        eye=matrix[:3, 3].copy(),
        forward=-back,
        corner=corner if orthographic else corner - back,
        dx=dx,
        dy=dy,
        clip_start=data.clip_start,
        clip_end=data.clip_end,
    )


def _mist(world) -> tuple[float, float, str]:
    """Start, depth and falloff of the Mist pass."""
    if world is None:
        return 5.0, 25.0, "QUADRATIC"  # what a new world has
    mist = world.mist_settings
    return mist.start, mist.depth, mist.falloff


def _exposure(scene) -> float:
    """Cycles' exposure of the film, where Blender has Cycles: the panel shows it, too."""
    return getattr(getattr(scene, "cycles", None), "film_exposure", 1.0)


# ---- objects -------------------------------------------------------------


class _Objects:
    """Walks the depsgraph's instances once: meshes, their places, materials, lights."""

    def __init__(self, depsgraph, notes: Warnings, caller: volumes.Caller, projected: bool) -> None:
        self.notes, self._caller, self._projected = notes, caller, projected
        self.meshes: list[model.Mesh] = []
        self.instances: list[model.Instance] = []
        self.fields: list[model.Field] = []
        self.field_instances: list[model.FieldInstance] = []
        self.materials: list[model.Material] = []
        self.lights: list[model.Light] = []
        self._images: dict = {}
        self._textures: list[materials.Texture | None] = []  # of the materials
        self._mesh_at: dict[tuple, int | str] = {}  # index, or what is wrong with it
        self._field_at: dict[tuple, int | str | None] = {}
        self._material_at: dict[str, int] = {}
        self._surface_at: dict[int, int] = {}  # for volumes, of materials that have no surface
        self._tinted_at: dict[tuple[int, int], int] = {}  # first of a field's, by its material
        self._other_at: dict[tuple, model.OtherGrid] = {}
        self._split_at: dict[tuple, int] = {}  # fields of labels, by their solids
        self._depsgraph = depsgraph
        self._view_layer = depsgraph.view_layer_eval
        self._override = self._view_layer.material_override
        self._instancers: set[str] = set()
        asked = time.monotonic()
        for instance in depsgraph.object_instances:
            if time.monotonic() - asked > POLL:
                if caller.stop():
                    raise Stopped("The reading was stopped")
                asked = time.monotonic()
            self._take(instance)
        for name in self._instancers:  # whose geometry is that of others
            notes.forget(NO_FACES, name)

    def _take(self, instance) -> None:
        """One instance of the depsgraph, which is only valid during this call."""
        ob = instance.object
        if instance.is_instance:
            self._instancers.add(instance.parent.name)
        if instance.show_particles and _has_hair(ob):
            self.notes.unsupported("Hair particles are", ob.name)
        if not instance.show_self:
            return
        if ob.type == "MESH":
            if self._view_layer.use_solid:
                self._take_mesh(instance, ob)
        elif ob.type == "VOLUME":
            if self._view_layer.use_volumes:
                self._take_volume(instance, ob)
        elif ob.type == "LIGHT":
            self._take_light(instance, ob)
        elif ob.type in UNSUPPORTED_TYPES:
            self.notes.unsupported(UNSUPPORTED_TYPES[ob.type], ob.name)

    def _take_mesh(self, instance, ob) -> None:
        placed = self._placed(instance, ob)
        if not placed:
            return
        slots = self._slots(ob)
        if _is_smoke(ob) and any(self.materials[at].fills for at in slots):
            self.notes.unsupported("Smoke and fire of fluid domains are", ob.name)
            return
        if placed["holdout"] and any(self.materials[at].bare for at in slots):
            self.notes.unsupported("Holdout of volumes without a surface is", ob.name)
        # Of instances `ob` is a passing copy: properties made on it by being read would leak.
        lasting = instance.instance_object if instance.is_instance else ob
        mesh = self._mesh(ob, slots, properties.modelling(lasting or ob.original))
        if isinstance(mesh, str):
            self.notes.skipped(mesh, ob.name)
            return
        self._note_unread(instance, ob)
        self.instances.append(model.Instance(mesh=mesh, materials=slots, **placed))

    def _take_volume(self, instance, ob) -> None:
        placed = self._placed(instance, ob)
        if not placed:
            return
        lasting = (instance.instance_object if instance.is_instance else ob) or ob
        original = lasting.original.data
        found = self._field(ob, original)
        if isinstance(found, str):
            self.notes.skipped(found, ob.name)
            return
        if found is None:
            return
        self._note_unread(instance, ob)
        if self.fields[found].look is not None:
            if placed["holdout"]:
                self.notes.unsupported("Holdout of volumes without a surface is", ob.name)
                placed["holdout"] = False
            bare = (self._material(None),)
            self.field_instances.append(model.FieldInstance(field=found, materials=bare, **placed))
            return
        slots = self._volume_slots(ob, lasting.original)
        worn = tuple(self._on_surface(at) for at in slots)
        told: dict[str, Any] = {"field": found, "materials": worn}
        if self.fields[found].labels is None:
            told["colors"] = self._field_colors(ob, original, slots, self.fields[found])
        else:
            if any(self._textures[at] for at in slots):
                self.notes.unsupported("Textures on labels are", ob.name)
            told = self._labels(found, worn, volumes.wanted(original, self._depsgraph))
        self.field_instances.append(model.FieldInstance(**told, **placed))

    def _labels(self, found: int, worn: tuple[int, ...], own: Isosurfaces) -> dict[str, Any]:
        """What is told of a field of labels that wears materials: a slot for each label."""
        field = self.fields[found]
        assert field.labels is not None
        numbers = field.labels.numbers
        if len(worn) == 1 and own.label_colors and not self._override:
            key = found, worn[0]
            if key not in self._tinted_at:
                self._tinted_at[key] = len(self.materials)
                made = labels.materials(self.materials[worn[0]], field.grid, numbers)
                self.materials += made
                self._textures += [None] * len(made)
            first = self._tinted_at[key]
            slots = tuple(range(first, first + len(numbers)))
        else:
            slots = tuple(worn[min(n, len(worn) - 1)] for n in range(len(numbers)))
        bodies = labels.bodies(slots, self.materials)
        if field.labels.bodies != bodies:
            found = self._split_at.setdefault((found, bodies), len(self.fields))
            if found == len(self.fields):
                split = model.Labels(numbers, bodies)
                self.fields.append(replace(field, labels=split))
        indices = tuple(min(n, WHOLE_MAX) for n in numbers) if own.label_index else ()
        return {"field": found, "materials": slots, "slot_objects": indices}

    def _placed(self, instance, ob) -> dict[str, Any]:
        """What model.Placed holds beside materials; nothing where no ray sees the instance."""
        seen = {
            flag: all(getattr(each, flag) for each in _shown(instance, ob)) for flag in VISIBILITIES
        }
        holdout, indirect_only = self._layer_flags(instance, ob)
        seen["visible_camera"] = seen["visible_camera"] and not indirect_only
        if not any(seen.values()):
            return {}
        world_from_object = matrices.affine(instance.matrix_world)
        if not matrices.invertible(world_from_object):
            self.notes.skipped("its matrix cannot be inverted (a scale of zero?)", ob.name)
            return {}
        told = {"name": ob.name, "object_index": ob.pass_index, "holdout": holdout}
        return {"world_from_object": world_from_object, **told, **seen}

    def _layer_flags(self, instance, ob) -> tuple[bool, bool]:
        """Holdout and indirect-only, of the object and its collections; an instancer's count for
        what it instances, whose own do not, as in Cycles."""
        owner = instance.parent if instance.is_instance else ob
        holdout = owner.holdout_get(view_layer=self._view_layer)
        return holdout, not holdout and owner.indirect_only_get(view_layer=self._view_layer)

    def _note_unread(self, instance, ob) -> None:
        self._note_linking(instance, ob)
        if any(each.is_shadow_catcher for each in _shown(instance, ob)):
            self.notes.unsupported("Shadow catchers are", ob.name)

    def _note_linking(self, instance, ob) -> None:
        for each in _shown(instance, ob):
            if each.light_linking.receiver_collection:
                self.notes.unsupported("Light linking is", ob.name)
            if each.light_linking.blocker_collection:
                self.notes.unsupported("Shadow linking is", ob.name)

    def _mesh(self, ob, slots: tuple[int, ...], own: model.Modelling) -> int | str:
        """The index of the object's mesh as its materials want it, or what is wrong with it."""
        textures = tuple(self._textures[at] for at in slots)
        wanted = tuple(at if self._textures[at] else -1 for at in slots)
        key = ob.data.as_pointer(), wanted if any(textures) else (), own
        if key not in self._mesh_at:
            edited = ob.mode == "EDIT"  # then ob.data may be a wrapper without arrays
            try:
                if edited:
                    mesh = read_object_mesh(ob, textures, self.notes)
                else:
                    mesh = read_mesh(ob.data, ob.data.name, textures, self.notes)
            except LeapRayError as error:
                self._mesh_at[key] = str(error)
            else:
                self._mesh_at[key] = len(self.meshes)
                self.meshes.append(replace(mesh, modelling=own))
        return self._mesh_at[key]

    def _field(self, ob, original) -> int | str | None:
        """The index of the field of a volume object, what is wrong with it, or nothing to see.

        original: the datablock that its object has in the file, a volume or what nodes made
        the volume of.
        """
        in_object = original.id_type == "VOLUME"
        slots = [s.material for s in ob.material_slots] if in_object else ob.data.materials
        worn = self._override or (slots[0] if len(slots) else None)
        shown = volumes.wanted(original, self._depsgraph).shown
        if not looks.is_shown(shown, worn):
            worn = None
        key = ob.data.as_pointer(), original.as_pointer(), worn and worn.as_pointer()
        if key not in self._field_at:
            try:
                field = volumes.read_field(
                    ob, original, worn, self._depsgraph, self.notes, self._caller, self._projected
                )
            except Stopped:
                raise
            except LeapRayError as error:
                self._field_at[key] = str(error)
            else:
                self._field_at[key] = None if field is None else len(self.fields)
                self.fields += [] if field is None else [field]
        return self._field_at[key]

    def _volume_slots(self, ob, original) -> tuple[int, ...]:
        """The materials of a volume's surfaces."""
        if original.type == "VOLUME" or self._override:
            return self._slots(ob)
        # nodes gave the volume its own
        return tuple(map(self._material, ob.data.materials)) or (self._material(None),)

    def _field_colors(
        self, ob, original, slots: tuple[int, ...], field: model.Field
    ) -> tuple[model.FieldColor | None, ...]:
        """What the materials make of the field's values, or of another grid's; other textures are
        noted."""
        made: list[model.FieldColor | None] = []
        for at in slots:
            texture, color = self._textures[at], None
            if texture:
                color = volumes.field_color(texture, field)
            if texture and color is None:
                color = self._other_color(ob, original, texture, self.materials[at].name)
            made.append(color)
        return tuple(made)

    def _other_color(
        self, ob, original, texture: materials.Texture, name: str
    ) -> model.FieldColor | None:
        """The colours that a material of that name takes from another grid of the object."""
        if texture.program is None or not texture.layer:
            self.notes.unsupported("Textures on surfaces of volumes are", ob.name)
            return None
        key = ob.data.as_pointer(), original.as_pointer(), texture.layer
        try:
            if key not in self._other_at:
                self._other_at[key] = volumes.other_grid(
                    ob, original, self._depsgraph, texture.layer, self._caller
                )
            return model.FieldColor(texture.program, other=self._other_at[key])
        except Stopped:
            raise
        except LeapRayError as error:
            what = (
                f"asks for the attribute '{texture.layer}' of '{ob.name}', which is no grid of it"
            )
            self.notes.missing("Material", name, f"{what}: {error}")
            return None

    def _on_surface(self, at: int) -> int:
        """The material with that index; with the default surface, if it is one of volumes alone."""
        made = self.materials[at]
        if not made.bare:
            return at
        if at not in self._surface_at:
            self._surface_at[at] = len(self.materials)
            self.materials.append(materials.plain(made.name, materials.GREY, made.index))
            self._textures.append(None)
        return self._surface_at[at]

    def _slots(self, ob) -> tuple[int, ...]:
        """The materials of the object's slots, those linked to the object included."""
        if self._override:
            return (self._material(self._override),)
        return tuple(self._material(slot.material) for slot in ob.material_slots) or (
            self._material(None),
        )

    def _material(self, material) -> int:
        name = material.name_full if material else ""
        if name not in self._material_at:
            self._material_at[name] = len(self.materials)
            read, texture = materials.read(material, self.notes, self._images)
            self.materials.append(read)
            self._textures.append(texture)
        return self._material_at[name]

    def _take_light(self, instance, ob) -> None:
        matrix = np.array(instance.matrix_world, np.float64)
        if not np.isfinite(matrix).all() or not np.any(matrix[:3, 2]):
            self.notes.skipped("its matrix cannot be inverted (a scale of zero?)", ob.name)
            return
        self._note_linking(instance, ob)
        light = lights.of_light(ob.data, matrix, _shown(instance, ob), ob.name, self.notes)
        if light is not None:
            seen = light.visible_camera and not self._layer_flags(instance, ob)[1]
            self.lights.append(replace(light, visible_camera=seen))


def _shown(instance, ob) -> list:
    """The objects that must all be visible for the instance to be."""
    return [ob, instance.parent] if instance.is_instance else [ob]


def _has_hair(ob) -> bool:
    return any(
        modifier.type == "PARTICLE_SYSTEM"
        and modifier.show_render
        and modifier.particle_system.settings.type == "HAIR"
        and modifier.particle_system.settings.render_type == "PATH"
        for modifier in ob.modifiers
    )


def _is_smoke(ob) -> bool:
    """Whether its volume is a simulation's, and not all that its mesh holds."""
    return any(
        modifier.type == "FLUID"
        and modifier.fluid_type == "DOMAIN"
        and modifier.domain_settings.domain_type == "GAS"
        and modifier.show_render
        for modifier in ob.modifiers
    )


def _nothing_shown(depsgraph, notes: Warnings) -> None:
    """Raise LeapRayError, or where other view layers may show something, note the layer."""
    scene, layer = depsgraph.scene, depsgraph.view_layer
    others = [each for each in scene.view_layers if each.use and each.name != layer.name]
    if others and not scene.render.use_single_layer:
        notes.missing("View layer", layer.name, "shows nothing that can be rendered")
        return
    why = "".join(f"; {sentence}" for sentence in notes.sentences())
    raise LeapRayError(f"Scene '{scene.name}' shows nothing that can be rendered{why}")


# ---- warnings ------------------------------------------------------------


def _note_scene(scene, notes: Warnings) -> None:
    if scene.render.use_motion_blur:
        notes.unsupported("Motion blur is", scene.name)
    if scene.render.use_multiview:
        notes.unsupported("Stereoscopy is", scene.name)
    film = getattr(scene, "cycles", None)
    if scene.render.film_transparent and getattr(film, "film_transparent_glass", False):
        notes.unsupported("Transparent glass before a transparent film is", scene.name)


def _note_passes(view_layer, notes: Warnings) -> None:
    asked = result.not_made(view_layer)
    if asked:
        what = f"asks for passes that LeapRay does not make: {', '.join(asked)}"
        notes.missing("View layer", view_layer.name, what)


def _note_libraries(notes: Warnings) -> None:
    """Libraries that are gone leave empty objects behind, which nobody would miss."""
    import bpy

    for library in bpy.data.libraries:
        lost = [each.name for each in library.users_id if getattr(each, "is_missing", False)]
        if lost:
            names = ", ".join(f"'{name}'" for name in lost[: notes.SHOWN])
            notes.missing("Library", library.filepath, f"is missing, or lacks {names}")
