"""Cameras, and what of the frame a render computes."""

from __future__ import annotations

import bpy
import numpy as np

from ..core.errors import StrataError
from ..core.shot import Camera, PixelFilter
from .transforms import are_usable, as_vector, matrix_of

LARGEST_RADIUS = 64.0  # pixels of a filter (MAX_JITTER in kernels/src/raster/camera.rs)


def camera_of(evaluated: bpy.types.Object) -> Camera:
    """Raises StrataError for what is no camera, a panoramic one, or one without a direction."""
    name = evaluated.name
    if evaluated.type != "CAMERA":
        raise StrataError(f"'{name}' is not a camera")
    data = evaluated.data
    if data.type not in {"PERSP", "ORTHO"}:
        raise StrataError(f"camera '{name}' is panoramic or custom: only perspective and orthographic render")
    matrix = matrix_of(evaluated.matrix_world)
    if not are_usable(matrix[None])[0]:
        raise StrataError(f"camera '{name}' has a matrix that is singular or not finite")
    near, far = float(data.clip_start), float(data.clip_end)
    if not 0.0 < near < far:
        raise StrataError(f"camera '{name}' clips everything: it starts at {near:g} m and ends at {far:g} m")
    # A camera's scale does not count in Blender, and a sheared one is straightened as Cycles does it.
    forward = -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    up = matrix[:3, 1] - forward * (matrix[:3, 1] @ forward)
    up /= np.linalg.norm(up)
    right = np.cross(forward, up)
    if right @ matrix[:3, 0] < 0.0:
        right = -right
    return Camera(
        name=name,
        eye=as_vector(matrix[:3, 3]),
        right=as_vector(right),
        up=as_vector(up),
        forward=as_vector(forward),
        orthographic=data.type == "ORTHO",
        lens=float(data.lens),
        orthographic_scale=float(data.ortho_scale),
        sensor_fit=data.sensor_fit,
        sensor_width=float(data.sensor_width),
        sensor_height=float(data.sensor_height),
        shift_x=float(data.shift_x),
        shift_y=float(data.shift_y),
        near=near,
        far=far,
    )


def viewport_camera(view_matrix, window_matrix) -> Camera:
    """The eye of a 3D viewport by its `RegionView3D` matrices (world to view, view to clip), for an image of
    the region's proportions."""
    to_world = np.linalg.inv(matrix_of(view_matrix))
    clip = matrix_of(window_matrix)
    orthographic = bool(clip[3, 3])
    # Rows of OpenGL's matrices: the frustum's, and glOrtho's.
    width, height = 2.0 / clip[0, 0], 2.0 / clip[1, 1]
    sign = -1.0 if orthographic else 1.0
    centre_x = sign * 0.5 * width * (clip[0, 3] if orthographic else clip[0, 2])
    centre_y = sign * 0.5 * height * (clip[1, 3] if orthographic else clip[1, 2])
    if orthographic:
        near, far = (clip[2, 3] + 1.0) / clip[2, 2], (clip[2, 3] - 1.0) / clip[2, 2]
    else:
        near, far = clip[2, 3] / (clip[2, 2] - 1.0), clip[2, 3] / (clip[2, 2] + 1.0)
    return Camera(
        name="",
        eye=as_vector(to_world[:3, 3]),
        right=as_vector(to_world[:3, 0]),
        up=as_vector(to_world[:3, 1]),
        forward=as_vector(-to_world[:3, 2]),
        orthographic=orthographic,
        lens=1.0 / width,
        orthographic_scale=width,
        sensor_fit="HORIZONTAL",
        sensor_width=1.0,
        shift_x=centre_x / width,
        shift_y=centre_y / width,
        near=near,
        far=far,
    )


def camera_warnings(evaluated: bpy.types.Object, render: bpy.types.RenderSettings) -> list[str]:
    """What of a picture layers do not have, so that they do not fit it."""
    warnings = []
    if evaluated.data.dof.use_dof:
        warnings.append(
            f"camera '{evaluated.name}' has depth of field: layers are sharp and do not fit what it blurs"
        )
    if render.use_motion_blur:
        warnings.append("motion blur is on: layers show one instant and do not fit what moves")
    if render.use_multiview:
        warnings.append("stereoscopy is not read, layers show one eye in the middle")
    return warnings


def frame_size_of(render: bpy.types.RenderSettings) -> tuple[int, int]:
    """Pixels of the whole frame, rounded as BKE_render_resolution does."""
    percentage = render.resolution_percentage
    size = render.resolution_x * percentage // 100, render.resolution_y * percentage // 100
    if min(size) < 1:
        raise StrataError(f"at {percentage}% the image has no pixels")
    return size


def region_of(render: bpy.types.RenderSettings, size: tuple[int, int]) -> tuple[int, int, int, int] | None:
    """The render region in pixels x0, y0, x1, y1, truncated in float32 as the render pipeline does it; None
    where the whole frame is rendered."""
    if not render.use_border:
        return None
    borders = (render.border_min_x, render.border_min_y, render.border_max_x, render.border_max_y)
    region = tuple(int(np.float32(b) * np.float32(n)) for b, n in zip(borders, size * 2, strict=True))
    if region[0] >= region[2] or region[1] >= region[3]:
        raise StrataError("the render region has no pixels")
    return region


def pixel_filter_of(scene: bpy.types.Scene, engine: str) -> PixelFilter:
    """Of the engine (by id) that the scene renders with: Cycles has its own, others the film's Filter Size.

    Cycles stretches a Gaussian three-fold and a Blackman-Harris two-fold over its Filter Width
    (`filter_table` in its film.cpp); a box is a pixel wide whatever the setting. EEVEE's is a
    Blackman-Harris of that radius, none at 0, which it cuts off at 100 pixels (`Film::init`); the rasteriser
    moves points by 64 at most.
    """
    if engine == "CYCLES" and hasattr(scene, "cycles"):
        kind = scene.cycles.pixel_filter_type
        if kind == "BOX":
            return PixelFilter(kind, 0.5)
        stretch = {"GAUSSIAN": 1.5, "BLACKMAN_HARRIS": 1.0}[kind]
        return PixelFilter(kind, stretch * scene.cycles.filter_width)
    return PixelFilter("BLACKMAN_HARRIS", min(max(float(scene.render.filter_size), 0.0), LARGEST_RADIUS))
