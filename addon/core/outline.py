"""The cheap header of a scene at one frame: what the plan decides by, before any array is read.

Filled by `addon/scene/scan.py`. Everything here is plain and immutable; indices (`mesh`, `materials`,
`receivers`, ...) point into the tuples of the `Outline`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .emitter import Emitter, EmitterKind
from .material import Colour, Image, Material
from .medium import Medium
from .params import OwnSettings, Params, with_own
from .roles import Role
from .view import Vector


@dataclass(frozen=True)
class Bounds:
    """A closed axis-aligned box, world space, metres, float64."""

    low: Vector
    high: Vector

    @property
    def centre(self) -> Vector:
        return tuple(0.5 * low + 0.5 * high for low, high in zip(self.low, self.high, strict=True))

    @property
    def radius(self) -> float:
        """Half the diagonal."""
        return 0.5 * math.dist(self.low, self.high)

    def corners(self) -> np.ndarray:
        """(8, 3) float64."""
        xs, ys, zs = zip(self.low, self.high, strict=True)
        return np.array([(x, y, z) for x in xs for y in ys for z in zs], np.float64)


@dataclass(frozen=True)
class Light:
    """A lamp: shape and relative radiance (`emitter`), and how much light (`intensity`).

    `intensity` is linear RGB in the working space, where the emitter's relative radiance is 1: W/sr, and
    W/m² on a facing surface for a sun. It is finite for lights of no size too:

    - irradiance = intensity / measure · ∫ relative radiance · cos⁺ · G dA, with measure = `emitter_measure`
    - `radiance` = intensity / measure

    with G, and cos at the surface, as in docs/accuracy.md. A FACING_DISK's measure is its area, and a
    SPHERE's that of its disk, while its integral is over the sphere. For a DISTANT_DISK G dA is solid angle.
    A diffuse surface sends back albedo / π · irradiance.

    `receivers` are the instances that the light lights, `casters` those that can block it (light and
    shadow linking); None: all. `own` are values that go over the scene's for this light: effect's id,
    parameter and value. `pass_name` is its part of layers' names (addon/scene/lamp_names.py); empty: made
    from `name`. `lamp` is what the lamp itself is called, with its library, where instances show it.
    `providers`: by role, the id of the effect that the lamp takes it from, where several offer it.
    """

    name: str
    key: str
    kind: str  # Blender's: 'POINT', 'SUN', 'SPOT', 'AREA'
    emitter: Emitter
    intensity: Colour
    casts_shadow: bool = True
    lights_media: bool = True
    receivers: frozenset[int] | None = None
    casters: frozenset[int] | None = None
    own_settings: OwnSettings = ()
    providers: tuple[tuple[Role, str], ...] = ()
    pass_name: str = ""
    lamp: str = ""

    def is_called(self, name: str) -> bool:
        """Whether somebody who says `name` means it."""
        return name in (self.name, self.key, self.pass_name, self.lamp)

    def params_for[P: Params](self, effect_id: str, params: P) -> P:
        """The effect's parameters for this light: the scene's, `params`, with the light's own over them."""
        return with_own(params, self.own_settings, effect_id)

    @property
    def is_dark(self) -> bool:
        """No power, or black. A negative light is not dark."""
        return not any(self.intensity)

    @property
    def radiance(self) -> Colour:
        """W/(m²·sr) where the relative radiance is 1; infinite for a light of no size."""
        measure = emitter_measure(self.emitter)
        return tuple(
            i / measure if measure > 0.0 else (math.copysign(math.inf, i) if i else 0.0)
            for i in self.intensity
        )


def emitter_measure(emitter: Emitter) -> float:
    """Intensity over radiance: the area that the axis sees, m²; the projected solid angle, sr, of a sun."""
    if emitter.kind == EmitterKind.RECTANGLE:
        return 4.0 * emitter.half_width * emitter.half_height
    if emitter.kind == EmitterKind.DISTANT_DISK:
        # Projected solid angle π sin² of the half angle, so that intensity is irradiance exactly.
        sine = math.sin(math.atan(emitter.half_width))
        return math.pi * sine * sine
    return math.pi * emitter.half_width * emitter.half_height


@dataclass(frozen=True)
class Mesh:
    """One evaluated mesh, shared by its instances. `triangles` is exact for polygons without bad vertices."""

    name: str
    key: str
    vertices: int
    triangles: int


@dataclass(frozen=True)
class Instance:
    """One appearance of a mesh. `matrix` is object to world, 4 rows of 4; `object_id` is the same for all
    parts and instances that one object of the scene makes. With a `medium` it is that, and no surface.
    `terminator_offset`: its object's geometry offset of the shadow terminator, a cosine; 0 of a flat one."""

    name: str
    mesh: int
    matrix: tuple[tuple[float, float, float, float], ...]
    bounds: Bounds
    object_id: int
    materials: tuple[int, ...]
    visible_camera: bool = True
    casts_shadow: bool = True
    is_holdout: bool = False
    medium: Medium | None = None
    own_settings: OwnSettings = ()
    terminator_offset: float = 0.0


