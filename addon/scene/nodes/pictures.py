"""Expressions over texture coordinates as pictures: where they lie, how large, and their texels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import bpy
import numpy as np

from ..pixels import LARGEST, channel_of
from .baked import BakedTexture
from .textures import Loader, Texture
from .values import COLOUR, Source, Uv, Value

Matrix = tuple[float, float, float, float, float, float]
IDENTITY: Matrix = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
"""Two rows of three: from coordinates of a UV map to those of pictures."""

WITHOUT_IMAGES = 512  # where there is no image to go by
CLOSEST = 4  # texels to one of an image that is not interpolated: bilinear, they blur an eighth of it
_CHUNK = 1 << 18  # texels at a time


@dataclass(frozen=True)
class Placement:
    """Where all pictures of a material lie: on which UV map (empty: the one for rendering), moved by what."""

    uv_map: str = ""
    matrix: Matrix = IDENTITY


def placement_of(values: Iterable[Value]) -> tuple[Placement, list[str]]:
    """That in which most is exact, and warnings."""
    parts = {id(part): part for value in values for part in value.parts()}.values()
    maps = sorted({source.name for part in parts for source in part.sources if isinstance(source, Uv)})
    warnings = []
    if len(maps) > 1:
        named = ", ".join(f"'{name}'" for name in maps if name)
        warnings.append(f"UV maps {named} are read as one")
    found = {affine(part.inputs[0]) for part in parts if part.texture is not None}
    matrix = next(iter(found)) if len(found) == 1 else None
    if matrix is None or abs(np.linalg.det(_square(matrix)[:2, :2])) < 1e-9:
        matrix = IDENTITY
    return Placement(maps[0] if maps else "", matrix), warnings


class _Points:
    """As texture coordinates, and nothing else."""

    def __init__(self, uv: np.ndarray):
        self._uv = np.concatenate([uv, np.zeros((len(uv), 1))], axis=1)

    def source(self, source: Source) -> np.ndarray:
        if not isinstance(source, Uv):
            raise LookupError(source)
        return self._uv

    def look_up(self, texture: Texture, coordinates: np.ndarray) -> np.ndarray:
        raise LookupError(texture)


def affine(coordinates: Value) -> Matrix | None:
    """The matrix that texture coordinates are moved by; None where they are bent."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.37, 0.71], [-1.3, 2.9]])
    try:
        moved = np.broadcast_to(coordinates.at(_Points(points)), (len(points), 3))[:, :2]
    except LookupError:
        return None
    linear = np.stack([moved[1] - moved[0], moved[2] - moved[0]], axis=1)
    expected = points @ linear.T + moved[0]
    if not np.isfinite(moved).all() or np.abs(expected - moved).max() > 1e-9 * (1.0 + np.abs(moved).max()):
        return None
    # Sines of float32 angles leave dust.
    rows = np.round(np.concatenate([linear, moved[:1].T], axis=1), 7) + 0.0
    return tuple(rows.ravel().tolist())


def _square(matrix: Matrix) -> np.ndarray:
    return np.array([matrix[:3], matrix[3:], (0.0, 0.0, 1.0)])


