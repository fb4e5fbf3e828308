"""Hair curves, particle hair and point clouds, as Cycles takes them (its curves.cpp and pointcloud.cpp)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import bpy
import numpy as np

from .attributes import numbers_of
from .made_mesh import MadeMesh, Spheres, Strands, Tubes

CURVE_RADIUS, POINT_RADIUS = 0.005, 0.01  # metres, where there is no attribute
POLY = 1  # of the attribute `curve_type`: straight from point to point; all others are Catmull-Rom to Cycles
THICK_PIECES = 8  # of a segment that Cycles does not divide

SPLAT_ATTRIBUTES = ("f_dc_0", "scale_0", "rot_0")


def is_splats(cloud: bpy.types.PointCloud) -> bool:
    """Whether it is of Gaussian splats, by their names in .ply files, which is more than points."""
    return any(name in cloud.attributes for name in SPLAT_ATTRIBUTES)


def points_mesh(cloud: bpy.types.PointCloud) -> MadeMesh | None:
    """Spheres; None where there are none. Points that are not finite, or of no size, are left out."""
    count = len(cloud.points)
    points, radii = _positions(cloud, count), _radii(cloud, count, POINT_RADIUS)
    kept = np.isfinite(points).all(axis=1) & np.isfinite(radii) & (radii > 0.0)
    if not kept.any():
        return None

    def attributes(name: str) -> tuple[np.ndarray, bool] | None:
        found = _attribute(cloud, name)
        return None if found is None else (found[0][kept], True)

    return Spheres(cloud.name, points[kept], radii[kept], attributes)


def curves_mesh(curves: bpy.types.Curves, scene: bpy.types.Scene) -> MadeMesh | None:
    """Tubes; None where there are none."""
    if not len(curves.curves):
        return None
    starts = np.empty(len(curves.curves) + 1, np.int32)
    curves.curve_offset_data.foreach_get("value", starts)
    count = len(curves.points)
    radii = _radii(curves, count, CURVE_RADIUS, np.diff(starts))
    strands = Strands(
        _positions(curves, count),
        radii,
        starts.astype(np.int64),
        lambda: _root_uvs(curves),
        attributes=lambda name: _attribute(curves, name),
    )
    kinds = curves.attributes.get("curve_type")
    is_straight = False
    if kinds is not None:
        values = np.empty(len(kinds.data), np.int32)
        kinds.data.foreach_get("value", values)
        is_straight = bool((values == POLY).all())
    return _tubes(curves.name, strands, scene, is_straight)


def hair_systems(shown: bpy.types.Object, is_render: bool) -> Iterator[bpy.types.ParticleSystemModifier]:
    """Of an evaluated object, those modifiers whose particles are rendered as hair."""
    for modifier in shown.modifiers:
        if modifier.type == "PARTICLE_SYSTEM" and (
            modifier.show_render if is_render else modifier.show_viewport
        ):
            settings = modifier.particle_system.settings
            if settings.type == "HAIR" and settings.render_type == "PATH":
                yield modifier


def particle_hair_mesh(
    shown: bpy.types.Object,
    modifier: bpy.types.ParticleSystemModifier,
    scene: bpy.types.Scene,
    is_render: bool,
) -> MadeMesh | None:
    """Tubes along the paths of the particles, or of their children where they have any; None without."""
    system = modifier.particle_system
    settings, parents, children = system.settings, len(system.particles), len(system.child_particles)
    if not is_render:
        children = int(children * settings.display_percentage / 100.0)
    first = parents if settings.child_type != "NONE" and children else 0
    steps = (1 << (settings.render_step if is_render else settings.display_step)) + 1
    if settings.kink == "SPIRAL":
        steps += settings.kink_extra_steps
    count = parents + children - first
    if not count:
        return None
    # Blender tells them point by point only: 0.7 seconds a million. Cycles asks likewise.
    ask = system.co_hair
    told = (
        ask(shown, particle_no=n, step=step) for n in range(first, first + count) for step in range(steps)
    )
    world = np.fromiter(chain.from_iterable(told), np.float32, 3 * count * steps).reshape(-1, 3)
    try:
        inverse = np.linalg.inv(np.array(shown.matrix_world, np.float64))
    except np.linalg.LinAlgError:
        return None  # as flat as that it is left out anyway
    with np.errstate(invalid="ignore", over="ignore"):
        points = (world @ inverse[:3, :3].T + inverse[:3, 3]).astype(np.float32)
        radii = _particle_radii(settings, world.reshape(count, steps, 3))
    starts = steps * np.arange(count + 1, dtype=np.int64)
    numbers = range(first, first + count)
    strands = Strands(points, radii.reshape(-1), starts, lambda: _emitter_uvs(shown, modifier, numbers))
    return _tubes(f"{shown.name}/{system.name}", strands, scene, False)


def _particle_radii(settings: bpy.types.ParticleSettings, keys: np.ndarray) -> np.ndarray:
    """(S, K) float32, metres, of strands through `keys` (S, K, 3)."""
    root, tip = (0.5 * settings.radius_scale * width for width in (settings.root_radius, settings.tip_radius))
    along = np.zeros(keys.shape[:2])
    np.cumsum(np.linalg.norm(np.diff(keys, axis=1), axis=2), axis=1, out=along[:, 1:])
    whole = along[:, -1:]
    left = np.clip(1.0 - along / np.where(whole > 0.0, whole, 1.0), 0.0, 1.0)
    shape = settings.shape
    if shape < 0.0:
        left **= 1.0 + shape
    elif 0.0 < shape < 1.0:
        left **= 1.0 / (1.0 - shape)
    elif shape >= 1.0:
        left = np.floor(left)  # the limit of an endless power
    radii = left * (root - tip) + tip
    if settings.use_close_tip:
        radii[:, -1] = 0.0
    return radii.astype(np.float32)


def _tubes(name: str, strands: Strands, scene: bpy.types.Scene, is_straight: bool) -> MadeMesh | None:
    strands = strands.usable()
    if not len(strands.lengths):
        return None
    how = getattr(scene, "cycles_curves", None)  # not there where Cycles is switched off
    shape, divisions = ("RIBBONS", 2) if how is None else (how.shape, how.subdivisions)
    if not is_straight and shape != "THICK_LINEAR":
        most = min(1 << divisions, THICK_PIECES) if shape == "RIBBONS" else THICK_PIECES
        strands = strands.thinned().rounded(most)
    return Tubes(name, strands)


def _positions(owner: bpy.types.Curves | bpy.types.PointCloud, count: int) -> np.ndarray:
    """(N, 3) float32."""
    flat = np.zeros(3 * count, np.float32)
    if count:
        owner.attributes["position"].data.foreach_get("vector", flat)
    return flat.reshape(-1, 3)


def _radii(
    owner: bpy.types.Curves | bpy.types.PointCloud,
    count: int,
    default: float,
    lengths: np.ndarray | None = None,
) -> np.ndarray:
    """(N,) float32, metres; of curves that have `lengths` points, an attribute may be of curves."""
    radius = owner.attributes.get("radius")
    if radius is None or radius.data_type != "FLOAT" or radius.domain not in {"POINT", "CURVE"}:
        return np.full(count, default, np.float32)
    values = np.empty(len(radius.data), np.float32)
    radius.data.foreach_get("value", values)
    return np.repeat(values, lengths) if radius.domain == "CURVE" else values


def _attribute(owner: bpy.types.Curves | bpy.types.PointCloud, name: str) -> tuple[np.ndarray, bool] | None:
    """(N, 1 to 4) float64, and whether they are of points and not of curves."""
    # Cycles takes the radius for itself: to nodes it is not there.
    attribute = None if name == "radius" else owner.attributes.get(name)
    values = numbers_of(attribute)
    if values is None or attribute.domain not in {"POINT", "CURVE"}:
        return None
    return values, attribute.domain == "POINT"


def _root_uvs(curves: bpy.types.Curves) -> np.ndarray | None:
    """(S, 2) float32: where each is rooted on the surface's UV map, as Blender keeps it."""
    found = curves.attributes.get("surface_uv_coordinate")
    if found is None or (found.domain, found.data_type) != ("CURVE", "FLOAT2"):
        return None
    flat = np.empty(2 * len(found.data), np.float32)
    found.data.foreach_get("vector", flat)
    return np.nan_to_num(flat, posinf=0.0, neginf=0.0).reshape(-1, 2)


def _emitter_uvs(
    shown: bpy.types.Object, modifier: bpy.types.ParticleSystemModifier, numbers: range
) -> np.ndarray | None:
    """(S, 2) float32: where each is rooted on the emitter's render UV map."""
    layers = shown.data.uv_layers
    which = next((index for index, layer in enumerate(layers) if layer.active_render), None)
    system = modifier.particle_system
    if which is None or not len(system.particles):
        return None
    particles, last = list(system.particles), len(system.particles) - 1
    ask = system.uv_on_emitter
    told = (
        ask(modifier, particle=particles[min(number, last)], particle_no=number, uv_no=which)
        for number in numbers
    )
    flat = np.fromiter(chain.from_iterable(told), np.float32, 2 * len(numbers))
    return np.nan_to_num(flat, posinf=0.0, neginf=0.0).reshape(-1, 2)
