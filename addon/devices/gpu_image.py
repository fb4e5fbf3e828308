"""Arrays as textures. Integers are R32UI in two's complement, which every backend reads back exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

TABLE_WIDTH = 4096  # texels in a row of a table; tables.glsl has the same number


@dataclass(eq=False)
class GpuImage:
    """An array on the GPU; row 0 of a texture is the array's first row.

    `shape` and `dtype` are the array's: (height, width), (height, width, 2 to 4), or (layers, height,
    width). Layers lie side by side, `columns` of them in a row, since array textures cannot be read back.
    """

    texture: Any  # gpu.types.GPUTexture; None once released
    shape: tuple[int, ...]
    dtype: np.dtype
    columns: int = 1

    @property
    def is_stack(self) -> bool:
        return len(self.shape) == 3 and self.shape[2] > 4

    @property
    def channels(self) -> int:
        return self.shape[2] if len(self.shape) == 3 and not self.is_stack else 1

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the texture."""
        return texture_size(self.shape, self.columns)

    @property
    def nbytes(self) -> int:
        """What the texture takes."""
        width, height = self.size
        return width * height * 4 * (4 if self.channels == 3 else self.channels)

    @property
    def format(self) -> str:
        return texture_format(self.dtype, self.channels)


def texture_format(dtype: np.dtype, channels: int) -> str:
    """The format that holds `channels` numbers of `dtype` a texel. Raises TypeError where there is none."""
    if dtype == np.float32:
        return {1: "R32F", 2: "RG32F", 3: "RGBA32F", 4: "RGBA32F"}[channels]
    if dtype.kind in "iub" and dtype.itemsize <= 4 and channels != 3:
        return {1: "R32UI", 2: "RG32UI", 4: "RGBA32UI"}[channels]
    raise TypeError(f"no texture holds {channels} x {dtype}")


def stack_columns(shape: tuple[int, int, int], largest: int) -> int:
    """How many layers to put side by side so that (layers, height, width) fits in a texture. Raises
    ValueError where it does not."""
    layers, height, width = shape
    columns = -(-layers // max(1, largest // height))
    if width * columns > largest or height > largest:
        raise ValueError(f"{layers} layers of {width} x {height} do not fit in a texture of {largest}")
    return columns


def texture_size(shape: tuple[int, ...], columns: int) -> tuple[int, int]:
    """Width and height of the texture that holds an array of this shape."""
    if len(shape) == 3 and shape[2] > 4:
        layers, height, width = shape
        return width * columns, height * -(-layers // columns)
    return shape[1], shape[0]


def to_texels(array: np.ndarray, columns: int) -> np.ndarray:
    """The texture's texels (height, width, components) float32 or (height, width) of the array's dtype."""
    if array.ndim == 3 and array.shape[2] > 4:
        layers, height, width = array.shape
        rows = -(-layers // columns)
        padded = np.zeros((rows * columns, height, width), array.dtype)
        padded[:layers] = array
        tiles = padded.reshape(rows, columns, height, width).transpose(0, 2, 1, 3)
        return np.ascontiguousarray(tiles).reshape(rows * height, columns * width)
    if array.ndim == 3 and array.shape[2] == 3:
        return np.concatenate([array, np.zeros((*array.shape[:2], 1), array.dtype)], axis=2)
    return np.ascontiguousarray(array)


def from_texels(texels: np.ndarray, image: GpuImage) -> np.ndarray:
    """The inverse of `to_texels`, as an array of its own."""
    if image.dtype != np.float32:
        texels = texels.view(np.int32).astype(image.dtype, copy=False)
    if image.is_stack:
        layers, height, width = image.shape
        rows = image.size[1] // height
        tiles = texels.reshape(rows, height, image.columns, width).transpose(0, 2, 1, 3)
        return np.ascontiguousarray(tiles.reshape(-1, height, width)[:layers])
    texels = texels.reshape(image.size[1], image.size[0], -1)[..., : image.channels]
    return np.array(texels.reshape(image.shape), image.dtype)
