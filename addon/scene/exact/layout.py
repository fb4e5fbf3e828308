"""Where the faces of a mesh lie in the picture that is baked of it: each in a square of its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

SMALLEST = 2
"""Texels a side of a face's square, at least: between the corners of so small a face all is linear."""

_INSET = 0.49
"""Of a texel: corners lie just outside of the middles of their squares' outermost texels, so that those are
baked, and what is interpolated within a face is of its own texels alone, up to its very edges."""


MOST_BYTES = 256 << 20


class Layouts:
    """Those asked for last, as many as fit `most_bytes`: previews ask for the same ones after every edit."""

    def __init__(self, most_bytes: int = MOST_BYTES):
        self._most_bytes = most_bytes
        self._known: dict[tuple[str, int], np.ndarray] = {}  # asked for longest ago first

    def get(self, digest: str, size: int, make: Callable[[], np.ndarray]) -> np.ndarray:
        """Of the mesh of that digest in a picture of that size; `make` is asked where it is not known."""
        found = self._known.pop((digest, size), None)
        found = self._known[digest, size] = make() if found is None else found
        held = sum(each.nbytes for each in self._known.values())
        while held > self._most_bytes and len(self._known) > 1:
            held -= self._known.pop(next(iter(self._known))).nbytes
        return found


LAYOUTS = Layouts()


def least_size(faces: int) -> int:
    """Texels a side of a picture that has room for so many; a power of two."""
    return 1 << int(np.ceil(np.log2(SMALLEST * np.sqrt(max(faces, 1)))))


def layout_of(
    positions: np.ndarray, corner_vertices: np.ndarray, face_starts: np.ndarray, size: int
) -> np.ndarray:
    """(C, 2) f32 from 0 to 1: the corners of faces in a picture of `size` texels a side, a power of two of at
    least `least_size`. `positions` (V, 3), `corner_vertices` (C,), `face_starts` (F + 1,) as in MeshArrays.
    Each face is projected along its normal and stretched over its square, which is the larger the larger the
    face is."""
    flat, extents = _flattened(positions, corner_vertices, face_starts)
    sides = _sides(np.sqrt(np.prod(extents, axis=1)), np.max(extents, axis=1), size)
    places = _packed(sides)
    counts = np.diff(face_starts)
    side, place = np.repeat(sides, counts)[:, None], np.repeat(places, counts, axis=0)
    texels = place + _INSET + flat * (side - 2.0 * _INSET)
    return (texels / size).astype(np.float32)


def _flattened(positions, corner_vertices, face_starts) -> tuple[np.ndarray, np.ndarray]:
    """Corners (C, 2) from 0 to 1 within their face's box, whose longest edge lies along x; the extents (F, 2)
    of the boxes. Float64."""
    corners = np.nan_to_num(positions, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float64)[corner_vertices]
    starts, counts = face_starts[:-1], np.diff(face_starts)
    following = np.arange(1, len(corners) + 1)
    following[face_starts[1:] - 1] = starts
    edges = corners[following] - corners
    # Newell's normals; those without any lie flat.
    normals = np.add.reduceat(np.cross(corners, corners[following]), starts, axis=0)
    lengths = np.sqrt(np.sum(edges**2, axis=1))
    longest = np.lexsort((-lengths, np.repeat(np.arange(len(counts)), counts)))[starts]
    x = _units(edges[longest], (1.0, 0.0, 0.0))
    normals = _units(normals, (0.0, 0.0, 1.0))
    y = _units(np.cross(normals, x), (0.0, 1.0, 0.0))
    relative = corners - np.repeat(corners[starts], counts, axis=0)
    flat = np.stack([np.sum(relative * np.repeat(axis, counts, axis=0), axis=1) for axis in (x, y)], axis=1)
    low, high = (limit.reduceat(flat, starts, axis=0) for limit in (np.minimum, np.maximum))
    extents = high - low
    flat = flat - np.repeat(low, counts, axis=0)
    return flat / np.repeat(np.where(extents > 0.0, extents, 1.0), counts, axis=0), extents


def _units(vectors: np.ndarray, instead) -> np.ndarray:
    lengths = np.sqrt(np.sum(vectors**2, axis=1, keepdims=True))
    return np.where(lengths > 1e-30, vectors / np.where(lengths > 1e-30, lengths, 1.0), instead)


def _sides(means: np.ndarray, longest: np.ndarray, size: int) -> np.ndarray:
    """(F,) powers of two in texels, as large as fits: by the mean of a box's sides, and for slivers by what
    is longer."""
    wanted = np.maximum(means, 0.25 * longest)
    wanted = wanted / max(float(wanted.max()), 1e-30)
    low, high = 0.0, 4.0 * size
    sides = np.full(len(wanted), SMALLEST)
    for _half in range(24):
        middle = 0.5 * (low + high)
        found = np.clip(middle * wanted, SMALLEST, size)
        found = (1 << np.floor(np.log2(found)).astype(np.int64)).astype(np.int64)
        if int(np.sum(found**2)) <= size * size:
            low, sides = middle, found
        else:
            high = middle
    return sides


def _packed(sides: np.ndarray) -> np.ndarray:
    """(F, 2) each square's lower left texel. Squares of powers of two, the larger ones first, fill a Z-order
    curve without gaps (Morton, 1966)."""
    order = np.argsort(-sides, kind="stable")
    areas = (sides[order] // SMALLEST) ** 2
    along = np.concatenate([[0], np.cumsum(areas)[:-1]])
    places = np.zeros((len(sides), 2), np.int64)
    places[order, 0], places[order, 1] = _every_second_bit(along), _every_second_bit(along >> 1)
    return places * SMALLEST


def _every_second_bit(codes: np.ndarray) -> np.ndarray:
    found = np.zeros_like(codes)
    for bit in range(31):
        found |= ((codes >> (2 * bit)) & 1) << bit
    return found
