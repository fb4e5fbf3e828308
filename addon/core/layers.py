"""What a bake makes: named images with their cost and their error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .roles import THE_IMAGE, Of

COLOUR_CHANNELS = ("RGB", "RGBA")


@dataclass(frozen=True, eq=False)
class Layer:
    """One image.

    `channels` names them in order, one letter each ("V", "RGBA", "XYZ"). `pixels` is float32, (height, width)
    for one channel and (height, width, channels) for more; row 0 is the bottom row. C-contiguous, or a view
    with no strides of one value (np.broadcast_to), which costs no memory and next to nothing to write.
    `of`: the lamp that it is of, or what else; `light` is that lamp's own name. `error` is the report's entry
    for this layer, `settings` the effect's parameters as plain values, `weight` what its samples weighed
    (PlannedLayer.weighed_by), `samples` how many a pixel has, and `placement` where
    (Placement in core/placement.py), empty where nobody sampled.
    `view_layer` is where it belongs, empty for the set's; `attributes`: what the file says of an image that
    is of no effect.
    """

    name: str
    channels: str
    pixels: np.ndarray
    effect: str
    light: str = ""
    of: Of = THE_IMAGE
    seconds: float = 0.0
    error: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    view_layer: str = ""
    weight: str = "none"
    placement: str = ""
    samples: int = 0
    attributes: dict[str, str | float] = field(default_factory=dict)

    def __post_init__(self):
        depth = () if len(self.channels) == 1 else (len(self.channels),)
        if self.pixels.dtype != np.float32 or self.pixels.ndim < 2 or self.pixels.shape[2:] != depth:
            raise ValueError(
                f"layer '{self.name}': {self.pixels.dtype} {self.pixels.shape} is not float32 {self.channels}"
            )

    @property
    def is_colour(self) -> bool:
        """Whether the numbers are light in the working space; if not, they are data that no colour
        management may touch."""
        return self.channels in COLOUR_CHANNELS

    @property
    def fits_half(self) -> bool:
        """Whether 16 bits a number do for it: colours and masks, but no depths, places or ids."""
        return self.is_colour or self.channels == "V"

    def planes(self) -> Iterator[tuple[str, np.ndarray]]:
        """Each channel's letter and its (height, width) view."""
        pixels = self.pixels if self.pixels.ndim == 3 else self.pixels[:, :, None]
        for index, letter in enumerate(self.channels):
            yield letter, pixels[:, :, index]


@dataclass(frozen=True, eq=False)
class LayerSet:
    """All layers of one bake, of one size. `working_space` is the scene's ("Linear Rec.709", ...), `report`
    what `--report` writes; `pixel_aspect` is a pixel's width over its height. `region`: x0, y0, x1, y1 in
    pixels from the frame's bottom left, the part of it that was computed, None for all of it; `frame_size`
    is the whole frame's where the layers show only the region, None where they show the frame. `stamp`: what
    Blender says in the header of a render. `error_images`: how far layers are off, for whoever wants to look:
    nothing of the picture."""

    layers: tuple[Layer, ...]
    width: int
    height: int
    view_layer: str
    working_space: str = "Linear Rec.709"
    report: dict[str, Any] = field(default_factory=dict)
    pixel_aspect: float = 1.0
    region: tuple[int, int, int, int] | None = None
    frame_size: tuple[int, int] | None = None
    stamp: dict[str, str] = field(default_factory=dict)
    error_images: tuple[Layer, ...] = ()

    @property
    def images(self) -> tuple[Layer, ...]:
        """All that there is to keep."""
        return (*self.layers, *self.error_images)

    @property
    def is_cropped(self) -> bool:
        """Whether the layers show only the region."""
        return self.frame_size is not None

    def __post_init__(self):
        for layer in self.images:
            if layer.pixels.shape[:2] != (self.height, self.width):
                raise ValueError(f"layer '{layer.name}' is not {self.width} x {self.height}")
