"""Lamps, in Blender's units as Cycles reads them (its `scene/light.cpp` and `kernel/light/*.h`).

Radiance of a light of power P, `normalize` on: area P / (pi A); point and spot P / (4 pi² r²), that is
intensity P / (4 pi) whatever the radius; sun E / (pi sin² half angle), that is irradiance E. With it off the
area (A, 4 pi r², pi sin²) becomes 1. P is times 2^exposure, colour, temperature and what its nodes emit.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

from ..core.emitter import Emitter, EmitterKind
from ..core.material import Colour
from ..core.outline import Light
from .nodes import readers  # noqa: F401 (what reads the nodes of inputs)
from .nodes.closures import closure_at
from .nodes.graph import Graph, link_of, origins
from .own_settings import casts_shadow
from .transforms import LARGEST, are_finite, as_vector, matrix_of

# Below this an area light's spread is raised to it: the normalisation 1 / (tan x - x) has no digits left.
_SMALLEST_SPREAD = math.radians(0.1)
# A sun of half a turn would be a disk at infinity.
_LARGEST_SUN_ANGLE = math.radians(179.0)


def light_of(light: bpy.types.Light, matrix, name: str, key: str) -> tuple[Light | None, list[str]]:
    """A light and warnings; None for a light that is left out (the warnings say why)."""
    matrix = matrix_of(matrix)
    if not are_finite(matrix):
        return None, [f"light '{name}' is left out: its matrix is not finite"]
    if light.type == "AREA" and hasattr(light, "cycles") and light.cycles.is_portal:  # with its add-on
        return None, [f"light '{name}' is left out: it is a portal"]
    axes, scale, warnings = _axes(matrix, name)
    emitter, factor, more = _emitter(light, matrix, axes, scale, name)
    strength, node_warnings = _strength(light, name)
    intensity = tuple(float(factor * s) for s in strength)
    warnings += more + node_warnings
    if not all(map(math.isfinite, intensity)):
        return None, [f"light '{name}' is left out: its power is not finite"]
    if max(map(abs, intensity)) > LARGEST:
        return None, [f"light '{name}' is left out: its power is more than single precision holds"]
    return Light(name, key, light.type, emitter, intensity, casts_shadow(light)), warnings


def _axes(matrix: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Rows right, up, forward, orthonormal; the scale along x, y, z; warnings."""
    columns = matrix[:3, :3].T
    scale = np.linalg.norm(columns, axis=1)
    forward = -columns[2] / scale[2] if scale[2] > 0.0 else np.array([0.0, 0.0, -1.0])
    right = columns[0] / scale[0] if scale[0] > 0.0 else np.zeros(3)
    straight = right - forward * (right @ forward)
    length = np.linalg.norm(straight)
    if length < 1e-6:
        other = np.eye(3)[np.argmin(np.abs(forward))]
        straight = other - forward * (other @ forward)
        length = np.linalg.norm(straight)
    straight /= length
    up = np.cross(straight, forward)
    if up @ columns[1] < 0.0:
        up = -up
    units = columns / np.maximum(scale, 1e-300)[:, None]
    skew = max(abs(units[0] @ units[1]), abs(units[1] @ units[2]), abs(units[0] @ units[2]))
    warnings = [f"light '{name}' is sheared: it is taken as straight"] if skew > 1e-3 and scale.all() else []
    return np.array([straight, up, forward]), scale, warnings


