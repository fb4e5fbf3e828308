"""Volumes of worlds and materials, where they are the same everywhere: Volume Scatter, Volume Absorption,
Principled Volume, Volume Coefficients, sums of them and mixes by constants, their inputs constant (nodes/).
Coefficients as Cycles has them (its `kernel/svm/closure.h`)."""

from __future__ import annotations

import math

import bpy

from ..core.medium import Medium
from .nodes import readers  # noqa: F401 (what reads the nodes of inputs)
from .nodes.graph import At, Graph, Path, link_of, origins, unlinked
from .nodes.values import saturated

# A phase function of exactly 1 or -1 is a mirror: Cycles stops short of it too.
MOST_ANISOTROPY = 0.9999
# As in the effects' own settings: nothing is seen through a micrometre of it.
MOST_PER_M = 1e6


def volume_of(tree: bpy.types.NodeTree | None, where: str) -> tuple[Medium | None, list[str]]:
    """The medium at a node tree's volume output, None where there is none or it cannot be read, and
    warnings."""
    output = tree.get_output_node("CYCLES") if tree is not None else None
    if output is None or link_of(output.inputs["Volume"]) is None:
        return None, []
    reader = _Reader(where)
    reader.add(output.inputs["Volume"])
    reader.warnings += [f"{where}: {warning}" for warning in reader.graph.warnings]
    if reader.unread:
        return None, [f"{where}: its volume is not read ({reason})" for reason in reader.unread]
    return reader.medium(), reader.warnings


VOLUMES = {
    "ShaderNodeVolumeScatter": "as Cycles; of phase functions Henyey-Greenstein's, and Draine's as that one; "
    "the others count as even",
    "ShaderNodeVolumeAbsorption": "as Cycles",
    "ShaderNodeVolumePrincipled": "as Cycles, without what it emits",
    "ShaderNodeVolumeCoefficients": "as Cycles, without what it emits",
    "ShaderNodeAddShader": "the sum of its volumes",
    "ShaderNodeMixShader": "the mix of its volumes by a constant",
}
"""What is read, for docs/reading.md."""


