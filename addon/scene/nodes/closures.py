"""Shaders of surfaces, as far as they are read: how much they stop, and what of light they send back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np

from .graph import At, Graph, Path, link_of
from .registry import SHADERS, shader_of
from .values import (
    COLOUR,
    FLOAT,
    Value,
    apply,
    complement,
    constant,
    converted,
    mixed,
    number,
    product,
    quotient,
    saturated,
    total,
    unread,
)

OTHER_BSDF = "ShaderNodeBsdf"
"""What all of the others' names begin with."""

_BLACK = constant(COLOUR, [0.0] * 3)
_ONE, _NOTHING = number(1.0), number(0.0)


@dataclass(frozen=True, eq=False)
class Closure:
    """`opacity`: 1 less the luminance of what a Transparent BSDF in it lets through. All else is of what it
    stops: the share of it that is a `holdout`; the share of diffuse light that comes back, `base`, where it
    is not metallic; and what it emits."""

    opacity: Value = _ONE
    base: Value = _BLACK
    emission: Value = _BLACK
    metallic: Value = _NOTHING
    holdout: Value = _NOTHING

    @property
    def is_clear(self) -> bool:
        return self.opacity.equals(0.0)


BLACK = Closure()
"""No shader: Cycles shows it black, and lets nothing through."""


def closure_at(graph: Graph, socket: bpy.types.NodeSocket, path: Path = ()) -> Closure:
    """Of the shader that feeds an input."""
    link = link_of(socket)
    if link is None:
        return BLACK
    node, output = link.from_node, link.from_socket
    origin = graph.follow(node, output, path)
    if origin is None:
        return BLACK
    if origin is not False:
        return closure_at(graph, *origin)
    reading = SHADERS.get(node.bl_idname)
    if reading is None and _is_bsdf(node):
        reading = SHADERS[OTHER_BSDF]
    if reading is None:
        what = f"node '{node.name}'"
        return Closure(unread(FLOAT, what), unread(COLOUR, what))
    return reading.read(At(graph, node, path))


def _is_bsdf(node: bpy.types.Node) -> bool:
    """Whether it is one of those that scatter light where it falls, and let none through."""
    is_portal = node.bl_idname == "ShaderNodeBsdfRayPortal"
    return node.bl_idname.startswith(OTHER_BSDF) and not is_portal and "Color" in node.inputs


@shader_of(
    "ShaderNodeBsdfPrincipled",
    how="Base Color, Metallic, Alpha, Emission",
    instead="its other lobes are not read",
)
def _principled(at: At) -> Closure:
    strength = at.known("Emission Strength", "emission")
    colour = at.known("Emission Color", "emission") if not strength.equals(0.0) else _BLACK
    metallic = saturated(at.input("Metallic"))
    _note_lobes(at)
    return Closure(
        saturated(at.input("Alpha")),
        at.input("Base Color"),
        product(colour, strength),
        metallic,
    )


# Lobes that change what a diffuse layer multiplies onto; at these defaults a Principled BSDF is without them.
_LOBES = ("Transmission Weight", "Subsurface Weight", "Coat Weight", "Sheen Weight")


def _note_lobes(at: At) -> None:
    sockets = [at.socket(name) for name in _LOBES]
    there = [each.name for each in sockets if each.is_linked or each.default_value > 0.0]
    there += ["Normal"] if at.is_linked("Normal") else []
    if there:
        names = ", ".join(name.removesuffix(" Weight") for name in there)
        at.graph.tell(f"of node '{at.node.name}' {names} {'is' if len(there) == 1 else 'are'} not read")


@shader_of(
    "ShaderNodeBsdfDiffuse",
    "ShaderNodeSubsurfaceScattering",
    how="its colour, as a diffuse one",
)
def _diffuse(at: At) -> Closure:
    return Closure(base=at.input("Color"))


@shader_of(
    OTHER_BSDF,
    how="its colour, as a diffuse one; opaque",
    instead="that its light comes back another way, or on the other side, is not read",
)
def _nearly_diffuse(at: At) -> Closure:
    at.graph.tell(f"node '{at.node.name}' counts as diffuse")
    return _diffuse(at)


@shader_of("ShaderNodeBsdfAnisotropic", "ShaderNodeBsdfMetallic",
           how="its colour, as a metal's")  # fmt: skip