def _emitter(
    light: bpy.types.Light, matrix: np.ndarray, axes: np.ndarray, scale: np.ndarray, name: str
) -> tuple[Emitter, float, list[str]]:
    """The shape, intensity over strength, and warnings."""
    centre = as_vector(matrix[:3, 3])
    right, up, forward = (as_vector(axis) for axis in axes)
    place = {"centre": centre, "right": right, "up": up, "forward": forward}
    if light.type == "SUN":
        half = 0.5 * min(light.angle, _LARGEST_SUN_ANGLE)
        tangent = math.tan(half)
        factor = 1.0 if light.normalize or half == 0.0 else math.pi * math.sin(half) ** 2
        emitter = Emitter(EmitterKind.DISTANT_DISK, **place, half_width=tangent, half_height=tangent)
        return emitter, factor, []
    if light.type == "AREA":
        width = light.size * scale[0]
        height = (light.size_y if light.shape in {"RECTANGLE", "ELLIPSE"} else light.size) * scale[1]
        is_round = light.shape in {"DISK", "ELLIPSE"}
        kind = EmitterKind.ELLIPSE if is_round else EmitterKind.RECTANGLE
        area = width * height * (0.25 * math.pi if is_round else 1.0)
        # Cycles leaves out area lights of no size.
        factor = 0.0 if area <= 0.0 else (1.0 if light.normalize else area) / math.pi
        half_spread = 0.5 * max(light.spread, _SMALLEST_SPREAD)
        tangent = math.inf if half_spread > 0.5 * math.pi - 1e-6 else math.tan(half_spread)
        emitter = Emitter(
            kind, **place, half_width=0.5 * width, half_height=0.5 * height, tan_half_spread=tangent
        )
        return emitter, factor, []
    # Points and spots; an object's scale does not change their radius.
    radius = float(light.shadow_soft_size)
    soft = light.use_soft_falloff or radius == 0.0
    kind = EmitterKind.FACING_DISK if soft else EmitterKind.SPHERE
    # Cycles takes an area of 4 where there is none.
    factor = 0.25 / math.pi if light.normalize else (radius * radius if radius > 0.0 else 1.0 / math.pi)
    cone, warnings = {}, []
    if light.type == "SPOT":
        # The cone lives in the light's own, scaled space: it widens by x and y over z.
        tangent = math.tan(0.5 * min(light.spot_size, math.pi - 1e-6))
        if scale.all():
            tangent *= math.sqrt(scale[0] * scale[1]) / scale[2]
        if abs(scale[0] - scale[1]) > 1e-3 * max(scale):
            warnings.append(f"spot light '{name}' has an elliptic cone (scale x and y): it is taken as round")
        elif abs(scale[0] - scale[2]) > 1e-3 * max(scale) and light.spot_blend > 0.0:
            warnings.append(f"spot light '{name}' is stretched (scale z): its blend is approximate")
        cone = {"cos_cone": 1.0 / math.hypot(1.0, tangent), "blend": float(light.spot_blend)}
    return Emitter(kind, **place, half_width=radius, half_height=radius, **cone), factor, warnings


def _strength(light: bpy.types.Light, name: str) -> tuple[Colour, list[str]]:
    """Colour times power, linear in the working space, and warnings."""
    emission, warnings = _emission(light)
    with np.errstate(over="ignore", invalid="ignore"):  # whoever asks looks whether it is finite
        strength = np.array(light.color[:], np.float64) * light.energy * np.exp2(light.exposure)
        if light.use_temperature:
            strength = strength * light.temperature_color[:]
        strength = strength * emission
    return as_vector(strength), [f"light '{name}': {warning}" for warning in warnings]


def _emission(light: bpy.types.Light) -> tuple[np.ndarray, list[str]]:
    """(3,) what its nodes multiply it by, and what of them is not read."""
    if light.node_tree is None:
        return np.ones(3), []
    output = light.node_tree.get_output_node("CYCLES")
    if output is None or link_of(output.inputs["Surface"]) is None:
        return np.zeros(3), []
    graph = Graph()
    closure = closure_at(graph, output.inputs["Surface"])
    warnings = [f"{warning}: the light shines evenly" for warning in graph.warnings]
    if closure.opacity.unread or not closure.emission.is_constant:
        unread = closure.opacity if closure.opacity.unread else closure.emission
        return np.ones(3), [f"{origins(unread)} not read, the light shines evenly"]
    return closure.emission.constant, warnings
