"""What Blender has baked of a node's output over a mesh, as a texture that expressions look up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .values import FLOAT, VECTOR, Uv, Value, apply, constant, looked_up, variable

BAKED_MAP = "\x00baked"
"""The UV map that textures are baked in. It is made for that (exact/layout.py) and no mesh of the scene has
it: no name in Blender holds such a character."""


@dataclass(frozen=True, eq=False)
class BakedTexture:
    """`values` (H, W, 1 or 3) f32, row 0 at the bottom, None while it is not baked; `size` is width and
    height. `key` is of all that they hang on."""

    name: str
    key: str
    size: tuple[int, int]
    values: np.ndarray | None
    image: ClassVar[None] = None
    extension: ClassVar[str] = "EXTEND"
    interpolation: ClassVar[str] = "Linear"

    @property
    def words(self) -> str:
        return f"node '{self.name}'"

    def colours(self, _load) -> tuple[np.ndarray | None, str]:
        return self.values, ""

    def value(self, kind: str) -> Value:
        """As an expression; a constant where it is the same everywhere. Of a float the innermost part is
        between 0 and 1, as an image's is, so that steps on it are found (opacities.py)."""
        texel = looked_up(self, variable(VECTOR, Uv(BAKED_MAP)))
        if self.values is None:
            if kind == FLOAT:
                return apply("baked", kind, lambda t: t[..., 0], texel)
            return apply(f"baked {kind}", kind, lambda t: t, texel)
        low, high = float(self.values.min()), float(self.values.max())
        if (self.values == self.values[:1, :1]).all():
            numbers = self.values[0, 0].tolist()
            return constant(kind, numbers[0] if kind == FLOAT else numbers)
        if kind != FLOAT:
            return apply(f"baked {kind}", kind, lambda t: t, texel, low=low, high=high)
        span = high - low
        unit = apply("baked", kind, lambda t: (t[..., 0] - low) / span, texel, low=0.0, high=1.0)
        return apply("scaled", kind, lambda u: low + span * u, unit, low=low, high=high)
