# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole images at once: methods of the survey that do not trace rays one by one."""

from __future__ import annotations

import ctypes
import weakref
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import _abi
from ._lib import LeapRayError, Watch, call, check, lib
from .arrays import empty, numbers, pointer
from .options import Entry, all_choices, choice_numbers, find, read_entry
from .rendering import camera_struct
from .scene_parts import Camera, Light
from .threads import check_threads, cores, run_parts
from .tracing import add_counters
from .volume import Volume


@dataclass(frozen=True)
class ImageMethod(Entry):
    """A line of the core's registry of whole-image methods, with its options chosen.

    exact: cells and depths are those of `trace` with mode="binary".
    """

    perspective: bool = False  # takes perspective cameras, too
    surfaces: bool = False  # shows first object cells
    lights: bool = False  # shades by lights and gives normals; others shade by depth
    frames: bool = False  # is faster with the frame before


def image_methods() -> list[ImageMethod]:
    """All whole-image methods that the core has, in its order, with their default options.

    Raises LeapRayError only where core and package do not belong together.
    """
    found = []
    for index in range(lib.lr_image_method_count()):
        line, error = _abi.lr_image_method(), _abi.lr_error()
        check(lib.lr_image_method_get(index, ctypes.byref(line), ctypes.byref(error)), error)
        flags = {
            "exact": bool(line.flags & _abi.LR_IMAGE_EXACT),
            "perspective": bool(line.flags & _abi.LR_IMAGE_PERSPECTIVE),
            "surfaces": bool(line.flags & _abi.LR_IMAGE_SURFACES),
            "lights": bool(line.flags & _abi.LR_IMAGE_LIGHTS),
            "frames": bool(line.flags & _abi.LR_IMAGE_FRAMES),
        }
        found.append(read_entry(ImageMethod, index, line, **flags))
    return found


def image_variants() -> list[ImageMethod]:
    """All whole-image methods with every combination of their options."""
    return all_choices(image_methods())


def image_method(spec: str) -> ImageMethod:
    """The method that spec, "name" or "name:option=choice,...", asks for.

    Raises LeapRayError that lists what there is.
    """
    return find("image method", str(spec), image_methods())


# ---- preparation -----------------------------------------------------------------


@dataclass(frozen=True)
class Voxels:
    """What is kept of surface voxels."""

    cell: NDArray[np.int32]  # (n, 3) i, j, k
    normal: NDArray[np.float64]  # (n, 3) unit, outward, object space; 0 where there is none
    color: NDArray[np.float64]  # (n, 3) linear RGB
    lit: NDArray[np.uint32]  # (n,) a bit for each light that the voxel sees


def _light_struct(light: Light) -> _abi.lr_image_light:
    """A light as C has it. Raises LeapRayError for a kind that does not fit a bit."""
    if light.kind not in ("sun", "point"):
        raise LeapRayError(
            f"a voxel sees a light or not, which holds of the kinds sun and point, not {light.kind}"
        )
    result = _abi.lr_image_light()
    result.distant = light.kind == "sun"
    place = light.direction if result.distant else light.position
    for name, values in (("place", place), ("color", light.color)):
        array = np.asarray(values, np.float64)
        if array.shape != (3,):
            raise LeapRayError(f"the {name} of a light must have shape (3,), it has {array.shape}")
        getattr(result, name)[:] = array
    return result


class Prepared:
    """What a whole-image method needs beside the volume, which it keeps alive; `prepare` makes it.

    volume: whose it is; method: with its options; handle: the core's.
    Attributes: volume; method; nbytes, without the volume.
    """

    def __init__(self, volume: Volume, method: ImageMethod, handle) -> None:
        self.volume = volume
        self.method = method
        self.handle = handle
        weakref.finalize(self, lib.lr_prepared_free, handle)

    @property
    def nbytes(self) -> int:
        """Bytes that it takes, without the volume."""
        return lib.lr_prepared_nbytes(self.handle)

    def set_light(self, index: int, light: Light | None, *, watch: Watch | None = None) -> None:
        """Set light 0..31 of a method whose `lights` is set, or take it away by None.

        index: which one; what is stored of the others stays. light: a "sun" or a "point", in the
        volume's object space, of which kind, color, position and direction count. Nobody may render
        with this meanwhile. Raises LeapRayError for others, Stopped when watch was told to stop;
        nothing has changed then.
        """
        number = ctypes.c_int32(index).value if isinstance(index, int) else -1
        if number != index:
            raise LeapRayError(f"the number of a light must be 0 to 31; it is {index!r}")
        struct = None if light is None else ctypes.byref(_light_struct(light))
        call(lib.lr_prepared_light, self.handle, number, struct, watch=watch)

    def voxels(self) -> Voxels:
        """What a method whose `lights` is set keeps of each surface voxel; of others nothing.

        Raises OutOfMemory where there is no room for the arrays.
        """
        n = lib.lr_prepared_voxel_count(self.handle)
        cell, lit = empty((n, 3), np.int32), empty((n,), np.uint32)
        normal, color = empty((n, 3), float), empty((n, 3), float)
        pointers = pointer(normal), pointer(color), pointer(lit, ctypes.c_uint32)
        lib.lr_prepared_voxels(self.handle, pointer(cell, ctypes.c_int32), *pointers)
        return Voxels(cell, normal, color, lit)

    def __repr__(self) -> str:
        return f"<Prepared {self.method.spec}, {self.nbytes / 1e6:.3g} MB, of {self.volume!r}>"


