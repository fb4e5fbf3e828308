"""Images of tiles (UDIM), laid out as one."""

from __future__ import annotations

import os
from dataclasses import dataclass
from hashlib import sha256

import bpy
import imbuf
import numpy as np

# As Cycles shows a tile that is not there.
_MISSING = (1.0, 0.0, 1.0, 1.0)


@dataclass(frozen=True)
class TileRange:
    """Where an image's tiles lie: the first column and row in units of UV, and how many there are."""

    column: int
    row: int
    columns: int
    rows: int


def range_of(image: bpy.types.Image) -> TileRange:
    places = [_place(tile.number) for tile in image.tiles]
    columns, rows = zip(*places, strict=True)
    return TileRange(min(columns), min(rows), max(columns) - min(columns) + 1, max(rows) - min(rows) + 1)


def _place(number: int) -> tuple[int, int]:
    """Column and row of a tile's number."""
    return (number - 1001) % 10, (number - 1001) // 10


def unreadable_tile(image: bpy.types.Image) -> str:
    """Why one of the tiles cannot be read; empty where nothing speaks against them."""
    for tile in image.tiles:
        path = _path(image, tile.number)
        if _packed(image, path) is None and not os.path.isfile(path):
            return f"its tile {tile.number} is not in a file"
    return ""


def _path(image: bpy.types.Image, number: int) -> str:
    column, row = _place(number)
    path = image.filepath.replace("<UDIM>", str(number)).replace("<UVTILE>", f"u{column + 1}_v{row + 1}")
    return bpy.path.abspath(path, library=image.library)


def _packed(image: bpy.types.Image, path: str) -> bytes | None:
    for packed in image.packed_files:
        if os.path.basename(packed.filepath) == os.path.basename(path) and packed.packed_file is not None:
            return packed.packed_file.data
    return None


def tiled_pixels(image: bpy.types.Image, most: int) -> np.ndarray | None:
    """(H, W, 4) f32 like `pixels_of`, at most about `most` texels a side, each tile as large as the largest;
    None where one cannot be loaded."""
    extent = range_of(image)
    tiles = {tile.number: _tile(image, tile.number) for tile in image.tiles}
    if any(pixels is None for pixels in tiles.values()):
        return None
    height = max(pixels.shape[0] for pixels in tiles.values())
    width = max(pixels.shape[1] for pixels in tiles.values())
    height = max(min(height, most // extent.rows), 1)
    width = max(min(width, most // extent.columns), 1)
    whole = np.full((extent.rows * height, extent.columns * width, 4), _MISSING, np.float32)
    for number, pixels in tiles.items():
        column, row = _place(number)
        top, left = (row - extent.row) * height, (column - extent.column) * width
        rows = (np.arange(height) + 0.5) / height * pixels.shape[0]
        columns = (np.arange(width) + 0.5) / width * pixels.shape[1]
        whole[top : top + height, left : left + width] = pixels[np.ix_(rows.astype(int), columns.astype(int))]
    return whole


def tiles_content(image: bpy.types.Image) -> tuple:
    """Differs wherever `tiled_pixels` may: it reads files, which is not done again to see that."""
    found = []
    for tile in image.tiles:
        path = _path(image, tile.number)
        packed = _packed(image, path)
        try:
            held = (
                (os.stat(path).st_mtime_ns, os.stat(path).st_size)
                if packed is None
                else sha256(packed).digest()
            )
        except OSError:
            held = None
        found.append((tile.number, path, held))
    return tuple(found)


def _tile(image: bpy.types.Image, number: int) -> np.ndarray | None:
    path = _path(image, number)
    try:
        packed = _packed(image, path)
        loaded = imbuf.load(path) if packed is None else imbuf.load_from_buffer(packed)
    except (OSError, ValueError):
        return None
    with loaded.with_buffer() as buffer:
        found = np.array(buffer)
    pixels = found.astype(np.float32) / (255.0 if found.dtype == np.uint8 else 1.0)
    if pixels.shape[2] < 3:
        pixels = np.repeat(pixels[..., :1], 3, axis=2)
    whole = np.ones((*pixels.shape[:2], 4), np.float32)
    whole[..., : pixels.shape[2]] = pixels
    return whole
