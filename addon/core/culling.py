"""What can matter in view: conservative tests on boxes, so that nothing needed is ever left out."""

from __future__ import annotations

import numpy as np

from .emitter import EmitterKind
from .outline import Instances, Light, Outline
from .shot import Shot
from .view import View

AXES = np.eye(3)

UNREACHED = "reaches nothing in view"
WITHOUT_CASTERS = "nothing casts a shadow into view"
"""Reasons for which a lamp surely has no shadow in view."""

DRAWN_GUARD = 1e-3
"""Share of a view's window, against rounding."""

SEEN_GUARD = 0.05
"""Share of a frame: what lies beside a picture counts as seen as far, since pixel filters and steps that read
neighbours reach over its border."""


def boxes_of(outline: Outline) -> np.ndarray:
    """(N, 2, 3) float64: low and high corners of the instances."""
    return outline.instances.boxes


def corners_of(boxes: np.ndarray) -> np.ndarray:
    """(N, 8, 3) corners of (N, 2, 3) boxes."""
    choice = np.array([(i >> 2 & 1, i >> 1 & 1, i & 1) for i in range(8)])
    return boxes[:, choice, np.arange(3)]


def partly_opaque(outline: Outline, instances: frozenset[int], use: str = "casts") -> frozenset[int]:
    """Those of `instances` of which something may be neither opaque nor clear: `use`, to what "casts"
    shadows or to what is "seen"."""
    materials = frozenset(
        index
        for index, material in enumerate(outline.materials)
        if any(opacity.is_partial for opacity in getattr(material, use))
    )
    if not materials or materials.isdisjoint(outline.instances.materials_of(instances)):
        return frozenset()
    return outline.instances.memo(
        ("partly opaque", instances, materials),
        lambda: frozenset(i for i in instances if not materials.isdisjoint(outline.instances[i].materials)),
    )


Guard = float | tuple[float, float]
"""By which share of its size a window grows on each side, or of its width and its height."""