def prepare(volume: Volume, method: str | ImageMethod, *, watch: Watch | None = None) -> Prepared:
    """Make what a whole-image method needs for a volume.

    method: "name", "name:option=choice,..." or an ImageMethod. Raises LeapRayError for an unknown
    name and for rectilinear and cubic volumes, Stopped when watch was told to stop.
    """
    if not isinstance(volume, Volume):
        raise LeapRayError(
            f"images are made of a leapray.Volume, which leapray.Volume(samples) makes; this is "
            f"of type {type(volume).__name__}"
        )
    entry = method if isinstance(method, ImageMethod) else image_method(method)
    choices = choice_numbers(entry)
    handle = ctypes.POINTER(_abi.lr_prepared)()
    call(lib.lr_prepare, volume.handle, entry.index, choices, watch=watch, outputs=(handle,))
    return Prepared(volume, entry, handle)


# ---- images ------------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class Image:
    """What lies behind each pixel's centre; row 0 is the lowest."""

    t: NDArray[np.float64]  # (height, width) depth along the camera's forward; infinity on a miss
    cell: NDArray[np.int32]  # (height, width, 3) i, j, k of the first object cell
    hit: NDArray[np.bool_]  # (height, width)
    skipped: NDArray[np.bool_]  # (height, width) a miss that was known without a ray of its own
    shade: NDArray[np.float64]  # (height, width, 3) linear RGB, 0 on a miss
    normal: NDArray[np.float64] | None  # (height, width, 3) unit, outward; where the method has it
    counters: dict[str, int]  # as add_counters gives them
    method: ImageMethod
    camera: Camera
    empty: NDArray[np.float64] | None = None  # (height, width, 2) of all that the camera sees: what
    # the next frame uses,
    volume: Volume | None = None  # and whose it is

    def __repr__(self) -> str:
        height, width = self.t.shape
        return (
            f"<Image {self.method.spec} of {width} x {height} pixels, {self.hit.sum()} hit, "
            f"{self.skipped.sum()} skipped>"
        )

    def misses(self, exact: Image) -> Misses:
        """How this image differs from one of the same camera by an exact method.

        exact: of the same size. Raises LeapRayError for another size or a method that is not exact.
        """
        if exact.t.shape != self.t.shape or not exact.method.exact:
            raise LeapRayError(
                f"an image of {self.t.shape[1]} x {self.t.shape[0]} pixels by an exact method is "
                f"needed; this is {exact!r}"
            )
        both = self.hit & exact.hit
        apart = np.abs(self.cell - exact.cell)[both].max(axis=-1, initial=0)
        return Misses(
            lost=int((exact.hit & ~self.hit).sum()),
            invented=int((self.hit & ~exact.hit).sum()),
            displaced=int((apart > 0).sum()),
            farthest=int(apart.max(initial=0)),
            hits=int(exact.hit.sum()),
        )


@dataclass(frozen=True)
class Misses:
    """Pixels in which an image is not that of an exact method."""

    lost: int  # that see nothing where there is something
    invented: int  # that see something where there is nothing
    displaced: int  # that see another cell
    farthest: int  # of those: the largest difference of i, j or k
    hits: int  # pixels of the exact image that see something


