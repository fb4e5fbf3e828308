"""Where a shadow layer is likely to be wrong, told from the layer and the surface alone.

Strata are told apart so that few probes suffice; a bad guess costs probes, never correctness.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from ..core.emitter import Emitter, EmitterKind

MARGIN = 2  # rows around a pixel that its stratum depends on
SNAP = 1e-6  # values closer to 0 or 1 than this are 0 or 1
DEPTH_JUMP = 1.2  # neighbours whose squared distances to the eye differ by more than this lie on two surfaces
GRAZING_SINE = 0.1  # light lower than this above the surface grazes it


KIND_BITS = 3  # of a code, the Difficulty; the bits above are the brightness
CODES = 1 << (KIND_BITS + 7)


class Difficulty(IntEnum):
    """DARK gets no light, so that its errors weigh nothing. PENUMBRA is partly lit. EDGE is fully lit or
    fully dark, but near a change of either or near a silhouette. TERMINATOR is grazed by the light."""

    DARK = 0
    PENUMBRA = 1
    EDGE = 2
    TERMINATOR = 3
    REST = 4


class Ground:
    """What all lights share about a block of shading points: (rows, width, ...) arrays of a surface."""

    def __init__(self, surface: dict[str, np.ndarray]):
        self.shape = surface["position"].shape[:2]
        self.position = _planes(surface["position"])
        self.normals = [_planes(surface[name]) for name in ("shading_normal", "geometric_normal")]
        # Along each normal, the tangent plane's distance from the eye.
        self.offsets = [_dot(normal, self.position) for normal in self.normals]
        self.square = _dot(self.position, self.position)
        self.hit = (self.square > 0.0) & (self.square < np.inf)
        self.silhouettes = near_jumps(self.square.reshape(self.shape))


def silhouettes(surface: dict[str, np.ndarray]) -> np.ndarray:
    """(rows, width) bool: near where the surface, (rows, width[, 3]) "depth" or "position", ends; where no
    layer reads places, as with one sun, near where another "material" or "instance" begins."""
    if "depth" in surface:
        with np.errstate(over="ignore"):
            return near_jumps(surface["depth"] * surface["depth"])
    if "position" in surface:
        position = surface["position"]
        return near_jumps(np.einsum("rwc,rwc->rw", position, position))
    found = next(surface[name] for name in ("material", "instance", *surface) if name in surface)
    found = found.reshape(*found.shape[:2], -1)[:, :, 0]
    return near_changes(*(a != b for a, b in _neighbours(found)))


def near_jumps(image: np.ndarray) -> np.ndarray:
    """(rows, width) bool: within two pixels of neighbours of which one is more than DEPTH_JUMP the other."""
    return near_changes(*(_jump(*pair) for pair in _neighbours(image)))


def largest_nearby(image: np.ndarray) -> np.ndarray:
    """(rows, width): the largest value of the square of five by five pixels around each."""
    for _ in range(2):
        wider = image.copy()
        np.maximum(wider[:, 1:], image[:, :-1], out=wider[:, 1:])
        np.maximum(wider[:, :-1], image[:, 1:], out=wider[:, :-1])
        image = wider.copy()
        np.maximum(image[1:], wider[:-1], out=image[1:])
        np.maximum(image[:-1], wider[1:], out=image[:-1])
    return image


def _planes(vectors: np.ndarray) -> list[np.ndarray]:
    """x, y and z (N,): three times as fast as `@` and einsum, which do not vectorise across triples."""
    return [vectors[..., axis].reshape(-1) for axis in range(3)]


def _dot(a, b) -> np.ndarray:
    """(N,) of planes, and of planes or one vector."""
    result = a[0] * b[0]
    result += a[1] * b[1]
    result += a[2] * b[2]
    return result


def _neighbours(image: np.ndarray):
    return (image[:, :-1], image[:, 1:]), (image[:-1], image[1:])


def _jump(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):
        return np.maximum(a, b) > DEPTH_JUMP * np.minimum(a, b)


def near_changes(change_x: np.ndarray, change_y: np.ndarray) -> np.ndarray:
    """(rows, width) bool: within two pixels across a change between horizontal (rows, width - 1) or vertical
    (rows - 1, width) neighbours."""
    marked = np.zeros((len(change_x), change_y.shape[1]), bool)
    for _ in range(2):
        wider = marked.copy()
        wider[:, 1:] |= change_x
        wider[:, :-1] |= change_x
        wider[1:] |= change_y
        wider[:-1] |= change_y
        change_x = wider[:, 1:] | wider[:, :-1]
        change_y = wider[1:] | wider[:-1]
        marked = wider
    return marked


def classify(ground: Ground, values: np.ndarray, emitter: Emitter, eye: np.ndarray) -> np.ndarray:
    """(rows * width,) uint16: each pixel's Difficulty, and above KIND_BITS how much light about it gets, in
    steps of a factor of 4. 0 where there is none. `values` (rows, width) of the layer, `eye` (3,) float64."""
    low, high = values > SNAP, values < 1.0 - SNAP
    side = low.view(np.uint8) - high.view(np.uint8)  # -1, 0 and 1 modulo 256: dark, between and lit
    edges = near_changes(*(a != b for a, b in _neighbours(side))) | ground.silhouettes
    dark, grazed, brightness = reach(ground, emitter, eye)
    # The upper seven bits of a positive float are its exponent, halved: factors of 4.
    code = (brightness.view(np.uint32) >> np.uint32(24)).astype(np.uint16)
    code <<= KIND_BITS
    kind = np.full(values.size, Difficulty.REST, np.uint16)
    kind[grazed] = Difficulty.TERMINATOR
    kind[edges.reshape(-1)] = Difficulty.EDGE
    kind[(low & high).reshape(-1)] = Difficulty.PENUMBRA
    code |= kind
    code[dark | ~ground.hit] = Difficulty.DARK
    return code


def reach(ground: Ground, emitter: Emitter, eye: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points that the light cannot reach even without casters and points that it grazes, (N,) bool each; and
    about how much light they get without casters (N,) float32, positive."""
    forward = np.array(emitter.forward, np.float32)
    if emitter.kind == EmitterKind.DISTANT_DISK:
        distance = np.float32(1.0)
        radius = emitter.half_width / np.hypot(1.0, emitter.half_width)
        heights = [_dot(normal, -forward) for normal in ground.normals]
        behind = np.zeros(len(ground.square), bool)
    else:
        centre = (np.array(emitter.centre) - eye).astype(np.float32)
        square = ground.square - np.float32(2.0) * _dot(ground.position, centre) + centre @ centre
        distance = np.sqrt(np.maximum(square, 0.0))
        flat = emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE)
        radius = np.hypot(emitter.half_width, emitter.half_height) if flat else emitter.half_width
        pairs = zip(ground.normals, ground.offsets, strict=True)
        heights = [_dot(normal, centre) - offset for normal, offset in pairs]
        along = _dot(ground.position, forward) - centre @ forward
        behind = along <= 0.0 if flat else _outside_cone(along, distance, radius, emitter.cos_cone)
    # The highest and lowest point of the light over the tangent plane, with some room for rounding.
    reach_up = np.float32(1.001 * radius) + np.float32(1e-4) * distance
    grazing = np.float32(radius) + np.float32(GRAZING_SINE) * distance
    # As from the light's centre: cosine over the squared distance, within the light as from its rim.
    far = np.maximum(distance, np.float32(max(radius, 1e-9)))
    brightness = np.maximum(heights[0] + np.float32(radius), np.float32(1e-6) * far) / (far * far * far)
    return behind | (heights[0] < -reach_up), (heights[0] < grazing) | (heights[1] < grazing), brightness


def _outside_cone(along, distance, radius: float, cos_cone: float) -> np.ndarray:
    """Whether no ray from within `radius` of the apex to the point lies in the cone."""
    if cos_cone <= -1.0:
        return np.zeros(len(along), bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = np.minimum(1.001 * radius / distance + 1e-3, 1.0)  # of the angle that the light fills
        # cos(cone + filled); beyond a right angle there is no saying.
        widened = cos_cone * np.sqrt(1.0 - sine * sine) - np.sqrt(1.0 - cos_cone * cos_cone) * sine
        return (sine < 1.0) & (along < widened * distance)
