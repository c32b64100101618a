# SPDX-License-Identifier: GPL-3.0-or-later
"""What volumes look like: the volume shaders of a material, as what they make of a field's values.

Extinction and emission of Principled Volume, Volume Absorption, Volume Scatter, Volume Coefficients
and Emission, as Cycles has them. Their sockets may depend on the field through any nodes that work
on one value: an Attribute node of its name, or Volume Info. What fills a mesh depends on nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from leapray import LeapRayError, Step, compile_program
from leapray.programs import INPUTS, numbers_of

from ... import model
from ...arrays import FLOAT_MOST
from . import colors, phases
from .links import Values, average
from .nodes import Folder, Place, Unfolded, output_of, own_value, title
from .shaders import Constants

Part = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # values (n,) to (n, 3)

OWN = "value", "density"  # what any field may be called
CHANNEL = INPUTS[0]  # through which programs get a value
STEFAN_BOLTZMANN = 5.670373e-8 * 1e-6 / np.pi  # radiance by kelvin^4, as Cycles scales it
LEAST_POWER = 1e-5  # as in Cycles: less is nothing
SOME = np.linspace(-2.0, 2.0, 41)  # values at which anisotropies are compared
DENSEST = 1e12  # that fills meshes: a wall's; from more light would not find out again
ALIKE = 0.01  # those that differ by less are not told
HENYEY_GREENSTEIN, RAYLEIGH = "HENYEY_GREENSTEIN", "RAYLEIGH"  # phase functions of Blender's


def read_look(material, grid: str, notes) -> model.Look:
    """The look of a field whose grid has that name. Raises LeapRayError where there is none."""
    name = material.name if material is not None else "None"
    output = output_of(material) if material is not None else None
    if output is None:
        raise LeapRayError(f"its material {name!r} has no volume shader")
    return _Reader(material.name, grid, notes).read(output)


def is_alone(material) -> bool:
    """Whether a material has a volume shader, and none of a surface."""
    output = output_of(material) if material is not None else None
    if output is None:
        return False
    sockets = output.node.inputs
    return sockets["Volume"].is_linked and not sockets["Surface"].is_linked


def is_shown(shown: str, material) -> bool:
    """Whether a field is a volume without a surface: where the user says so, or, automatically,
    the material does."""
    return shown == "volume" or (shown == "auto" and is_alone(material))


def read_inside(material: Constants, socket) -> dict[str, Any] | None:
    """What the shaders at a volume socket of a material fill meshes with: members of
    model.Material; None where there is no shader. What is not understood is told to the
    material."""
    reader = _Reader(material.name, None, material.notes)
    reader.strange = material.strange
    found = reader.flattened(socket)
    if not found:
        return None
    look = reader.look(found)
    one = np.zeros(1)  # of the values that there are not
    parts = look.extinction, look.scattering, look.forward, look.emission
    extinction, scattering, forward, glow = (part(one)[0] for part in parts)
    share = DENSEST / np.maximum(extinction.max(), DENSEST)
    extinction, scattering, forward, glow = (
        share * each for each in (extinction, scattering, forward, glow)
    )
    absorption = np.maximum(extinction - scattering, 0.0)
    total = scattering.sum()
    return {
        "absorption": tuple(absorption.tolist()),
        "scattering": tuple(scattering.tolist()),
        "glow": tuple(glow.tolist()),
        "anisotropy": float(np.clip(forward.sum() / total, -1, 1)) if total > 0 else 0.0,
        "phase": look.phase,
    }


class _Reader(Constants):
    """The look that one material gives to fields of one name, or to meshes (None)."""

    def __init__(self, name: str, grid: str | None, notes) -> None:
        super().__init__(name, notes)
        self.grid = grid
        self.own = () if grid is None else (grid, *OWN)  # what its values are called
        self.extinction: list[Part] = []
        self.emission: list[Part] = []
        self.scattering: list[Part] = []
        self.forward: list[Part] = []  # scattering times its mean cosine
        self.phases: set[str] = set()  # of what scatters,
        self.cosines: list[Part] = []  # and their means
        self.keys: list[bytes] = []
        self.named: dict[float, None] = {}  # numbers among the nodes

    def read(self, output: Place) -> model.Look:
        found = self.flattened(output.node.inputs.get("Volume"))
        if not found:
            raise LeapRayError(f"its material {self.name!r} has no volume shader")
        look = self.look(found)
        self.tell()
        return look

    def look(self, found: list[tuple[Place, float]]) -> model.Look:
        """Of these shaders, with their weights."""
        for out, weight in found:
            kind = out.node.bl_idname
            if kind in _SHADERS:
                _SHADERS[kind](self, out, weight)
            else:
                self.strange[title(out.node)] = None
        phase = RAYLEIGH if self.phases == {RAYLEIGH} else HENYEY_GREENSTEIN
        if phase == HENYEY_GREENSTEIN:
            self._tell_mixture()
        return model.Look(
            _sum(self.extinction),
            _sum(self.emission),
            _sum(self.scattering),
            _sum(self.forward),
            b"|".join(self.keys),
            tuple(self.named),
            phase.lower(),
        )

    # -- shaders

    def _principled(self, out: Place, weight: float) -> None:
        density = self._density(out)
        scattered, absorbed = self._part(out, "Color"), self._part(out, "Absorption Color")
        if self._text(out, "Color Attribute"):
            self.strange["Color Attribute"] = None

        def extinction(v: NDArray) -> NDArray:
            color = np.maximum(scattered(v), 0.0)
            lost = np.maximum(1 - color, 0) * np.maximum(1 - np.sqrt(np.maximum(absorbed(v), 0)), 0)
            return weight * density(v) * (color + lost)

        self._scatters(out, lambda v: weight * density(v) * np.maximum(scattered(v), 0))
        self.extinction.append(extinction)
        power, glow = self._part(out, "Emission Strength"), self._part(out, "Emission Color")
        self.emission.append(lambda v: weight * np.maximum(power(v), 0) * np.maximum(glow(v), 0))
        self._blackbody(out, weight)

    def _blackbody(self, out: Place, weight: float) -> None:
        """The light of a temperature, which of a field is another grid."""
        socket = out.node.inputs["Blackbody Intensity"]
        if not (socket.is_linked or socket.default_value > 0):
            return
        if self.grid is not None:
            self.strange["Blackbody Intensity"] = None
            return
        share, kelvin = self.number(out, "Blackbody Intensity"), self.number(out, "Temperature")
        kelvin, share = max(kelvin, 0.0), min(max(share, 0.0), 1.0)
        power = STEFAN_BOLTZMANN * (1 - share + share * kelvin**4)
        tint = np.maximum(self.value(out, "Blackbody Tint"), 0.0)
        glow = power * colors.blackbody(np.array(kelvin)) * tint
        if power > LEAST_POWER:
            self.emission.append(lambda v: np.broadcast_to(weight * glow, (len(v), 3)))

    def _density(self, out: Place) -> Part:
        """Of a Principled Volume: that of its socket times its attribute."""
        density, name = self._part(out, "Density"), self._text(out, "Density Attribute")
        if name in self.own:
            return lambda v: np.maximum(density(v) * v[:, None], 0)
        if name and self.grid is not None:
            self.strange[f"Density Attribute {name!r}"] = None
        return lambda v: np.maximum(density(v), 0)

    def _absorption(self, out: Place, weight: float) -> None:
        color, density = self._part(out, "Color"), self._part(out, "Density")
        self.extinction.append(
            lambda v: weight * np.maximum(density(v), 0) * np.maximum(1 - color(v), 0)
        )

    def _scatter(self, out: Place, weight: float) -> None:
        color, density = self._part(out, "Color"), self._part(out, "Density")

        def scattering(v: NDArray) -> NDArray:
            return weight * np.maximum(density(v), 0) * np.maximum(color(v), 0)

        self._scatters(out, scattering)
        self.extinction.append(scattering)

    def _coefficients(self, out: Place, weight: float) -> None:
        lost = [self._part(out, f"{name} Coefficients") for name in ("Absorption", "Scatter")]
        self._scatters(out, lambda v: weight * np.maximum(lost[1](v), 0))
        self.extinction += [
            lambda v, part=part: weight * np.maximum(part(v), 0)  # type: ignore[misc]
            for part in lost
        ]
        glow = self._part(out, "Emission Coefficients")
        self.emission.append(lambda v: weight * np.maximum(glow(v), 0))

    def _emission(self, out: Place, weight: float) -> None:
        color, power = self._part(out, "Color"), self._part(out, "Strength")
        self.emission.append(lambda v: weight * np.maximum(power(v), 0) * np.maximum(color(v), 0))

    def _scatters(self, out: Place, scattering: Part) -> None:
        """A shader of that scattering, per unit of length."""
        kind = getattr(out.node, "phase", HENYEY_GREENSTEIN)
        self.phases.add(kind)
        self.keys.append(kind.encode())
        self.scattering.append(scattering)
        cosine = self._mean_cosine(out, kind)
        self.cosines.append(cosine)
        self.forward.append(lambda v: scattering(v) * cosine(v))

    def _tell_mixture(self) -> None:
        """Say it where several phase functions are mixed."""
        cosines = np.array([cosine(SOME) for cosine in self.cosines])
        several = len(cosines) > 1 and np.ptp(cosines, axis=0).max() > ALIKE
        if several or {RAYLEIGH} < self.phases:
            self.notes.unsupported(
                "A mixture of phase functions, in place of which stands one of its mean cosine, is",
                self.name,
            )

    def _mean_cosine(self, out: Place, kind: str) -> Part:
        if kind == RAYLEIGH:
            return lambda v: np.zeros((len(v), 3))
        if kind != HENYEY_GREENSTEIN:
            told = kind.replace("_", " ").title()
            self.notes.unsupported(
                f"The phase function {told}, in place of which stands that of Henyey and "
                "Greenstein with its mean cosine, is",
                self.name,
            )
        if kind in (HENYEY_GREENSTEIN, "DRAINE"):
            g = self._part(out, "Anisotropy")
            if kind == HENYEY_GREENSTEIN:
                return lambda v: np.clip(g(v), -1, 1)
            alpha = self._part(out, "Alpha")
            return lambda v: phases.draine(np.clip(g(v), -1, 1), np.maximum(alpha(v), 0))
        if kind == "MIE":
            mean = phases.mie(self.number(out, "Diameter"))
        else:
            mean = phases.fournier_forand(*(self.number(out, n) for n in ("IOR", "Backscatter")))
        self.keys.append(np.float64(mean).tobytes())
        return lambda v: np.full((len(v), 3), mean)

    # -- sockets

    def _text(self, out: Place, name: str) -> str:
        socket = out.node.inputs.get(name)
        return "" if socket is None else str(socket.default_value)

    def _part(self, out: Place, name: str) -> Part:
        """What a socket has of values, as (n, 3)."""
        place = out.input(name)
        try:
            values = Folder(self._of_field).values(place)
        except Unfolded as error:
            self.strange[str(error)] = None
            values = tuple(np.ravel(own_value(place)).tolist()[:3])
            values = values if len(values) == 3 else values[0]
        return self._function(values)

    def _function(self, values: Values) -> Part:
        triple = values if isinstance(values, tuple) else (values,) * 3
        if not any(isinstance(each, Step) for each in triple):
            numbers = np.array(triple, np.float64)
            self.keys.append(numbers.tobytes())
            return lambda v: np.broadcast_to(numbers, (len(v), 3))
        try:
            program = compile_program(cast(tuple, triple))
        except LeapRayError as error:
            self.strange[f"so many nodes ({error})"] = None
            return lambda v: np.zeros((len(v), 3))
        self.keys.append(program.key)
        self.named |= dict.fromkeys(numbers_of(triple))

        def run(v: NDArray) -> NDArray:
            inputs = np.ones((len(v), 4), np.float32)
            inputs[:, :3] = np.clip(v, -FLOAT_MOST, FLOAT_MOST)[:, None]
            made = program.run(inputs).astype(np.float64)
            return np.clip(made, -FLOAT_MOST, FLOAT_MOST)  # a NaN stays one

        return run

    def _of_field(self, out: Place) -> Values:
        """The output of a node that tells of the field."""
        node, kind = out.node, out.node.bl_idname
        grey = (CHANNEL,) * 3
        if self.grid is None:
            raise Unfolded(title(node))
        if kind == "ShaderNodeVolumeInfo" and out.socket.name == "Density":
            return CHANNEL
        if kind == "ShaderNodeAttribute" and node.attribute_type == "GEOMETRY":
            if node.attribute_name in self.own:
                return average(grey) if out.socket.type == "VALUE" else grey
            raise Unfolded(f"{title(node)} ({node.attribute_name})")
        raise Unfolded(title(node))


def _sum(parts: list[Part]) -> Part:
    def run(v: NDArray[np.float64]) -> NDArray[np.float64]:
        return sum((part(v) for part in parts), np.zeros((len(v), 3)))

    return run


_SHADERS = {
    "ShaderNodeVolumePrincipled": _Reader._principled,
    "ShaderNodeVolumeAbsorption": _Reader._absorption,
    "ShaderNodeVolumeScatter": _Reader._scatter,
    "ShaderNodeVolumeCoefficients": _Reader._coefficients,
    "ShaderNodeEmission": _Reader._emission,
}