def render_image(
    method: str | ImageMethod,
    source: Volume | Prepared,
    camera: Camera,
    width: int,
    height: int,
    *,
    window: tuple[int, int, int, int] | None = None,
    before: Image | None = None,
    keep: bool | NDArray[np.float64] = True,
    threads: int = 1,
    watch: Watch | None = None,
) -> Image:
    """Render the first object cells behind a camera's pixels by a whole-image method.

    method: "name", "name:option=choice,..." or an ImageMethod. source: the volume, or what
    `prepare` made of it for this method, which saves its time. camera: in the volume's object
    space and in pixels of an image of that width and height. window: x, y, width and height of the
    part of it that is rendered, which then is the image; None: all. t is depth along the camera's
    forward, as in `trace` with the rays of `camera_rays`. before: the frame before, of methods
    whose `frames` is set; it changes no bit. keep: what the next frame uses; of windows, which
    keep nothing else, an array (height, width, 2) of zeros for the whole image that takes it.
    threads (0: all cores) take bands of the image: of exact methods they change no bit but of
    `skipped`, nor do windows. Raises LeapRayError for a camera that the method does not take,
    Stopped when watch was told to stop.
    """
    check_threads(threads)
    entry = method if isinstance(method, ImageMethod) else image_method(method)
    if width < 1 or height < 1:
        raise LeapRayError(f"an image needs pixels; there are {width} x {height}")
    film = height, width
    x, y, width, height = _window(window, width, height)
    if isinstance(source, Prepared) and source.method.spec != entry.spec:
        raise LeapRayError(f"what was prepared for {source.method.spec} is not for {entry.spec}")
    seen, shape = camera_struct(camera), (height, width)
    t, cell, pixel = empty(shape, float), empty((*shape, 3), np.int32), empty(shape, np.uint8)
    shade = empty((*shape, 3), float)
    normal = empty((*shape, 3), float) if entry.lights else None
    whole = _kept(keep, film) if entry.frames and (window is None or keep is not True) else None
    kept = None if whole is None else empty((*shape, 2), float)
    watch = watch or Watch()
    prepared = source if isinstance(source, Prepared) else prepare(source, entry, watch=watch)
    earlier = _before(before, prepared)

    def band(first: int, last: int) -> _abi.lr_counters:
        def rows(array: NDArray | None, c_type=ctypes.c_double):
            return None if array is None else pointer(array[first:last], c_type)

        image = _abi.lr_image(
            x, y + first, width, last - first, rows(t), rows(cell, ctypes.c_int32),
            rows(pixel, ctypes.c_uint8), rows(shade), rows(normal), rows(kept),
        )  # fmt: skip
        counters = _abi.lr_counters()
        call(
            lib.lr_render_image,
            prepared.handle,
            ctypes.byref(seen),
            ctypes.byref(earlier) if earlier is not None else None,
            ctypes.byref(image),
            ctypes.byref(counters),
            watch=watch,
        )
        return counters

    if threads == 1:
        totals = [band(0, height)]
    else:
        share = -(-height // (threads or cores()))
        totals = run_parts(band, height, share, threads, watch)
    hit, skipped = pixel == _abi.LR_PIXEL_HIT, pixel == _abi.LR_PIXEL_SKIPPED
    counters = add_counters(totals)
    if whole is not None:
        whole[y : y + height, x : x + width] = kept
    volume = None if whole is None else prepared.volume
    return Image(t, cell, hit, skipped, shade, normal, counters, entry, camera, whole, volume)


def _window(
    window: tuple[int, int, int, int] | None, width: int, height: int
) -> tuple[int, int, int, int]:
    """A part of an image. Raises LeapRayError where it is none."""
    if window is None:
        return 0, 0, width, height
    if np.shape(window) != (4,):
        raise LeapRayError(f"a window is x, y, width and height; it has shape {np.shape(window)}")
    x, y, w, h = numbers(window, np.int32, "window").tolist()
    if not (x >= 0 and y >= 0 and w > 0 and h > 0 and x + w <= width and y + h <= height):
        raise LeapRayError(
            f"a window of {w} x {h} pixels from ({x}, {y}) is no part of {width} x {height} pixels"
        )
    return x, y, w, h


def _kept(keep: bool | NDArray[np.float64], film: tuple[int, int]) -> NDArray[np.float64] | None:
    """What takes what the next frame uses of a film; None: it is not kept."""
    if isinstance(keep, bool):
        return empty((*film, 2), float) if keep else None
    if keep.shape != (*film, 2) or keep.dtype != np.float64 or not keep.flags.c_contiguous:
        raise LeapRayError(
            f"keep must be float64 {(*film, 2)} without gaps; it is {keep.dtype} {keep.shape}"
        )
    return keep


def _before(image: Image | None, prepared: Prepared) -> _abi.lr_frame_before | None:
    """The frame before as C has it; the image keeps its arrays alive."""
    if image is None:
        return None
    spec = prepared.method.spec
    if image.method.spec != spec or image.empty is None:
        raise LeapRayError(
            f"the frame before must be by {spec}, with keep=True; it is by {image.method.spec}"
        )
    if image.volume is not prepared.volume:
        raise LeapRayError("the frame before is of another volume")
    height, width, _ = image.empty.shape
    return _abi.lr_frame_before(camera_struct(image.camera), width, height, pointer(image.empty))


def camera_rays(
    camera: Camera, width: int, height: int, window: tuple[int, int, int, int] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The rays through the centres of a camera's pixels, for `trace`: the bits of `render_image`.

    camera: in pixels of an image of that width and height. window: the part that is wanted, as for
    `render_image`. Returns origins and directions (n, 3) of its n pixels, row 0 the lowest; t_min
    and t_max are the camera's clip_start and clip_end. Raises LeapRayError for vectors that are
    none.
    """
    left, below, width, height = _window(window, width, height)
    seen = camera_struct(camera)
    eye, corner, dx, dy = (np.array(getattr(seen, k)) for k in ("eye", "corner", "dx", "dy"))
    x = left + np.arange(width)[None, :, None] + 0.5
    y = below + np.arange(height)[:, None, None] + 0.5
    film = ((corner + x * dx) + y * dy).reshape(-1, 3)
    if camera.projection == "perspective":
        return np.broadcast_to(eye, film.shape).copy(), film
    return eye + film, np.broadcast_to(np.array(seen.forward), film.shape).copy()