class Instances(tuple[Instance, ...]):
    """All instances, and what is made of them as a whole, once: a scene may have tens of thousands, while
    only its lights move."""

    MOST_MEMOS = 256

    @cached_property
    def boxes(self) -> np.ndarray:
        """(N, 2, 3) float64: low and high corners."""
        boxes = [(instance.bounds.low, instance.bounds.high) for instance in self]
        return np.array(boxes, np.float64).reshape(-1, 2, 3)

    @cached_property
    def matrices(self) -> np.ndarray:
        """(N, 4, 4) float64, object to world."""
        return np.array([instance.matrix for instance in self], np.float64).reshape(-1, 4, 4)

    @cached_property
    def middles(self) -> np.ndarray:
        """(N, 3) float64: centres of the boxes."""
        return 0.5 * (self.boxes[:, 0] + self.boxes[:, 1])

    @cached_property
    def halves(self) -> np.ndarray:
        """(N, 3) float64: half sizes of the boxes."""
        return 0.5 * (self.boxes[:, 1] - self.boxes[:, 0])

    @cached_property
    def shown(self) -> np.ndarray:
        """(N,) bool: what a camera may see."""
        return np.array([i.visible_camera and not i.is_holdout for i in self], bool)

    @cached_property
    def holdouts(self) -> np.ndarray:
        """(N,) bool: what hides what is behind it from a camera, and shows nothing itself."""
        return np.array([i.visible_camera and i.is_holdout for i in self], bool)

    @cached_property
    def casting(self) -> np.ndarray:
        """(N,) bool: what casts shadows."""
        return np.array([instance.casts_shadow for instance in self], bool)

    @cached_property
    def with_own_settings(self) -> list[tuple[int, Instance]]:
        """Those that have settings of their own, with their indices."""
        return [(index, each) for index, each in enumerate(self) if each.own_settings]

    @cached_property
    def media(self) -> list[tuple[int, Instance]]:
        """Those that are a medium, with their indices."""
        return [(index, each) for index, each in enumerate(self) if each.medium is not None]

    def subset(self, chosen: np.ndarray) -> frozenset[int]:
        """Where `chosen` (N,) bool is True. The same set is the same object, as long as it is in use: what is
        kept by it is then found without comparing thousands of numbers."""
        return self.memo(
            ("subset", np.packbits(chosen).tobytes()),
            lambda: frozenset(np.flatnonzero(chosen).tolist()),
        )

    def mask(self, chosen: frozenset[int]) -> np.ndarray:
        """(N,) bool: True for the instances `chosen`."""

        def make() -> np.ndarray:
            mask = np.zeros(len(self), bool)
            mask[np.fromiter(chosen, np.int64, len(chosen))] = True
            return mask

        return self.memo(("mask", chosen), make)

    def boxes_of(self, chosen: frozenset[int]) -> np.ndarray:
        """(M, 2, 3) float64: boxes of the instances `chosen`, in order."""
        return self.memo(("boxes", chosen), lambda: self.boxes[self.mask(chosen)])

    def materials_of(self, chosen: frozenset[int]) -> frozenset[int]:
        """Materials that the instances `chosen` have."""
        return self.memo(
            ("materials", chosen), lambda: frozenset(m for i in chosen for m in self[i].materials)
        )

    @cached_property
    def _memos(self) -> dict:
        return {}

    def memo[Result](self, key, make: Callable[[], Result]) -> Result:
        """What `make` returned for this key; `key` has to hold all that the result depends on besides the
        instances. What was asked for longest ago is forgotten first."""
        memos = self._memos
        if key in memos:
            found = memos.pop(key)
        else:
            found = make()
            while len(memos) >= self.MOST_MEMOS:
                del memos[next(iter(memos))]
        memos[key] = found
        return found


@dataclass(frozen=True)
class Outline:
    """A scene at a frame, whoever looks at it (core/shot.py). `distance_m(instance, place, most_m)` is how
    far a place in the world is from an instance's triangles, or `most_m` if none is nearer, once the arrays
    are there; `version` counts changes of what is in the scene while it is watched, as in a viewport;
    `world_light` is the name of a world that sends light; `stamp` is what Blender says of the picture in the
    header of a render; `unknown` are those of `warnings` that tell of something whose extent nobody knows, so
    that no error found in the picture has an upper end; `baked` says, a line for each material, what of it is
    read as Blender bakes it."""

    scene_name: str
    view_layer_name: str
    frame: int
    lights: tuple[Light, ...] = ()
    instances: tuple[Instance, ...] = ()
    meshes: tuple[Mesh, ...] = ()
    materials: tuple[Material, ...] = ()
    images: tuple[Image, ...] = ()
    warnings: tuple[str, ...] = ()
    working_space: str = "Linear Rec.709"
    exposure: float = 1.0
    distance_m: Callable[[int, Vector, float], float] | None = field(default=None, compare=False)
    version: int = 0
    world_medium: Medium | None = None
    world_light: str = ""
    stamp: dict[str, str] = field(default_factory=dict, compare=False)
    unknown: tuple[str, ...] = ()
    baked: tuple[str, ...] = ()

    def __post_init__(self):
        if not isinstance(self.instances, Instances):
            object.__setattr__(self, "instances", Instances(self.instances))

    @property
    def triangles(self) -> int:
        return sum(self.meshes[instance.mesh].triangles for instance in self.instances)
