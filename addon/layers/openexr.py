"""Writes OpenEXR files: one or several parts of float32 or float16 scan lines, ZIP compressed.

By hand (https://openexr.com/en/latest/OpenEXRFileLayout.html), because there is no library that every
Blender has: the OpenEXR wheel and a Blender program cannot share a process (the wheel exports its C
functions, so that the loader binds its calls to the library of another version that Blender brings, and every
compressor of it then reports EXR_ERR_ARGUMENT_OUT_OF_RANGE: wheel 3.5.3 in Debian's Blender 5.2.2), and
Debian's Blender comes without OpenImageIO. The tests read with both libraries.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import batched, repeat
from typing import BinaryIO

import numpy as np

_MAGIC = b"\x76\x2f\x31\x01"
_VERSION, _LONG_NAMES, _MULTI_PART = 2, 0x400, 0x1000
_HALF, _FLOAT, _ZIP = 1, 2, 3
_ZIP_ROWS = 16  # scan lines in a block of ZIP compression
_ZLIB_LEVEL = 4  # OpenEXR's own default
_BLOCKS_AHEAD = 64  # compressed ones that wait to be written


@dataclass(frozen=True, eq=False)
class Part:
    """One image. `channels`: (height, width) float32 by name, top row first; those of `half` are kept as
    float16. `attributes`: text, or a number that is kept as float32. `offset`: of its top left pixel (x, y)
    in a frame of `frame_size` (width, height), which is as large as the image where there is none. `name` is
    empty for the one part of a file that needs none."""

    name: str
    channels: dict[str, np.ndarray]
    attributes: dict[str, str | float] = field(default_factory=dict)
    pixel_aspect: float = 1.0
    offset: tuple[int, int] = (0, 0)
    frame_size: tuple[int, int] | None = None
    half: frozenset[str] = frozenset()

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return next(iter(self.channels.values())).shape

    @property
    def block_count(self) -> int:
        return -(-self.shape[0] // _ZIP_ROWS)

    @property
    def is_constant(self) -> bool:
        """Whether each channel is known to have one value."""
        return not any(any(plane.strides) for plane in self.channels.values())


def write_parts(stream: BinaryIO, parts: list[Part]) -> None:
    """Writes a whole file to a seekable stream. Blocks are compressed on all cores."""
    is_multi = len(parts) > 1
    stream.write(_MAGIC + struct.pack("<i", _VERSION | _LONG_NAMES | (_MULTI_PART if is_multi else 0)))
    for part in parts:
        stream.write(_header(part))
    if is_multi:
        stream.write(b"\0")
    table = stream.tell()
    stream.write(bytes(8 * sum(part.block_count for part in parts)))  # where the blocks are: known at the end
    offsets = []
    with ThreadPoolExecutor(os.process_cpu_count()) as pool:
        try:
            for index, part in enumerate(parts):
                prefix = struct.pack("<i", index) if is_multi else b""
                for number, block in enumerate(_blocks(part, pool)):
                    offsets.append(stream.tell())
                    row = part.offset[1] + number * _ZIP_ROWS
                    stream.write(prefix + struct.pack("<ii", row, len(block)) + block)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    end = stream.tell()
    stream.seek(table)
    stream.write(struct.pack(f"<{len(offsets)}Q", *offsets))
    stream.seek(end)


def _header(part: Part) -> bytes:
    height, width = part.shape
    (left, top), (frame_width, frame_height) = part.offset, part.frame_size or (width, height)
    data_window = struct.pack("<4i", left, top, left + width - 1, top + height - 1)
    display_window = struct.pack("<4i", 0, 0, frame_width - 1, frame_height - 1)
    channels = b"".join(
        _text(name) + b"\0" + struct.pack("<iB3xii", _HALF if name in part.half else _FLOAT, 0, 1, 1)
        for name in sorted(part.channels)
    )
    attributes = [
        ("channels", "chlist", channels + b"\0"),
        ("compression", "compression", bytes([_ZIP])),
        ("dataWindow", "box2i", data_window),
        ("displayWindow", "box2i", display_window),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", part.pixel_aspect)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1.0)),
        ("type", "string", b"scanlineimage"),
        ("chunkCount", "int", struct.pack("<i", part.block_count)),
    ]
    if part.name:
        attributes.append(("name", "string", _text(part.name)))
    for name, value in part.attributes.items():
        is_text = isinstance(value, str)
        attributes.append(
            (name, "string" if is_text else "float", _text(value) if is_text else struct.pack("<f", value))
        )
    return b"".join(
        _text(name) + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data
        for name, kind, data in attributes
    ) + b"\0"  # fmt: skip


def _text(text: str) -> bytes:
    return text.encode(errors="replace")


def _blocks(part: Part, pool: ThreadPoolExecutor) -> Iterator[bytes]:
    """Compressed, in order. Those of an image of one value are alike: only one is worked at."""
    height = part.shape[0]
    if not part.is_constant:
        for rows in batched(range(0, height, _ZIP_ROWS), _BLOCKS_AHEAD, strict=False):
            yield from pool.map(partial(_block, part), rows)
        return
    whole, rest = divmod(height, _ZIP_ROWS)
    if whole:
        yield from repeat(_block(part, 0), whole)
    if rest:
        yield _block(part, whole * _ZIP_ROWS)


def _block(part: Part, first: int) -> bytes:
    """16 scan lines from row `first` on: row by row, and in a row channel by channel, sorted by name."""
    planes = [
        np.ascontiguousarray(
            part.channels[name][first : first + _ZIP_ROWS], "<f2" if name in part.half else "<f4"
        ).view(np.uint8)
        for name in sorted(part.channels)
    ]
    return _compressed(np.concatenate(planes, axis=1).reshape(-1))


def _compressed(block: np.ndarray) -> bytes:
    """Even bytes before odd ones, then differences, then deflate; as it is where that is no smaller."""
    apart = np.concatenate([block[0::2], block[1::2]])
    differences = apart.copy()
    differences[1:] -= apart[:-1]
    differences[1:] += 128
    packed = zlib.compress(differences, _ZLIB_LEVEL)
    return packed if len(packed) < len(block) else block.tobytes()
