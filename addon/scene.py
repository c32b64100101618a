# SPDX-License-Identifier: GPL-3.0-or-later
"""The only reader of the depsgraph: one frame of one view layer as plain arrays.

Everything is copied while it is read, so that nothing of Blender's is touched
once `read` returns. What LeapRay cannot draw is left out with one warning per
feature, and a bad object with one per reason; both name the objects.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from leapray import LeapRayError

from . import colors, model

# A 4x4 of float32 whose axes lie in a plane still shows this much thickness.
FLAT = 4 * np.finfo(np.float32).eps

NO_FACES = "its mesh has no faces"

UNSUPPORTED_TYPES = {
    "CURVES": "Hair and curves objects are",
    "POINTCLOUD": "Point clouds are",
    "VOLUME": "Volumes are",
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
) -> model.Scene:
    """The scene as the depsgraph has evaluated it.

    width, height: of the whole frame in pixels, resolution percentage included; a
    render border is taken from the scene and makes the result smaller. settings:
    the scene's own where None. camera: an evaluated object, the scene's where None.
    Raises LeapRayError, one sentence, where there is nothing to render.
    """
    start = time.perf_counter()
    scene = depsgraph.scene_eval
    if settings is None:
        from . import properties

        settings = properties.settings(scene)
    if width < 1 or height < 1:
        raise LeapRayError(f"The resolution is {width} x {height} pixels; it needs at least 1 x 1")
    border = render_border(scene.render, width, height)
    notes = _Notes()
    film = _camera(camera or scene.camera, scene, width, height, border, notes)
    _note_scene(scene, notes)
    objects = _Objects(depsgraph, notes)
    world = getattr(depsgraph.view_layer_eval, "world_override", None) or scene.world
    return model.Scene(
        meshes=tuple(objects.meshes),
        instances=tuple(objects.instances),
        materials=tuple(objects.materials),
        lights=tuple(objects.lights),
        camera=film,
        world=model.World(colors.of_world(world, notes)),
        film_transparent=scene.render.film_transparent,
        width=border.width,
        height=border.height,
        settings=settings,
        warnings=notes.sentences(),
        seconds_read=time.perf_counter() - start,
    )


# ---- camera --------------------------------------------------------------


def render_border(render, width: int, height: int) -> Border:
    """The render border in whole pixels, cut as Blender cuts it; the frame where there is none."""
    if not render.use_border:
        return Border(0, 0, width, height)
    frame = np.float32([width, height, width, height])
    edges = [
        render.border_min_x,
        render.border_min_y,
        render.border_max_x,
        render.border_max_y,
    ]
    x0, y0, x1, y1 = (np.float32(edges) * frame).astype(int).tolist()
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
    if not _invertible(matrix):
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


# ---- objects -------------------------------------------------------------


class _Objects:
    """Walks the depsgraph's instances once: meshes, their places, materials, lights."""

    def __init__(self, depsgraph, notes: _Notes) -> None:
        self.notes = notes
        self.meshes: list[model.Mesh] = []
        self.instances: list[model.Instance] = []
        self.materials: list[model.Material] = []
        self.lights: list[model.Light] = []
        self._mesh_at: dict[int, int | str] = {}  # by address: index, or what is wrong with it
        self._material_at: dict[str, int] = {}
        self._override = depsgraph.view_layer_eval.material_override
        self._instancers: set[str] = set()
        for instance in depsgraph.object_instances:
            self._take(instance)
        for name in self._instancers:  # whose geometry is that of others
            notes.forget(NO_FACES, name)
        if not self.instances:
            scene = depsgraph.scene_eval.name
            why = "".join(f"; {sentence}" for sentence in notes.sentences())
            raise LeapRayError(f"Scene '{scene}' shows no mesh that can be rendered{why}")

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
            self._take_mesh(instance, ob)
        elif ob.type == "LIGHT":
            self._take_light(instance, ob)
        elif ob.type in UNSUPPORTED_TYPES:
            self.notes.unsupported(UNSUPPORTED_TYPES[ob.type], ob.name)

    def _take_mesh(self, instance, ob) -> None:
        shown = [ob] if not instance.is_instance else [ob, instance.parent]
        camera, shadow, diffuse = (
            all(getattr(each, flag) for each in shown)
            for flag in ("visible_camera", "visible_shadow", "visible_diffuse")
        )
        if not (camera or shadow or diffuse):
            return
        world_from_object = np.array(instance.matrix_world, np.float64)
        if not _invertible(world_from_object):
            self.notes.skipped("its matrix cannot be inverted (a scale of zero?)", ob.name)
            return
        mesh = self._mesh(ob)
        if isinstance(mesh, str):
            self.notes.skipped(mesh, ob.name)
            return
        if ob.is_holdout:
            self.notes.unsupported("Holdout is", ob.name)
        if ob.is_shadow_catcher:
            self.notes.unsupported("Shadow catchers are", ob.name)
        self.instances.append(
            model.Instance(
                name=ob.name,
                mesh=mesh,
                world_from_object=world_from_object,
                materials=self._slots(ob),
                object_index=ob.pass_index,
                visible_camera=camera,
                visible_shadow=shadow,
                visible_diffuse=diffuse,
            )
        )

    def _mesh(self, ob) -> int | str:
        """The index of the object's mesh, or what is wrong with it."""
        key = ob.data.as_pointer()
        if key not in self._mesh_at:
            edited = ob.mode == "EDIT"  # then ob.data may be a wrapper without arrays
            try:
                mesh = read_object_mesh(ob) if edited else read_mesh(ob.data, ob.data.name)
            except LeapRayError as error:
                self._mesh_at[key] = str(error)
            else:
                self._mesh_at[key] = len(self.meshes)
                self.meshes.append(mesh)
        return self._mesh_at[key]

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
            self.materials.append(colors.of_material(material, self.notes))
        return self._material_at[name]

    def _take_light(self, instance, ob) -> None:
        light, matrix = ob.data, np.array(instance.matrix_world, np.float64)
        if light.type not in ("SUN", "POINT"):
            self.notes.unsupported(f"{light.type.capitalize()} lights are", ob.name)
            return
        if not np.isfinite(matrix).all() or not np.any(matrix[:3, 2]):
            self.notes.skipped("its matrix cannot be inverted (a scale of zero?)", ob.name)
            return
        color = colors.of_light(light, self.notes, ob.name)
        if not ob.visible_diffuse or not np.any(color):
            return
        self.lights.append(
            model.Light(
                name=ob.name,
                kind="sun" if light.type == "SUN" else "point",
                color=tuple(color.tolist()),
                position=tuple(matrix[:3, 3].tolist()),
                direction=tuple((matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])).tolist()),
                casts_shadow=light.use_shadow,
            )
        )


