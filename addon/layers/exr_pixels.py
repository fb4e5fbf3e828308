"""Pixels of an OpenEXR file that is not compressed, as a render writes it for somebody who reads it at once.

By hand, for the reasons that openexr.py writes by hand for.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from ..core.errors import StrataError
from .exr_header import header_of


def read_plain(path: Path) -> dict[str, np.ndarray]:
    """(height, width) float32 by channel's name, row 0 at the bottom. Raises StrataError for a file that has
    anything but scan lines of float32, or is cut off."""
    header = header_of(path)
    data = path.read_bytes()
    heights = [part.data_window[3] - part.data_window[1] + 1 for part in header.parts]
    planes: dict[str, np.ndarray] = {}
    lead = 12 if header.is_multi_part else 8  # a scan line's part, its row, its bytes
    try:
        offsets = struct.unpack_from(f"<{sum(heights)}Q", data, header.end)
        for number, (part, height) in enumerate(zip(header.parts, heights, strict=True)):
            width = part.data_window[2] - part.data_window[0] + 1
            first = sum(heights[:number])
            rows = np.empty((height, len(part.channels), width), np.float32)
            for offset in offsets[first : first + height]:
                row, count = struct.unpack_from("<ii", data, offset + lead - 8)
                if count != rows[0].nbytes:
                    raise ValueError
                line = np.frombuffer(data, "<f4", count // 4, offset + lead)
                rows[part.data_window[3] - row] = line.reshape(len(part.channels), width)
            for index, name in enumerate(part.channels):  # sorted in the file, too
                planes[name] = rows[:, index]
    except (ValueError, IndexError, struct.error):
        raise StrataError(f"{path} is not the plain OpenEXR file that was expected") from None
    return planes
