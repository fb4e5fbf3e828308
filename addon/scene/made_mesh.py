"""Meshes that are made of what Blender has as curves and points: tubes and spheres.

A round thing is a polyhedron here, of so many faces as a budget of triangles has room for, and so large that
its shadow is right on the mean: the mean width of a convex outline is its perimeter over pi, the mean shadow
of a convex body a quarter of its surface (Cauchy), so that these are those of the round one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from ..core.arrays import MeshArrays

FINE_TRIANGLES, MANY_TRIANGLES = 200_000, 2_000_000
"""What a mesh has at most of the finest and of the middle kind of faces; the coarsest has no bound."""

SIDES = (8, 5, 3)  # of tubes; of few sides those of odd numbers are nearly as wide from everywhere
GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
BEND = 0.5
"""Of a radius: how far straight pieces may be off a curve, all but 1% of them."""
NARROWER = 0.01
"""Of all strands' width: what leaving out points may change of it."""


class MadeMesh(Protocol):
    """`box` (2, 3) float64, low and high corners, object space, metres; `has_attributes`: whether those that
    Blender has can be read."""

    name: str
    vertices: int
    triangles: int
    box: np.ndarray
    has_attributes: bool

    def arrays(self, wants_normals: bool, wants_uv: bool) -> MeshArrays: ...

    def attribute(self, name: str, vertices: np.ndarray) -> np.ndarray | None:
        """(N, 1 to 4) float64 at vertices (N,); None where there is none of that name."""


Attributes = Callable[[str], tuple[np.ndarray, bool] | None]
"""(N, 1 to 4) float64 of an attribute's name, and whether they are of points and not of curves; or None."""


def kind_for(triangles: tuple[int, int, int]) -> int:
    """Which of three kinds to take, by the triangles that each would have, finest first."""
    if triangles[0] <= FINE_TRIANGLES:
        return 0
    return 1 if triangles[1] <= MANY_TRIANGLES else 2


