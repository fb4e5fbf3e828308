"""Nodes whose answer hangs on who looks from where: Light Path and Geometry."""

from __future__ import annotations

from .graph import At
from .registry import value_of
from .values import FLOAT, VECTOR, Value, number

_RAYS = ("Is Diffuse Ray", "Is Glossy Ray", "Is Singular Ray", "Is Reflection Ray", "Is Transmission Ray",
         "Is Volume Scatter Ray", "Ray Depth", "Diffuse Depth", "Glossy Depth", "Transparent Depth",
         "Transmission Depth", "Portal Depth")  # fmt: skip


@value_of(
    "ShaderNodeLightPath",
    how="Is Camera Ray and Is Shadow Ray, so that cameras and shadows may meet different surfaces; 0 for all "
    "other rays and for depths, as where a camera looks straight at it",
    instead="Ray Length is not read; what bounced rays meet is not either",
)
def _light_path(at: At, output) -> Value:
    name = output.identifier
    if name in _RAYS:
        return number(0.0)
    if name not in {"Is Camera Ray", "Is Shadow Ray"}:
        return at.unread(FLOAT, name)
    at.graph.asked.add("ray")
    return number(float(at.graph.situation.is_shadow == (name == "Is Shadow Ray")))


@value_of("ShaderNodeNewGeometry", how="Backfacing", instead="no other output is read")
def _geometry(at: At, output) -> Value:
    if output.identifier != "Backfacing":
        return at.unread(FLOAT if output.type == "VALUE" else VECTOR, output.name)
    at.graph.asked.add("side")
    return number(float(at.graph.situation.is_back))
