"""What a 3D viewport looks at: its eye, where in the region the picture lies, and what it hides."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..core.errors import StrataError
from ..core.shot import Camera, Raster
from .cameras import camera_of, region_of, viewport_camera

SMALLEST = 2  # pixels a side; less is no picture


@dataclass(frozen=True)
class Placement:
    """A picture in a region. `frame` is the whole frame in pixels of the region, left, bottom, right, top,
    and may reach beyond it; `part` (whole pixels of the region) is what of it can be seen. The region's own
    view has no frame beyond it."""

    camera: Camera
    frame: tuple[float, float, float, float]
    part: tuple[int, int, int, int]
    pixel_aspect: tuple[float, float] = (1.0, 1.0)
    is_camera_view: bool = False

    def sizes(self, scale: float) -> tuple[tuple[int, int], tuple[int, int, int, int] | None]:
        """At so many image pixels to one of the region: the size of the whole frame, and the part of it to
        compute, None for all."""
        left, bottom, right, top = self.frame
        width, height = right - left, top - bottom
        size = max(SMALLEST, round(width * scale)), max(SMALLEST, round(height * scale))
        steps = size[0] / width, size[1] / height
        low = [int(np.floor((self.part[i] - self.frame[i]) * steps[i] + 1e-6)) for i in (0, 1)]
        high = [int(np.ceil((self.part[2 + i] - self.frame[i]) * steps[i] - 1e-6)) for i in (0, 1)]
        region = tuple(
            int(np.clip(edge, 0, size[axis]))
            for axis, edge in ((0, low[0]), (1, low[1]), (0, high[0]), (1, high[1]))
        )
        return size, None if region == (0, 0, *size) else region

    def place(self, size: tuple[int, int], region: tuple[int, int, int, int] | None):
        """Left, bottom, right, top, in pixels of the viewport's region, of a computed image."""
        x0, y0, x1, y1 = region or (0, 0, *size)
        left, bottom, right, top = self.frame
        step = (right - left) / size[0], (top - bottom) / size[1]
        return left + x0 * step[0], bottom + y0 * step[1], left + x1 * step[0], bottom + y1 * step[1]

    def raster(self, scale: float) -> Raster:
        """At so many image pixels to one of the region."""
        size, region = self.sizes(scale)
        return Raster(self.camera, size, self.pixel_aspect, region, crop=region is not None)


def placement_of(
    scene: bpy.types.Scene,
    space: bpy.types.SpaceView3D,
    region_3d: bpy.types.RegionView3D,
    size: tuple[int, int],
    depsgraph: bpy.types.Depsgraph,
) -> Placement:
    """Of a region of `size` pixels. Looked through a camera, the picture is that camera's frame where Blender
    shows it; its passepartout stays Blender's. A camera that Strata cannot render is looked through as any
    viewport."""
    own = viewport_camera(region_3d.view_matrix, region_3d.window_matrix)
    whole = (0, 0, *size)
    if region_3d.view_perspective == "CAMERA" and space.camera is not None:
        try:
            placed = _framed(scene, space.camera.evaluated_get(depsgraph), own, size)
        except StrataError:
            placed = None
        if placed is not None:
            return placed
    part = whole
    if space.use_render_border and region_3d.view_perspective != "CAMERA":
        edges = (
            space.render_border_min_x * size[0],
            space.render_border_min_y * size[1],
            space.render_border_max_x * size[0],
            space.render_border_max_y * size[1],
        )
        part = tuple(int(edge) for edge in edges)
        if part[2] - part[0] < SMALLEST or part[3] - part[1] < SMALLEST:
            part = whole
    return Placement(own, tuple(map(float, whole)), part)


def _framed(scene, camera: bpy.types.Object, own: Camera, size: tuple[int, int]) -> Placement | None:
    """None where the frame lies outside the region."""
    read = camera_of(camera)
    render = scene.render
    aspect = (render.pixel_aspect_x, render.pixel_aspect_y)
    # Both look from the same place in the same direction, so windows compare as they are.
    inner = read.view(render.resolution_x, render.resolution_y, aspect).window
    outer = own.view(*size).window
    steps = [size[axis] / (outer[2 * axis + 1] - outer[2 * axis]) for axis in (0, 1)]
    frame = tuple(
        float((inner[2 * axis + side] - outer[2 * axis]) * steps[axis]) for side in (0, 1) for axis in (0, 1)
    )
    low = [max(0, int(np.floor(frame[axis]))) for axis in (0, 1)]
    high = [min(size[axis], int(np.ceil(frame[2 + axis]))) for axis in (0, 1)]
    if render.use_border:
        span = [frame[2 + axis] - frame[axis] for axis in (0, 1)]
        border = region_of(render, (10**4, 10**4))
        low = [max(low[axis], round(frame[axis] + border[axis] * 1e-4 * span[axis])) for axis in (0, 1)]
        high = [min(high[axis], round(frame[axis] + border[2 + axis] * 1e-4 * span[axis])) for axis in (0, 1)]
    if high[0] - low[0] < SMALLEST or high[1] - low[1] < SMALLEST:
        return None
    return Placement(read, frame, (*low, *high), aspect, is_camera_view=True)


def hides_objects(space: bpy.types.SpaceView3D) -> bool:
    """Whether the viewport shows anything else than its view layer does."""
    kinds = ("mesh", "light", "curve", "surf", "meta", "font")
    return (
        space.local_view is not None
        or space.use_local_collections
        or not all(getattr(space, f"show_object_viewport_{kind}") for kind in kinds)
    )


def shown_in(space: bpy.types.SpaceView3D, thing: bpy.types.Object) -> bool:
    """Whether a viewport that `hides_objects` shows this one; `thing` is an object of the view layer, not an
    evaluated copy."""
    kinds = {
        "MESH": "mesh",
        "LIGHT": "light",
        "CURVE": "curve",
        "SURFACE": "surf",
        "META": "meta",
        "FONT": "font",
    }
    kind = kinds.get(thing.type)
    if kind is not None and not getattr(space, f"show_object_viewport_{kind}"):
        return False
    return thing.visible_in_viewport_get(space)