@dataclass(frozen=True, eq=False)
class Strands:
    """Curves: `points` (P, 3) float32, object space, metres; `radii` (P,) float32, metres; `starts` (S + 1,)
    int64, the first point of each and then P. `uvs()` gives (S, 2) float32, each one's root on a texture, or
    None. `keys` (P,) float64 and `numbers` (S,): which of Blender's points each is, with a share of the way
    to the next, and which curve; None: as they come. `attributes` are of those, None where they are not
    read."""

    points: np.ndarray
    radii: np.ndarray
    starts: np.ndarray
    uvs: Callable[[], np.ndarray | None] = lambda: None
    keys: np.ndarray | None = None
    numbers: np.ndarray | None = None
    attributes: Attributes | None = None

    @property
    def lengths(self) -> np.ndarray:
        """(S,) points of each."""
        return np.diff(self.starts)

    @cached_property
    def strand(self) -> np.ndarray:
        """(P,) which one each point is of."""
        return np.repeat(np.arange(len(self.lengths)), self.lengths)

    @cached_property
    def segments(self) -> np.ndarray:
        """(M,) the first point of each segment."""
        is_last = np.zeros(len(self.points), bool)
        is_last[self.starts[1:] - 1] = True
        return np.flatnonzero(~is_last)

    def usable(self) -> Strands:
        """Those of two points at least, all of them finite, and of some width."""
        finite = np.isfinite(self.points).all(axis=1) & np.isfinite(self.radii)
        is_bad = np.bincount(self.strand[~finite], minlength=len(self.lengths)) > 0
        is_wide = np.bincount(self.strand[finite & (self.radii > 0.0)], minlength=len(self.lengths)) > 0
        kept = ~is_bad & is_wide & (self.lengths > 1)
        if kept.all():
            return self
        of_points = np.repeat(kept, self.lengths)
        starts = np.concatenate([[0], np.cumsum(self.lengths[kept])])

        def uvs() -> np.ndarray | None:
            found = self.uvs()
            return None if found is None else found[kept]

        keys, numbers = np.flatnonzero(of_points).astype(np.float64), np.flatnonzero(kept)
        points, radii = self.points[of_points], self.radii[of_points]
        return Strands(points, radii, starts, uvs, keys, numbers, self.attributes)

    def rounded(self, most_pieces: int) -> Strands:
        """Each segment in up to `most_pieces` straight ones along the Catmull-Rom curve through the points,
        ends doubled, as Cycles has it; as many for all, so that they follow it closely enough, as far as
        MANY_TRIANGLES go."""
        first = self.segments
        most_pieces = min(most_pieces, MANY_TRIANGLES // (2 * SIDES[-1] * len(first)))
        if most_pieces < 2:
            return self
        start, end = self.starts[self.strand[first]], self.starts[self.strand[first] + 1]
        before, after = np.maximum(first - 1, start), np.minimum(first + 2, end - 1)
        points = np.column_stack([self.points, self.radii])
        p0, p1, p2, p3 = (points[i] for i in (before, first, first + 1, after))
        # How far off its chord a segment is in its middle.
        off, _ = _beside((p1 + p2 - p0 - p3)[:, :3] / 16.0, (p2 - p1)[:, :3])
        needed = math.sqrt(_bend(off, np.maximum(p1[:, 3], p2[:, 3])) / BEND)
        pieces = min(max(math.ceil(needed), 1), most_pieces)
        if pieces == 1:
            return self
        # A strand has one point more than segments, so that each before it shifts by one.
        at = pieces * np.arange(len(first)) + self.strand[first]
        made = np.empty((pieces * len(first) + len(self.lengths), 4), np.float32)
        for piece in range(pieces):
            t = piece / pieces
            made[at + piece] = 0.5 * (
                2.0 * p1
                + t * (p2 - p0)
                + t**2 * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3)
                + t**3 * (3.0 * p1 - p0 - 3.0 * p2 + p3)
            )
        starts = pieces * (self.starts - np.arange(len(self.starts))) + np.arange(len(self.starts))
        made[starts[1:] - 1] = points[self.starts[1:] - 1]
        keys = self._keys
        between = np.empty(len(made))
        for piece in range(pieces):
            between[at + piece] = keys[first] + piece / pieces * (keys[first + 1] - keys[first])
        between[starts[1:] - 1] = keys[self.starts[1:] - 1]
        return replace(
            self, points=made[:, :3].copy(), radii=np.maximum(made[:, 3], 0.0), starts=starts, keys=between
        )

    @property
    def _keys(self) -> np.ndarray:
        return np.arange(len(self.points), dtype=np.float64) if self.keys is None else self.keys

    def attribute(self, name: str) -> np.ndarray | None:
        """(P, 1 to 4) float64, between Blender's points linear; None where there is none of that name."""
        found = None if self.attributes is None else self.attributes(name)
        if found is None:
            return None
        values, is_of_points = found
        if not is_of_points:
            return (values if self.numbers is None else values[self.numbers])[self.strand]
        keys = self._keys
        first = keys.astype(np.int64)
        share = (keys - first)[:, None]
        return (1.0 - share) * values[first] + share * values[np.minimum(first + 1, len(values) - 1)]

    def thinned(self) -> Strands:
        """Without every second point, and again without every second, as far as bends and widths allow, where
        there are many and all strands have as many."""
        strands, length = self, int(self.lengths[0])
        while length > 2 and length % 2 == 1 and (strands.lengths == length).all():
            if 2 * SIDES[0] * len(strands.segments) <= FINE_TRIANGLES:
                break
            keys = np.column_stack([strands.points, strands.radii]).reshape(-1, length, 4)
            kept, left = keys[:, ::2], keys[:, 1::2]
            chord = kept[:, 1:] - kept[:, :-1]
            off, share = _beside((left - kept[:, :-1])[..., :3], chord[..., :3])
            lost = np.abs(left[..., 3] - kept[:, :-1, 3] - np.clip(share, 0.0, 1.0) * chord[..., 3])
            step = np.linalg.norm(chord[..., :3], axis=2)
            is_same = (lost * step).sum() <= NARROWER * (left[..., 3] * step).sum()
            if not is_same or _bend(off, left[..., 3]) > BEND:
                break
            length = kept.shape[1]
            points, radii = kept[..., :3].reshape(-1, 3), kept[..., 3].reshape(-1)
            starts, last = length * np.arange(len(kept) + 1), strands._keys.reshape(len(kept), -1)
            strands = replace(
                strands, points=points, radii=radii, starts=starts, keys=last[:, ::2].reshape(-1)
            )
        return strands