def frustum_planes(view: View, guard: Guard = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Inward normals (6, 3) and offsets (6,): inside where normal . point >= offset."""
    right, up, forward = (np.array(axis) for axis in (view.right, view.up, view.forward))
    eye = np.array(view.eye)
    left, end, bottom, top = view.window
    across, up_by = guard if isinstance(guard, tuple) else (guard, guard)
    grow_x, grow_y = across * (end - left), up_by * (top - bottom)
    left, end, bottom, top = left - grow_x, end + grow_x, bottom - grow_y, top + grow_y
    if view.orthographic:
        sides = [(right, left), (-right, -end), (up, bottom), (-up, -top)]
        normals = [normal for normal, _ in sides]
        offsets = [normal @ eye + offset for normal, offset in sides]
    else:
        normals = [right - left * forward, end * forward - right, up - bottom * forward, top * forward - up]
        offsets = [normal @ eye for normal in normals]
    normals += [forward, -forward]
    offsets += [forward @ eye + view.near, -(forward @ eye) - view.far]
    return np.array(normals), np.array(offsets)


def frustum_corners(view: View, far: float) -> np.ndarray:
    """(8, 3) corners of the frustum between `near` and `far`, world space."""
    left, end, bottom, top = view.window
    points = []
    for depth in (view.near, far):
        scale = 1.0 if view.orthographic else depth
        points += [(x * scale, y * scale, depth) for x in (left, end) for y in (bottom, top)]
    axes = np.array([view.right, view.up, view.forward])
    return np.array(points) @ axes + np.array(view.eye)


def in_frustum(view: View, boxes: np.ndarray, guard: Guard = SEEN_GUARD) -> np.ndarray:
    """(N,) bool: False only where a box (N, 2, 3) lies wholly outside one plane."""
    return _inside(view, 0.5 * (boxes[:, 0] + boxes[:, 1]), 0.5 * (boxes[:, 1] - boxes[:, 0]), guard)


def _inside(view: View, middles: np.ndarray, halves: np.ndarray, guard: Guard) -> np.ndarray:
    """The same, by the boxes' centres and half sizes (N, 3)."""
    inside = np.ones(len(middles), bool)
    for normal, offset in zip(*frustum_planes(view, guard), strict=True):
        inside &= middles @ normal + halves @ np.abs(normal) >= offset - 1e-9 * abs(offset)
    return inside


def drawn_from(view: View, chosen: frozenset[int], instances: Instances) -> frozenset[int]:
    """Those of the instances `chosen` that may be drawn from `view`: others cost a rasteriser much, as it
    has to set up all their triangles to find that out."""
    return instances.memo(
        ("drawn", view, chosen),
        lambda: instances.subset(
            instances.mask(chosen) & _inside(view, instances.middles, instances.halves, DRAWN_GUARD)
        ),
    )


def not_whole_in(view: View, chosen: frozenset[int], instances: Instances) -> frozenset[int]:
    """Those of the instances `chosen` that `view` does not hold whole."""

    def find() -> frozenset[int]:
        held = _inside(view, instances.middles, -instances.halves, -DRAWN_GUARD)
        return instances.subset(instances.mask(chosen) & ~held)

    return instances.memo(("not whole in", view, chosen), find)


def _guard(shot: Shot) -> tuple[float, float]:
    """Beside a render region as far as beside the whole frame."""
    whole, computed = shot.source.frame_size, shot.computed_size
    return SEEN_GUARD * (whole[0] / computed[0]), SEEN_GUARD * (whole[1] / computed[1])


def holdouts_in_view(outline: Outline, shot: Shot) -> frozenset[int]:
    """Instances that may leave a hole in the picture."""
    instances = outline.instances
    if not shot.has_eye or not instances.holdouts.any():
        return frozenset()
    return instances.subset(instances.holdouts & in_frustum(shot.view, instances.boxes, _guard(shot)))


def receivers_in_view(outline: Outline, shot: Shot) -> tuple[np.ndarray, np.ndarray]:
    """Which instances the shot may show (N,) bool, and boxes (M, 2, 3) around what it shows of them: those of
    its coarse picture, or one around all."""
    boxes = boxes_of(outline)
    if not shot.has_eye:
        seen = outline.instances.mask(shot.source.instances)
        return seen, boxes[seen]
    if not len(boxes):
        return np.zeros(0, bool), np.zeros((0, 2, 3))
    view, guard = shot.view, _guard(shot)
    seen = outline.instances.memo(
        ("seen", view, guard), lambda: outline.instances.shown & in_frustum(view, boxes, guard)
    )
    if not seen.any():
        return seen, np.zeros((0, 2, 3))
    if shot.seen is not None:
        return seen, shot.seen
    # Every effect and lamp of a plan asks, and each time all corners would go through the view.
    return seen, outline.instances.memo(("around seen", view, guard), lambda: _around_seen(view, boxes[seen]))


def _around_seen(view: View, boxes: np.ndarray) -> np.ndarray:
    """(1, 2, 3): around what of `boxes` (M, 2, 3) lies in the view."""
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    depth = view.to_view(corners_of(boxes).reshape(-1, 3))[:, 2].max()
    frustum = frustum_corners(view, float(np.clip(depth, view.near, view.far)))
    margin = 0.05 * (frustum.max(axis=0) - frustum.min(axis=0))
    low = np.maximum(low, frustum.min(axis=0) - margin)
    high = np.minimum(high, frustum.max(axis=0) + margin)
    return np.stack([low, np.maximum(low, high)])[None]


def around(boxes: np.ndarray) -> np.ndarray:
    """(2, 3): the box around boxes (M, 2, 3), at least one."""
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def _emitter_box(light: Light) -> np.ndarray:
    emitter = light.emitter
    if emitter.kind in (EmitterKind.SPHERE, EmitterKind.FACING_DISK):
        half = np.full(3, emitter.half_width)
    else:
        axes = np.abs(np.array([emitter.right, emitter.up]))
        half = np.array([emitter.half_width, emitter.half_height]) @ axes
    centre = np.array(emitter.centre)
    return np.stack([centre - half, centre + half])


def lights_region(light: Light, region: np.ndarray) -> bool:
    """Whether the light can reach any point of the box `region` (2, 3), shadows aside."""
    emitter = light.emitter
    if emitter.kind == EmitterKind.DISTANT_DISK:
        return True
    corners = corners_of(region[None])[0] - np.array(emitter.centre)
    forward = np.array(emitter.forward)
    if emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
        return bool((corners @ forward).max() > 0.0)
    if emitter.cos_cone > 0.0:
        # A cone narrower than a half space misses the box if the box's sphere does.
        centre, radius = corners.mean(axis=0), 0.5 * np.linalg.norm(corners[0] - corners[7])
        along = centre @ forward
        across = np.linalg.norm(centre - along * forward)
        sine = np.sqrt(1.0 - emitter.cos_cone**2)
        outside = across * emitter.cos_cone - along * sine  # distance from the cone's surface
        return bool(outside <= radius + emitter.half_width)
    return True


def unlit_reason(light: Light, visible: frozenset[int], region: np.ndarray) -> str | None:
    """Why the light shines on none of the instances `visible`, in the box `region` (2, 3); None if it may."""
    if light.receivers is not None and light.receivers.isdisjoint(visible):
        return "it lights nothing in view (light linking)"
    if not lights_region(light, region):
        return UNREACHED
    return None


def casters_of(light: Light, instances: Instances, region: np.ndarray) -> frozenset[int]:
    """Instances that may cast the light's shadow into the box `region` (2, 3), light linking respected."""

    def find() -> frozenset[int]:
        found = instances.subset(instances.casting & casters_into(light, region, instances.boxes))
        return found if light.casters is None else light.casters & found

    return instances.memo(("casters", light.emitter, light.casters, region.tobytes()), find)


def casters_into(light: Light, region: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """(N,) bool: False only where nothing in the box can lie between the light and `region` (2, 3): where an
    axis separates it from the hull of the two."""
    emitter = light.emitter
    centres, extents = boxes.mean(axis=1), 0.5 * (boxes[:, 1] - boxes[:, 0])
    target = corners_of(region[None])[0]
    distant = emitter.kind == EmitterKind.DISTANT_DISK
    if distant:
        towards = -np.array(emitter.forward)
        centre = np.zeros(3)
    else:
        source = corners_of(_emitter_box(light)[None])[0]
        centre = source.mean(axis=0)
        towards = centre - target.mean(axis=0)
    across = np.cross(towards, AXES)
    lengths = np.linalg.norm(across, axis=1)
    across = across[lengths > 1e-6 * max(np.linalg.norm(towards), 1e-30)]
    keep = np.ones(len(boxes), bool)
    for axis in (*AXES, *across):
        along = target @ axis
        low, high = along.min(), along.max()
        if distant:
            # The region swept towards the sun, whose disk widens the sweep with distance.
            along_light = np.abs((centres - target.mean(axis=0)) @ towards) + extents @ np.abs(towards)
            reach = along_light.max(initial=0.0) + 1.0
            drift = reach * (axis @ towards)
            spread = reach * emitter.half_width * np.linalg.norm(axis)
            low, high = min(low, low + drift) - spread, max(high, high + drift) + spread
        else:
            low, high = min(low, (source @ axis).min()), max(high, (source @ axis).max())
        slack = 1e-6 * max(high - low, abs(low), abs(high))
        middle, reach = centres @ axis, extents @ np.abs(axis)
        keep &= (middle - reach <= high + slack) & (middle + reach >= low - slack)
    return keep