def read_object_mesh(ob) -> model.Mesh:
    """A copy of the mesh that an evaluated object of any type has. Raises as read_mesh does."""
    try:
        mesh = ob.to_mesh()
    except RuntimeError:  # a light, an empty, ...
        raise LeapRayError(NO_FACES) from None
    try:
        return read_mesh(mesh, ob.data.name)
    finally:
        ob.to_mesh_clear()


def read_mesh(mesh, name: str) -> model.Mesh:
    """A copy of Blender's mesh. Raises LeapRayError with the reason that makes it useless."""
    n_corners, n_faces = len(mesh.loops), len(mesh.polygons)
    if not n_faces:
        raise LeapRayError(NO_FACES)
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    if not np.isfinite(vertices).all():
        raise LeapRayError("its mesh has vertices that are no numbers (NaN or infinite)")

    if n_corners == 3 * n_faces:  # no face has fewer, so all are triangles
        triangles = np.empty((n_faces, 3), np.int32)
        mesh.loops.foreach_get("vertex_index", triangles.ravel())
    else:
        mesh.calc_loop_triangles()
        triangles = np.empty((len(mesh.loop_triangles), 3), np.int32)
        mesh.loop_triangles.foreach_get("vertices", triangles.ravel())

    slots = None
    indices = mesh.attributes.get("material_index")
    if indices is not None and indices.domain == "FACE" and indices.data_type == "INT":
        of_face = np.empty(n_faces, np.int32)
        indices.data.foreach_get("value", of_face)
        if of_face.any():
            slots = of_face.clip(0, np.iinfo(np.uint16).max).astype(np.uint16)
            if n_corners != 3 * n_faces:
                face_of = np.empty(len(triangles), np.int32)
                mesh.loop_triangle_polygons.foreach_get("value", face_of)
                slots = slots[face_of]
    return model.Mesh(name, vertices, triangles, slots)


def _invertible(matrix: NDArray[np.float64]) -> bool:
    """Whether a matrix that Blender holds in float32 has three axes that span space."""
    if not np.isfinite(matrix).all():
        return False
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not lengths.all():
        return False
    return bool(np.linalg.svd(matrix[:3, :3] / lengths, compute_uv=False)[-1] > FLAT)


def _has_hair(ob) -> bool:
    return any(
        modifier.type == "PARTICLE_SYSTEM"
        and modifier.show_render
        and modifier.particle_system.settings.type == "HAIR"
        and modifier.particle_system.settings.render_type == "PATH"
        for modifier in ob.modifiers
    )


# ---- warnings ------------------------------------------------------------


def _note_scene(scene, notes: _Notes) -> None:
    if scene.render.use_motion_blur:
        notes.unsupported("Motion blur is", scene.name)
    if scene.render.use_multiview:
        notes.unsupported("Stereoscopy is", scene.name)


class _Notes:
    """What was left out, gathered by reason, each reason with the names it touches."""

    SHOWN = 5  # names in one sentence

    def __init__(self) -> None:
        self._names: dict[str, dict[str, None]] = {}

    def unsupported(self, feature: str, name: str) -> None:
        self._add(f"{feature} not supported yet: {{}}", name)

    def skipped(self, reason: str, name: str) -> None:
        self._add(self._skipped(reason), name)

    def replaced(self, what: str, name: str) -> None:
        self._add(f"Shader nodes are not followed, the {what} stands in: {{}}", name)

    def forget(self, reason: str, name: str) -> None:
        """Take back what `skipped` was told."""
        self._names.get(self._skipped(reason), {}).pop(name, None)

    @staticmethod
    def _skipped(reason: str) -> str:
        return f"Skipped {{}}: {reason}"

    def _add(self, sentence: str, name: str) -> None:
        self._names.setdefault(sentence, {})[name] = None

    def sentences(self) -> tuple[str, ...]:
        found = []
        for sentence, names in self._names.items():
            if not names:
                continue
            shown = ", ".join(f"'{name}'" for name in list(names)[: self.SHOWN])
            more = len(names) - self.SHOWN
            found.append(sentence.format(shown + (f" and {more} more" if more > 0 else "")))
        return tuple(found)
