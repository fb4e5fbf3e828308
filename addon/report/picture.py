"""Pictures of numbers, as PNG."""

from __future__ import annotations

import struct
import zlib

import numpy as np

from ..measure.whole import Whole

SHOWN = 0.1
"""An error of so much, a share of the brightness, has the full colour."""
BRIGHT, DARK = (0.84, 0.19, 0.15), (0.13, 0.40, 0.67)
"""Of where a layer is too bright and too dark (ColorBrewer's RdBu, which colour-blind people tell apart)."""


def png(image: np.ndarray) -> bytes:
    """Of display colours (height, width, 3) in [0, 1], row 0 at the bottom."""
    pixels = (np.clip(image[::-1], 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    height, width = pixels.shape[:2]
    rows = np.concatenate([np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)], axis=1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def signed_png(errors: np.ndarray, shown: float = SHOWN) -> bytes:
    """Of errors (height, width): white where there is none, red where too bright, blue where too dark."""
    share = np.clip(errors / shown, -1.0, 1.0)[..., None]
    image = 1.0 - np.maximum(share, 0.0) * (1.0 - np.array(BRIGHT))
    image -= np.maximum(-share, 0.0) * (1.0 - np.array(DARK))
    return png(image)


def difference_png(whole: Whole, layer: np.ndarray, size: tuple[int, int]) -> bytes:
    """How far a layer is off at the pixels of an image of `size` (width, height) that are known; the rays'
    noise is in it."""
    errors = whole.errors(layer).mean(axis=1)
    signs = np.sign(errors.sum(axis=1))
    rows = np.unique(whole.pixels // size[0])
    return signed_png((signs * np.linalg.norm(errors, axis=1)).reshape(len(rows), -1))
