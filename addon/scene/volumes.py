"""Volumes of worlds and materials, where they are the same everywhere: Volume Scatter, Volume Absorption,
Principled Volume, Volume Coefficients, and sums of them. Coefficients as Cycles has them (its
`kernel/svm/closure.h`)."""

from __future__ import annotations

import math

import bpy

from ..core.medium import Medium

# A phase function of exactly 1 or -1 is a mirror: Cycles stops short of it too.
MOST_ANISOTROPY = 0.9999
# As in the effects' own settings: nothing is seen through a micrometre of it.
MOST_PER_M = 1e6


def volume_of(tree: bpy.types.NodeTree | None, where: str) -> tuple[Medium | None, list[str]]:
    """The medium at a node tree's volume output, None where there is none or it cannot be read, and
    warnings."""
    output = tree.get_output_node("CYCLES") if tree is not None else None
    node = _source(output.inputs["Volume"]) if output is not None else None
    if node is None:
        return None, []
    reader = _Reader(where)
    reader.add(node)
    if reader.unread:
        return None, [f"{where}: its volume is not read ({reason})" for reason in reader.unread]
    return reader.medium(), reader.warnings


def _source(socket: bpy.types.NodeSocket):
    """The node that feeds an input, through reroutes; None where nothing does."""
    for _hop in range(64):
        links = [link for link in socket.links if link.is_valid and not link.is_muted]
        if not links:
            return None
        node = links[0].from_node
        if node.bl_idname != "NodeReroute":
            return node
        socket = node.inputs[0]
    return None


class _Reader:
    def __init__(self, where: str):
        self.where = where
        self.scattering = [0.0, 0.0, 0.0]
        self.absorption = [0.0, 0.0, 0.0]
        self.turned = 0.0  # anisotropy times scattering
        self.unread: list[str] = []
        self.warnings: list[str] = []

    def add(self, node: bpy.types.Node) -> None:
        kinds = {
            "ShaderNodeVolumeScatter": self._scatter,
            "ShaderNodeVolumeAbsorption": self._absorption,
            "ShaderNodeVolumePrincipled": self._principled,
            "ShaderNodeVolumeCoefficients": self._coefficients,
        }
        if node.bl_idname == "ShaderNodeAddShader":
            for socket in node.inputs:
                if (shader := _source(socket)) is not None:
                    self.add(shader)
        elif node.bl_idname in kinds:
            kinds[node.bl_idname](node)
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
        scattering = [max(float(s), 0.0) for s in scattering]
        self.scattering = [a + b for a, b in zip(self.scattering, scattering, strict=True)]
        self.absorption = [a + max(float(b), 0.0) for a, b in zip(self.absorption, absorption, strict=True)]
        if self.turned and sum(scattering) and anisotropy != self.turned / sum(self.scattering):
            self.warnings.append(f"{self.where}: its phase functions are taken as one of their mean cosine")
        self.turned += anisotropy * sum(scattering)

    def _value(self, node: bpy.types.Node, name: str):
        """An input's constant; anything that varies is not read."""
        socket = node.inputs[name]
        source = _source(socket)
        if source is None:
            return socket.default_value
        if source.bl_idname in {"ShaderNodeValue", "ShaderNodeRGB"}:
            return source.outputs[0].default_value
        self.unread.append(f"node '{source.name}' varies its {name.lower()}")
        return socket.default_value

    def _phase(self, node: bpy.types.Node) -> float:
        kind = getattr(node, "phase", "HENYEY_GREENSTEIN")
        if kind == "HENYEY_GREENSTEIN":
            return float(self._value(node, "Anisotropy"))
        if kind == "DRAINE":
            self.warnings.append(f"{self.where}: Draine's phase function is taken as Henyey-Greenstein's")
            return float(self._value(node, "Anisotropy"))
        self.warnings.append(f"{self.where}: the phase function of node '{node.name}' is taken as even")
        return 0.0

    def _scatter(self, node: bpy.types.Node) -> None:
        density = self._density(node)
        colour = self._value(node, "Color")[:3]
        self._collect([c * density for c in colour], [0.0] * 3, self._phase(node))

    def _absorption(self, node: bpy.types.Node) -> None:
        density = self._density(node)
        colour = self._value(node, "Color")[:3]
        self._collect([0.0] * 3, [(1.0 - c) * density for c in colour], 0.0)

    def _principled(self, node: bpy.types.Node) -> None:
        density = self._density(node)
        colour = [max(c, 0.0) for c in self._value(node, "Color")[:3]]
        tint = [math.sqrt(max(c, 0.0)) for c in self._value(node, "Absorption Color")[:3]]
        taken = [max(1.0 - c, 0.0) * max(1.0 - t, 0.0) for c, t in zip(colour, tint, strict=True)]
        anisotropy = float(self._value(node, "Anisotropy"))
        self._collect([c * density for c in colour], [t * density for t in taken], anisotropy)
        if self._value(node, "Emission Strength") > 0.0 or self._value(node, "Blackbody Intensity") > 0.0:
            self.warnings.append(f"{self.where}: the light that its volume emits is not baked")

    def _coefficients(self, node: bpy.types.Node) -> None:
        scattering = self._value(node, "Scatter Coefficients")[:3]
        absorption = self._value(node, "Absorption Coefficients")[:3]
        self._collect(scattering, absorption, self._phase(node))
        if any(self._value(node, "Emission Coefficients")[:3]):
            self.warnings.append(f"{self.where}: the light that its volume emits is not baked")

    def _density(self, node: bpy.types.Node) -> float:
        return max(float(self._value(node, "Density")), 0.0)