def _glossy(at: At) -> Closure:
    name = "Color" if at.node.bl_idname == "ShaderNodeBsdfAnisotropic" else "Base Color"
    return Closure(base=at.input(name), metallic=_ONE)


@shader_of("ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction",
           how="its colour, without diffuse light; it stops shadow rays, as in Cycles",
           instead="what is behind it is not seen through it")  # fmt: skip
def _glass(at: At) -> Closure:
    at.graph.tell(f"node '{at.node.name}' counts as opaque: nothing is seen through it")
    return Closure(base=at.input("Color"), metallic=_ONE)


@shader_of("ShaderNodeBsdfTransparent", how="how much it lets through: the luminance of its colour",
           instead="the tint of what comes through is not read: errors tell what may hang on it")  # fmt: skip
def _transparent(at: At) -> Closure:
    colour = at.input("Color")
    is_grey = colour.name == "spread"
    if colour.is_constant:
        is_grey = np.ptp(colour.constant) <= 1e-4 * max(float(np.max(np.abs(colour.constant))), 1e-9)
    if not is_grey:
        at.graph.tints[at.node.name] = None
    return Closure(saturated(complement(converted(colour, FLOAT))))


@shader_of("ShaderNodeEmission", how="its colour times its strength",
           instead="for one that is not read the socket's own stands")  # fmt: skip
def _emission(at: At) -> Closure:
    return Closure(emission=product(at.known("Color", "emission"), at.known("Strength", "emission")))


@shader_of("ShaderNodeHoldout", how="a hole for cameras, where all of the material is one",
           instead="mixed with other shaders it counts as black")  # fmt: skip
def _holdout(at: At) -> Closure:
    return Closure(holdout=_ONE)


@shader_of("ShaderNodeMixShader", how="as Cycles, of whatever is read")
def _mix_shader(at: At) -> Closure:
    share = saturated(at.input("Fac"))
    first = closure_at(at.graph, at.socket("Shader"), at.path)
    second = closure_at(at.graph, at.socket("Shader_001"), at.path)
    if share.equals(0.0):
        return first
    if share.equals(1.0):
        return second
    opacity = mixed(first.opacity, second.opacity, share)
    return _together(first, second, opacity, complement(share), share)


@shader_of("ShaderNodeAddShader", how="as Cycles, of whatever is read",
           instead="what is added to a Transparent BSDF neither stops light nor shows")  # fmt: skip
def _add_shader(at: At) -> Closure:
    first = closure_at(at.graph, at.socket("Shader"), at.path)
    second = closure_at(at.graph, at.socket("Shader_001"), at.path)
    # What comes through adds up: 1 - ((1 - a) + (1 - b)).
    if first.opacity.equals(1.0) or second.opacity.equals(1.0):
        opacity = second.opacity if first.opacity.equals(1.0) else first.opacity
    else:
        opacity = saturated(
            apply("added opacity", FLOAT, lambda a, b: a + b - 1.0, first.opacity, second.opacity)
        )
    added = _together(first, second, opacity, _ONE, _ONE)
    if opacity.equals(0.0) and not (first.is_clear and second.is_clear):
        at.graph.tell(f"node '{at.node.name}' adds light to a surface that is clear: it is not read")
    return added


def _together(first: Closure, second: Closure, opacity: Value, a: Value, b: Value) -> Closure:
    """Two closures, `a` of the first and `b` of the second."""
    if first.is_clear or second.is_clear:
        return replace(first if second.is_clear else second, opacity=opacity)
    is_mix = not (a.equals(1.0) and b.equals(1.0))
    shares = (product(a, first.opacity), product(b, second.opacity), opacity)

    def mean(one: Value, other: Value) -> Value:
        return one if is_mix and one.key == other.key else _mean(one, other, *shares)

    bases, metallic = (first.base, second.base), first.metallic
    if first.metallic.key != second.metallic.key:
        # What is left is diffuse light alone.
        bases = (
            product(first.base, complement(first.metallic)),
            product(second.base, complement(second.metallic)),
        )
        metallic = _NOTHING
    return Closure(
        opacity,
        mean(*bases),
        mean(first.emission, second.emission),
        metallic,
        mean(first.holdout, second.holdout),
    )


def _mean(first: Value, second: Value, a: Value, b: Value, whole: Value) -> Value:
    """(a first + b second) / whole."""
    return quotient(total(product(first, a), product(second, b)), whole)
