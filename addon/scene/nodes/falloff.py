"""Light Falloff, of lamps."""

from __future__ import annotations

from .graph import At
from .registry import value_of
from .values import Value


@value_of(
    "ShaderNodeLightFalloff",
    how="Quadratic without Smooth, which is how light falls off",
    instead="all else is taken as that",
)
def _light_falloff(at: At, output) -> Value:
    if output.identifier != "Quadratic" or not at.input("Smooth").equals(0.0):
        at.graph.tell(f"node '{at.node.name}': light falls off with the square of distance, not as it says")
    return at.input("Strength")