class Tubes:
    """Open tubes around strands, smooth; see MadeMesh."""

    def __init__(self, name: str, strands: Strands):
        self.name = name
        self._strands = strands
        count = len(strands.segments)
        self.sides = SIDES[kind_for(tuple(2 * sides * count for sides in SIDES))]
        self.vertices = self.sides * len(strands.points)
        self.triangles = 2 * self.sides * count
        # Of the polygon around the strand, whose perimeter is the circle's.
        self._radii = strands.radii * np.float32(math.pi / (self.sides * math.sin(math.pi / self.sides)))
        low = (strands.points - self._radii[:, None]).min(axis=0)
        high = (strands.points + self._radii[:, None]).max(axis=0)
        self.box = np.array([low, high], np.float64)

    def arrays(self, wants_normals: bool, wants_uv: bool) -> MeshArrays:
        strands, sides = self._strands, self.sides
        across, up = self._frames()
        # Turned from strand to strand, so that the corners of all together point everywhere.
        turn = (GOLDEN_ANGLE * strands.strand)[:, None] + math.tau / sides * np.arange(sides)
        cosine, sine = np.cos(turn, dtype=np.float32), np.sin(turn, dtype=np.float32)
        outward = cosine[:, :, None] * across[:, None] + sine[:, :, None] * up[:, None]
        positions = strands.points[:, None] + self._radii[:, None, None] * outward
        side = np.arange(sides)
        following = (side + 1) % sides
        ring = np.stack([side, following, following + sides, side + sides], axis=1)  # (sides, 4)
        corners = (sides * strands.segments[:, None, None] + ring).astype(np.int32).reshape(-1)
        uvs = None
        if wants_uv and (roots := strands.uvs()) is not None:
            uvs = np.repeat(roots[strands.strand[strands.segments]], 4 * sides, axis=0)
        return MeshArrays(
            positions.reshape(-1, 3),
            corners,
            np.arange(0, len(corners) + 1, 4, dtype=np.int32),
            outward.reshape(-1, 3)[corners] if wants_normals else None,
            uvs,
        )

    @property
    def has_attributes(self) -> bool:
        return self._strands.attributes is not None

    def attribute(self, name: str, vertices: np.ndarray) -> np.ndarray | None:
        values = self._strands.attribute(name)
        return None if values is None else values[vertices // self.sides]

    def _frames(self) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3) float32 twice: two axes across a strand at each of its points, which turn little from one to
        the next."""
        strands = self._strands
        index, strand = np.arange(len(strands.points)), strands.strand
        before = np.maximum(index - 1, strands.starts[strand])
        after = np.minimum(index + 1, strands.starts[strand + 1] - 1)
        along = _unit(strands.points[after] - strands.points[before], np.array([0.0, 0.0, 1.0], np.float32))
        # Across the axis that a strand is never close to, if there is one.
        closest = np.maximum.reduceat(np.abs(along), strands.starts[:-1], axis=0)
        axis = np.eye(3, dtype=np.float32)[closest.argmin(axis=1)[strand]]
        other = np.cross(np.eye(3, dtype=np.float32)[np.abs(along).argmin(axis=1)], along)
        across = _unit(np.cross(axis, along), other)
        # Where a strand goes past the axis it turns round all the same: turned back.
        turns = np.zeros(len(across), np.int64)
        turns[1:] = np.einsum("ni,ni->n", across[1:], across[:-1]) < 0.0
        turns[strands.starts[:-1]] = 0
        turned = np.cumsum(turns)
        is_odd = (turned - turned[strands.starts[strand]]) % 2 == 1
        across[is_odd] *= -1.0
        return across, np.cross(along, across)


class Spheres:
    """Spheres around points, smooth; see MadeMesh. `points` (N, 3) float32, object space, metres; `radii`
    (N,) float32, metres; `attributes` are of these."""

    has_attributes = True

    def __init__(
        self, name: str, points: np.ndarray, radii: np.ndarray, attributes: Attributes = lambda name: None
    ):
        self.name = name
        self._attributes = attributes
        kinds = [_icosphere(level) for level in (2, 1, 0)]
        chosen = kind_for(tuple(len(faces) * len(points) for _, faces in kinds))
        self._directions, self._faces = kinds[chosen]
        self.vertices = len(self._directions) * len(points)
        self.triangles = len(self._faces) * len(points)
        a, b, c = np.moveaxis(self._directions[self._faces], 1, 0)
        surface = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        self._points, self._radii = points, radii * np.float32(math.sqrt(4.0 * math.pi / surface))
        low = (points - self._radii[:, None]).min(axis=0)
        high = (points + self._radii[:, None]).max(axis=0)
        self.box = np.array([low, high], np.float64)

    def arrays(self, wants_normals: bool, wants_uv: bool) -> MeshArrays:
        count, corners_each = len(self._points), len(self._directions)
        # Each turned by itself, so that corners and faces of all together point everywhere.
        turns = _rotations(count)
        outward = np.einsum("nij,vj->nvi", turns, self._directions, optimize=True)
        positions = self._points[:, None] + self._radii[:, None, None] * outward
        offsets = corners_each * np.arange(count)
        corners = (offsets[:, None, None] + self._faces).astype(np.int32).reshape(-1)
        normals = outward.reshape(-1, 3)[corners] if wants_normals else None
        starts = np.arange(0, len(corners) + 1, 3, dtype=np.int32)
        return MeshArrays(positions.reshape(-1, 3), corners, starts, normals)

    def attribute(self, name: str, vertices: np.ndarray) -> np.ndarray | None:
        found = self._attributes(name)
        return None if found is None else found[0][vertices // len(self._directions)]


def _rotations(count: int) -> np.ndarray:
    """(N, 3, 3) float32, evenly distributed, the same every time: of random unit quaternions."""
    quaternions = np.random.default_rng(0).normal(size=(count, 4)).astype(np.float32)
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _beside(places: np.ndarray, chords: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far `places` (..., 3) are off lines along `chords` (..., 3) from the origin, and where on those."""
    square = np.einsum("...i,...i", chords, chords)
    share = np.einsum("...i,...i", chords, places) / np.where(square > 0.0, square, 1.0)
    return np.linalg.norm(places - share[..., None] * chords, axis=-1), share


