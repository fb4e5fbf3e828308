"""What an OpenEXR file says of itself: read without its pixels, so that a panel may ask at every redraw.

By hand, for the reasons that openexr.py writes by hand for.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, BinaryIO

from ..core.errors import StrataError

_MAGIC = b"\x76\x2f\x31\x01"
_MULTI_PART = 0x1000
_LONGEST_NAME = 255  # bytes
_LARGEST_HEADER = 1 << 26  # bytes; a report of ten thousand lamps takes some millions

Box = tuple[int, int, int, int]
"""First column and row, last column and row; both belong to it."""


@dataclass(frozen=True)
class PartHeader:
    """`texts` are attributes of type string, `channels` full names, `types` as the file numbers them (0:
    whole numbers, 1: half, 2: float), and so is `compression`."""

    channels: tuple[str, ...]
    types: tuple[int, ...]
    data_window: Box
    display_window: Box
    texts: dict[str, str]
    compression: int = 0
    is_tiled: bool = False

    @property
    def width(self) -> int:
        """Pixels that there are."""
        return self.data_window[2] - self.data_window[0] + 1

    @property
    def height(self) -> int:
        return self.data_window[3] - self.data_window[1] + 1


@dataclass(frozen=True)
class ExrHeader:
    """`end`: bytes before the table of where the pixels are."""

    parts: tuple[PartHeader, ...]
    is_multi_part: bool = False
    end: int = 0

    @cached_property
    def passes(self) -> dict[str, set[str]]:
        """Names of passes by view layer, as Blender groups `<view layer>.<pass>.<channel>`."""
        found: dict[str, set[str]] = {}
        for part in self.parts:
            for channel in part.channels:
                view_layer, _, name = channel.rpartition(".")[0].rpartition(".")
                found.setdefault(view_layer, set()).add(name)
        return found

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the frame."""
        x0, y0, x1, y1 = self.parts[0].display_window
        return x1 - x0 + 1, y1 - y0 + 1

    @property
    def is_whole(self) -> bool:
        """Whether there are pixels for all of the frame."""
        return all(part.data_window == part.display_window for part in self.parts)

    def text(self, name: str) -> str:
        """An attribute of the first part; empty where it has none."""
        return self.parts[0].texts.get(name, "")

    def json(self, name: str) -> dict[str, Any]:
        """The same, parsed; empty where there is none or it is no JSON object."""
        try:
            found = json.loads(self.text(name) or "{}")
        except ValueError:
            return {}
        return found if isinstance(found, dict) else {}


def header_of(path: Path) -> ExrHeader:
    """Reads again only what has changed. Raises StrataError for what is not there or no OpenEXR file."""
    try:
        status = path.stat()
        return _read(path, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise StrataError(f"cannot read {path}: {error.strerror or error}") from None


@lru_cache(maxsize=8)
def _read(path: Path, modified: int, size: int) -> ExrHeader:
    with open(path, "rb") as stream:
        try:
            magic, version = struct.unpack("<4si", _taken(stream, 8))
            if magic != _MAGIC:
                raise ValueError
            parts = [_part(stream)]
            while version & _MULTI_PART and (part := _part(stream)):
                parts.append(part)
            if parts[0] is None:
                raise ValueError
            end = stream.tell()
        except (ValueError, KeyError, struct.error):
            raise StrataError(f"{path} is no OpenEXR file") from None
    return ExrHeader(tuple(parts), bool(version & _MULTI_PART), end)


def _part(stream: BinaryIO) -> PartHeader | None:
    """None where there is no further one."""
    found: dict[str, bytes] = {}
    texts: dict[str, str] = {}
    while name := _name(stream):
        kind = _name(stream)
        (length,) = struct.unpack("<i", _taken(stream, 4))
        data = _taken(stream, length)
        if kind == "string":
            texts[name] = data.decode(errors="replace")
        else:
            found[name] = data
    if not found:
        return None
    windows = (struct.unpack("<4i", found[name]) for name in ("dataWindow", "displayWindow"))
    channels = _channels(found["channels"])
    names, types = tuple(name for name, _ in channels), tuple(kind for _, kind in channels)
    return PartHeader(names, types, *windows, texts, found["compression"][0], "tiles" in found)


def _channels(data: bytes) -> list[tuple[str, int]]:
    """Names and types; 16 bytes are behind each name, of which the type takes four."""
    found, start = [], 0
    while start < len(data) - 1:
        end = data.index(b"\0", start)
        (kind,) = struct.unpack_from("<i", data, end + 1)
        found.append((data[start:end].decode(errors="replace"), kind))
        start = end + 17
    return found


def _name(stream: BinaryIO) -> str:
    name = bytearray()
    while (letter := _taken(stream, 1)) != b"\0":
        name += letter
        if len(name) > _LONGEST_NAME:
            raise ValueError
    return name.decode(errors="replace")


def _taken(stream: BinaryIO, count: int) -> bytes:
    if not 0 <= count <= _LARGEST_HEADER:
        raise ValueError
    data = stream.read(count)
    if len(data) < count:
        raise ValueError
    return data