class _Reader:
    def __init__(self, where: str):
        self.where = where
        self.graph = Graph()
        self.weight = 1.0
        self.scattering = [0.0, 0.0, 0.0]
        self.absorption = [0.0, 0.0, 0.0]
        self.turned = 0.0  # anisotropy times scattering
        self.unread: list[str] = []
        self.warnings: list[str] = []

    def add(self, socket: bpy.types.NodeSocket, path: Path = (), weight: float = 1.0) -> None:
        """What feeds an input, so much of it."""
        link = link_of(socket)
        if link is None:
            return
        node = link.from_node
        origin = self.graph.follow(node, link.from_socket, path)
        if origin is None:
            return
        if origin is not False:
            self.add(*origin, weight)
            return
        at = At(self.graph, node, path)
        kinds = {
            "ShaderNodeVolumeScatter": self._scatter,
            "ShaderNodeVolumeAbsorption": self._absorption,
            "ShaderNodeVolumePrincipled": self._principled,
            "ShaderNodeVolumeCoefficients": self._coefficients,
        }
        if node.bl_idname in {"ShaderNodeAddShader", "ShaderNodeMixShader"}:
            weights = (weight, weight)
            if node.bl_idname == "ShaderNodeMixShader":
                share = saturated(at.input("Fac"))
                if not share.is_constant:
                    self.unread.append(f"what mixes its shaders: {origins(share)} not read")
                    return
                weights = (weight * (1.0 - share.number()), weight * share.number())
            for name, each in zip(("Shader", "Shader_001"), weights, strict=True):
                if each > 0.0:
                    self.add(at.socket(name), path, each)
        elif node.bl_idname in kinds:
            self.weight = weight
            kinds[node.bl_idname](at)
        else:
            self.unread.append(f"node '{node.name}'")

    def medium(self) -> Medium | None:
        numbers = [*self.scattering, *self.absorption, self.turned]
        if not all(map(math.isfinite, numbers)):
            self.warnings.append(f"{self.where}: its volume is left out, a coefficient is not finite")
            return None
        total = sum(self.scattering)
        anisotropy = self.turned / total if total > 0.0 else 0.0
        anisotropy = max(-MOST_ANISOTROPY, min(MOST_ANISOTROPY, anisotropy))
        if max(*self.scattering, *self.absorption) > MOST_PER_M:
            self.warnings.append(f"{self.where}: its volume is taken as {MOST_PER_M:g} per metre at most")
        scattering, absorption = (
            tuple(min(value, MOST_PER_M) for value in values) for values in (self.scattering, self.absorption)
        )
        medium = Medium(scattering, absorption, anisotropy)
        return None if medium.is_empty else medium

    def _collect(self, scattering, absorption, anisotropy: float) -> None:
        scattering = [self.weight * max(float(s), 0.0) for s in scattering]
        absorption = [self.weight * max(float(a), 0.0) for a in absorption]
        self.scattering = [a + b for a, b in zip(self.scattering, scattering, strict=True)]
        self.absorption = [a + b for a, b in zip(self.absorption, absorption, strict=True)]
        if self.turned and sum(scattering) and anisotropy != self.turned / sum(self.scattering):
            self.warnings.append(f"{self.where}: its phase functions are taken as one of their mean cosine")
        self.turned += anisotropy * sum(scattering)

    def _value(self, at: At, name: str):
        """An input's number, or the list of them; anything that varies is not read."""
        value = at.input(name)
        if not value.is_constant:
            self.unread.append(f"its {name.lower()}: {origins(value)} not read")
            value = unlinked(at.socket(name))
        return value.constant.tolist()

    def _phase(self, at: At) -> float:
        kind = getattr(at.node, "phase", "HENYEY_GREENSTEIN")
        if kind == "HENYEY_GREENSTEIN":
            return float(self._value(at, "Anisotropy"))
        if kind == "DRAINE":
            self.warnings.append(f"{self.where}: Draine's phase function is taken as Henyey-Greenstein's")
            return float(self._value(at, "Anisotropy"))
        self.warnings.append(f"{self.where}: the phase function of node '{at.node.name}' is taken as even")
        return 0.0

    def _scatter(self, at: At) -> None:
        density = self._density(at)
        colour = self._value(at, "Color")
        self._collect([c * density for c in colour], [0.0] * 3, self._phase(at))

    def _absorption(self, at: At) -> None:
        density = self._density(at)
        colour = self._value(at, "Color")
        self._collect([0.0] * 3, [(1.0 - c) * density for c in colour], 0.0)

    def _principled(self, at: At) -> None:
        density = self._density(at)
        colour = [max(c, 0.0) for c in self._value(at, "Color")]
        tint = [math.sqrt(max(c, 0.0)) for c in self._value(at, "Absorption Color")]
        taken = [max(1.0 - c, 0.0) * max(1.0 - t, 0.0) for c, t in zip(colour, tint, strict=True)]
        anisotropy = float(self._value(at, "Anisotropy"))
        self._collect([c * density for c in colour], [t * density for t in taken], anisotropy)
        if self._value(at, "Emission Strength") > 0.0 or self._value(at, "Blackbody Intensity") > 0.0:
            self.warnings.append(f"{self.where}: the light that its volume emits is not baked")

    def _coefficients(self, at: At) -> None:
        scattering = self._value(at, "Scatter Coefficients")
        absorption = self._value(at, "Absorption Coefficients")
        self._collect(scattering, absorption, self._phase(at))
        if any(self._value(at, "Emission Coefficients")):
            self.warnings.append(f"{self.where}: the light that its volume emits is not baked")

    def _density(self, at: At) -> float:
        return max(float(self._value(at, "Density")), 0.0)