def _bend(off: np.ndarray, radii: np.ndarray) -> float:
    """How far all but 1% are off, in radii; those of no width do not count."""
    is_wide = radii > 0.0
    return float(np.percentile(off[is_wide] / radii[is_wide], 99.0)) if is_wide.any() else 0.0


def _unit(vectors: np.ndarray, instead: np.ndarray) -> np.ndarray:
    """Of length 1; those of no length are `instead`, made so."""
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    # Divided first, so that no square is too small a number.
    vectors = np.where(largest > 0.0, vectors / np.where(largest > 0.0, largest, 1.0), instead)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _icosphere(level: int) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) float32 unit vectors and (F, 3) faces, counter-clockwise from outside: an icosahedron, each face
    in four `level` times."""
    golden = 0.5 * (1.0 + math.sqrt(5.0))
    signs = [(a, b) for a in (-1.0, 1.0) for b in (-golden, golden)]
    corners = np.array([np.roll((0.0, a, b), shift) for shift in range(3) for a, b in signs])
    apart = np.linalg.norm(corners[:, None] - corners, axis=2)
    near = np.isclose(apart, 2.0)
    triples = ((i, j, k) for i in range(12) for j in range(i) for k in range(j))
    faces = np.array([(i, j, k) for i, j, k in triples if near[i, j] and near[j, k] and near[k, i]])
    a, b, c = np.moveaxis(corners[faces], 1, 0)
    is_inward = np.einsum("ni,ni->n", np.cross(b - a, c - a), a) < 0.0
    faces[is_inward] = faces[is_inward][:, ::-1]
    for _ in range(level):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges, which = np.unique(edges, axis=0, return_inverse=True)
        ab, bc, ca = (which.reshape(-1, 3) + len(corners)).T
        corners = np.concatenate([corners, corners[edges].mean(axis=1)])
        corners /= np.linalg.norm(corners, axis=1, keepdims=True)
        i, j, k = faces.T
        quarters = ((i, ab, ca), (ab, j, bc), (ca, bc, k), (ab, bc, ca))
        faces = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return (corners / np.linalg.norm(corners, axis=1, keepdims=True)).astype(np.float32), faces
