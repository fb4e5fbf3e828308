"""Pixels of OpenEXR files, as renders and bakes write them.

By hand, for the reasons that openexr.py writes by hand for; what is compressed in other ways than it writes
is read by OpenImageIO, where that is there.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from ..core.errors import StrataError
from . import openimageio
from .exr_header import PartHeader, header_of

_ROWS = {0: 1, 2: 1, 3: 16}
"""Scan lines in a block: not compressed, ZIPS, ZIP."""
_TYPES = ("<u4", "<f2", "<f4")


def read_pixels(path: Path) -> dict[str, np.ndarray]:
    """(height, width) float32 by channel's full name, row 0 at the bottom. Raises StrataError for a file that
    is not there, is none of OpenEXR, or is cut off; and, where OpenImageIO is not there, for one that has
    anything but scan lines with ZIP or without compression."""
    header = header_of(path)
    if any(part.is_tiled or part.compression not in _ROWS for part in header.parts):
        return openimageio.read_planes(path)
    data = path.read_bytes()
    lead = 12 if header.is_multi_part else 8  # a block's part, its row, its bytes
    start, planes = header.end, {}
    try:
        for part in header.parts:
            count = -(-part.height // _ROWS[part.compression])
            offsets = struct.unpack_from(f"<{count}Q", data, start)
            start += 8 * count
            own = _planes(part, [_block(data, offset + lead) for offset in offsets])
            if twice := own.keys() & planes.keys():
                raise StrataError(f"cannot read {path}: two of its parts have a channel {min(twice)}")
            planes |= own
    except (ValueError, IndexError, struct.error, zlib.error):
        raise StrataError(f"{path} is no whole OpenEXR file") from None
    return planes


def _block(data: bytes, offset: int) -> tuple[int, bytes]:
    """Its first row, and its bytes."""
    row, count = struct.unpack_from("<ii", data, offset - 8)
    if count < 0 or offset + count > len(data):
        raise ValueError
    return row, data[offset : offset + count]


def _planes(part: PartHeader, blocks: list[tuple[int, bytes]]) -> dict[str, np.ndarray]:
    width, height, first = part.width, part.height, part.data_window[1]
    types = [np.dtype(_TYPES[kind]) for kind in part.types]
    stride = width * sum(kind.itemsize for kind in types)
    planes = {name: np.empty((height, width), np.float32) for name in part.channels}
    for row, packed in blocks:
        rows = min(_ROWS[part.compression], height - (row - first))
        block = packed if len(packed) == rows * stride else _inflated(packed)
        if rows < 1 or len(block) != rows * stride:
            raise ValueError
        for number in range(rows):
            at = number * stride
            for name, kind in zip(part.channels, types, strict=True):
                values = np.frombuffer(block, kind, width, at)
                planes[name][height - 1 - (row - first + number)] = values
                at += width * kind.itemsize
    return planes


def _inflated(packed: bytes) -> bytes:
    """What openexr.py's compression makes of it: differences, even bytes before odd ones."""
    differences = np.frombuffer(zlib.decompress(packed), np.uint8).copy()
    differences[1:] -= 128
    apart = np.cumsum(differences, dtype=np.uint8)
    found = np.empty_like(apart)
    half = -(-len(apart) // 2)
    found[0::2], found[1::2] = apart[:half], apart[half:]
    return found.tobytes()