@dataclass(frozen=True, eq=False)
class Picture:
    """An expression over texture coordinates, 'float' or 'colour', as it lies in a material's placement."""

    value: Value
    placement: Placement

    @property
    def key(self) -> str:
        """The same for equal ones; of what their images hold, it tells nothing."""
        return f"{self.value.key}#{self.value.kind}#{self.placement}"

    @property
    def images(self) -> list[bpy.types.Image]:
        """All that it looks up, each once."""
        images = (part.texture.image for part in self._lookups() if part.texture.image is not None)
        return list({image.session_uid: image for image in images}.values())

    @property
    def names(self) -> list[str]:
        return sorted({part.texture.name for part in self._lookups()})

    def _lookups(self) -> Iterator[Value]:
        return (part for part in self.value.parts() if part.texture is not None)

    def _relative(self, lookup: Value) -> np.ndarray | None:
        """(3, 3): from the picture's coordinates to a texture's."""
        matrix = affine(lookup.inputs[0])
        return None if matrix is None else _square(matrix) @ np.linalg.inv(_square(self.placement.matrix))

    @property
    def repeats(self) -> bool:
        """Whether it is the same in every unit square."""
        stack, seen = [self.value], set()
        while stack:
            part = stack.pop()
            if id(part) in seen:
                continue
            seen.add(id(part))
            if part.texture is not None:
                relative = self._relative(part)
                if part.texture.extension != "REPEAT" or relative is None:
                    return False
                linear = relative[:2, :2]
                if np.abs(linear - np.round(linear)).max() > 1e-6:
                    return False
            elif not part.inputs and not part.is_constant:
                return False
            else:
                stack.extend(part.inputs)
        return True

    def size(self) -> tuple[int, int]:
        """Width and height of its texels: as fine as the finest image in it."""
        if (plain := self._plain()) is not None and plain[0].image.source != "TILED":
            width, height = plain[0].size
            return _fineness(plain[0]) * width, _fineness(plain[0]) * height
        widths, heights = [], []
        for lookup in self._lookups():
            width, height = lookup.texture.size
            relative = self._relative(lookup)
            (a, b), (c, d) = np.abs(np.eye(2) if relative is None else relative[:2, :2])
            fine = _fineness(lookup.texture)
            widths.append(fine * max(a * width, c * height))
            heights.append(fine * max(b * width, d * height))
        if not widths:
            return WITHOUT_IMAGES, WITHOUT_IMAGES
        return tuple(int(min(max(math.ceil(max(n) - 1e-6), 1), LARGEST)) for n in (widths, heights))

    def texels(self, load: Loader) -> tuple[np.ndarray | None, list[str]]:
        """(H, W) f32 of a float, (H, W, 4) f32 of a colour; None where an image cannot be read; warnings."""
        warnings: dict[str, None] = {}
        if (plain := self._plain()) is not None:
            texture, channel = plain
            pixels = load(texture.image)
            if pixels is None:
                return None, [f"image '{texture.name}' cannot be read"]
            texels, warning = channel_of(pixels, texture.image, channel, texture.is_straight)
            if (fine := _fineness(texture)) > 1:
                texels = texels.repeat(fine, axis=0).repeat(fine, axis=1)
            return texels, [warning] if warning else []
        textures = {part.texture.key: part.texture for part in self._lookups()}
        sampled = {}
        for key, texture in textures.items():
            sampled[key], warning = texture.colours(load)
            if sampled[key] is None:
                return None, [warning] if warning else []
            if warning:
                warnings[warning] = None
        width, height = self.size()
        channels = 4 if self.value.kind == COLOUR else 1
        flat = np.ones((width * height, channels), np.float32)
        backwards = np.linalg.inv(_square(self.placement.matrix))
        for start in range(0, width * height, _CHUNK):
            index = np.arange(start, min(start + _CHUNK, width * height))
            places = np.stack(
                [(index % width + 0.5) / width, (index // width + 0.5) / height, np.ones(len(index))], -1
            )
            found = self.value.at(_Texels(places @ backwards.T, sampled))
            found = np.nan_to_num(found, nan=0.0, posinf=0.0, neginf=0.0)
            if channels == 4:
                flat[index, :3] = found
            else:
                flat[index, 0] = found
        shape = (height, width, 4) if channels == 4 else (height, width)
        return flat.reshape(shape), list(warnings)

    def _plain(self) -> tuple[Texture, str] | None:
        """The one image that it is, texel by texel, and what of it."""
        value, channel = self.value, "COLOR" if self.value.kind == COLOUR else "ALPHA"
        if value.name == "luminance":
            value, channel = value.inputs[0], "LUMINANCE"
        if value.name not in {"colour", "alpha"}:
            return None
        (lookup,) = value.inputs
        relative = self._relative(lookup)
        is_aligned = relative is not None and np.abs(relative - np.eye(3)).max() < 1e-6
        return (lookup.texture, channel) if is_aligned else None


def _fineness(texture: Texture) -> int:
    """Texels of a picture to one of an image."""
    is_coarse = texture.interpolation == "Closest" and CLOSEST * max(texture.size) <= LARGEST // 2
    return CLOSEST if is_coarse else 1


class _Texels:
    """The places of some texels: `uv` (N, 3), with 1 behind; images by their texture's key."""

    def __init__(self, uv: np.ndarray, images: dict[str, np.ndarray]):
        self._uv = uv * (1.0, 1.0, 0.0)
        self._images = images

    def source(self, source: Source) -> np.ndarray:
        return self._uv

    def look_up(self, texture: Texture | BakedTexture, coordinates: np.ndarray) -> np.ndarray:
        coordinates = np.broadcast_to(coordinates, (len(self._uv), 3))
        return sample(self._images[texture.key], coordinates[:, :2], texture.extension, texture.interpolation)


def sample(image: np.ndarray, uv: np.ndarray, extension: str, interpolation: str = "Linear") -> np.ndarray:
    """(N, C) float64 of an image (H, W, C), row 0 at the bottom, at `uv` (N, 2); as Cycles
    (kernel/device/cpu/image.h)."""
    height, width = image.shape[:2]
    u, v = np.nan_to_num(uv, posinf=0.0, neginf=0.0).T
    is_closest = interpolation == "Closest"
    shift = 0.0 if is_closest else 0.5
    x, y = u * width - shift, v * height - shift
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)

    def texel(i, j):
        i, outside_i = _extended(i, width, extension)
        j, outside_j = _extended(j, height, extension)
        found = image[j, i].astype(np.float64)
        if extension == "CLIP":
            found[outside_i | outside_j] = 0.0
        return found

    if is_closest:
        return texel(column, row)
    s, t = (x - column)[:, None], (y - row)[:, None]
    low = (1.0 - s) * texel(column, row) + s * texel(column + 1, row)
    high = (1.0 - s) * texel(column, row + 1) + s * texel(column + 1, row + 1)
    return (1.0 - t) * low + t * high


def _extended(index: np.ndarray, count: int, extension: str) -> tuple[np.ndarray, np.ndarray]:
    """Indices within the image, and which were outside of it."""
    outside = (index < 0) | (index >= count)
    if extension == "REPEAT":
        return index % count, outside
    if extension == "MIRROR":
        turned = index % (2 * count)
        return np.where(turned >= count, 2 * count - 1 - turned, turned), outside
    return np.clip(index, 0, count - 1), outside
