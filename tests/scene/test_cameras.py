"""Cameras against Blender's own projection matrices, and the size of what Blender renders."""

from __future__ import annotations

import random

import bpy
import mathutils
import numpy as np
import OpenEXR
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.core.outline import Outline
from strata.addon.core.sampling import jitters
from strata.addon.core.shot import Camera, Raster
from strata.addon.core.view import View
from strata.addon.scene.cameras import camera_of, viewport_camera
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.addon.scene.scan import ScanOptions, scan


@pytest.fixture
def scene():
    bpy.ops.wm.read_factory_settings()
    return bpy.context.scene


def clip_matrix(view: View) -> np.ndarray:
    """World to clip space, as OpenGL's glFrustum and glOrtho have it."""
    left, right, bottom, top = view.window
    near, far = view.near, view.far
    sx, sy, sz = 2.0 / (right - left), 2.0 / (top - bottom), 2.0 / (far - near)
    cx, cy, cz = (right + left) / (right - left), (top + bottom) / (top - bottom), (far + near) / (far - near)
    if view.orthographic:
        clip = np.array([[sx, 0, 0, -cx], [0, sy, 0, -cy], [0, 0, -sz, -cz], [0, 0, 0, 1]])
    else:
        clip = np.array([[sx, 0, cx, 0], [0, sy, cy, 0], [0, 0, -cz, -sz * near * far], [0, 0, -1, 0]])
    to_view = np.eye(4)
    to_view[:3, :3] = [view.right, view.up, [-f for f in view.forward]]
    to_view[:3, 3] = -to_view[:3, :3] @ view.eye
    return clip @ to_view


def randomise(camera, generator: random.Random) -> None:
    data = camera.data
    data.type = generator.choice(["PERSP", "ORTHO"])
    data.sensor_fit = generator.choice(["AUTO", "HORIZONTAL", "VERTICAL"])
    data.lens, data.ortho_scale = generator.uniform(10, 100), generator.uniform(1, 9)
    data.sensor_width, data.sensor_height = generator.uniform(10, 50), generator.uniform(10, 50)
    data.shift_x, data.shift_y = generator.uniform(-0.5, 0.5), generator.uniform(-0.5, 0.5)
    data.clip_start, data.clip_end = generator.uniform(0.01, 1.0), generator.uniform(10, 1000)
    camera.location = [generator.uniform(-9, 9) for _ in range(3)]
    camera.rotation_euler = [generator.uniform(-3, 3) for _ in range(3)]
    camera.scale = [generator.uniform(0.5, 2)] * 3


def test_views_are_blenders_own(scene):
    generator = random.Random(1)
    for _ in range(100):
        randomise(scene.camera, generator)
        width, height = generator.randint(4, 200), generator.randint(4, 200)
        aspect = generator.choice([(1.0, 1.0), (1.0, 2.0), (1.5, 1.0)])
        depsgraph = bpy.context.evaluated_depsgraph_get()
        evaluated = scene.camera.evaluated_get(depsgraph)
        view = camera_of(evaluated).view(width, height, aspect)
        theirs = evaluated.calc_matrix_camera(
            depsgraph, x=width, y=height, scale_x=aspect[0], scale_y=aspect[1]
        )
        to_view = evaluated.matrix_world.normalized().inverted()
        expected = np.array(theirs, np.float64) @ np.array(to_view, np.float64)
        # Blender computes in float32.
        np.testing.assert_allclose(clip_matrix(view), expected, rtol=2e-5, atol=2e-5 * np.abs(expected).max())


def test_a_viewport_is_a_camera_too(scene):
    generator = random.Random(2)
    for _ in range(50):
        randomise(scene.camera, generator)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        window = scene.camera.calc_matrix_camera(depsgraph, x=120, y=80)
        to_view = scene.camera.matrix_world.normalized().inverted()
        view = viewport_camera(to_view, window).view(120, 80)
        expected = np.array(window, np.float64) @ np.array(to_view, np.float64)
        np.testing.assert_allclose(clip_matrix(view), expected, rtol=2e-5, atol=2e-5 * np.abs(expected).max())


def test_unusable_cameras_are_refused(scene):
    for change, message in [
        (lambda camera: setattr(camera.data, "type", "PANO"), "panoramic"),
        (lambda camera: setattr(camera, "scale", (1.0, 0.0, 1.0)), "singular"),
        (lambda camera: setattr(camera.data, "clip_start", 2.0 * camera.data.clip_end), "clips everything"),
    ]:
        bpy.ops.wm.read_factory_settings()
        camera = bpy.context.scene.camera
        change(camera)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        with pytest.raises(StrataError, match=message):
            camera_of(camera.evaluated_get(depsgraph))
    with pytest.raises(StrataError, match="not a camera"):
        camera_of(bpy.data.objects["Cube"])


def _shot(scene, **options):
    def look(depsgraph):
        return scan(depsgraph, ScanOptions(**options)).shot

    return with_render_depsgraph(scene, scene.view_layers[0], look)


@pytest.mark.parametrize("border", [(0.1, 0.9, 0.25, 0.7), (0.333, 0.335, 0.0, 1.0), (0.0, 0.5, 0.499, 1.0)])
def test_the_render_region_is_blenders(scene, tmp_path, border):
    render = scene.render
    render.engine = "CYCLES"
    scene.cycles.samples = 1
    render.resolution_x, render.resolution_y, render.resolution_percentage = 1237, 413, 33
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = border
    render.image_settings.file_format = "OPEN_EXR"
    render.filepath = str(tmp_path / "crop.exr")
    shot = _shot(scene)
    bpy.ops.render.render(write_still=True)
    with OpenEXR.File(render.filepath) as file:
        height, width = next(iter(file.channels().values())).pixels.shape[:2]
    assert shot.size == (width, height)
    # The part is where it is in the whole: pixel centres of both views agree.
    x0, y0 = shot.source.region[:2]
    whole = shot.source.camera.view(*shot.source.frame_size)
    step = (whole.window[1] - whole.window[0]) / shot.source.frame_size[0]
    assert shot.view.window[0] == pytest.approx(whole.window[0] + x0 * step)
    assert shot.view.window[2] == pytest.approx(whole.window[2] + y0 * step)
    assert (shot.view.window[1] - shot.view.window[0]) / width == pytest.approx(step)


def test_size_region_and_filter(scene):
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 101, 51, 50
    assert _shot(scene).size == (50, 25)
    assert _shot(scene, size=(30, 20)).size == (30, 20)
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.2, 0.6, 0.5, 1.0
    shot = _shot(scene, size=(10, 10))
    assert (shot.size, shot.source.region) == ((10, 10), (2, 5, 6, 10))
    render.border_max_x = 0.201
    with pytest.raises(StrataError, match="region has no pixels"):
        _shot(scene)
    render.use_border = False
    render.engine = "CYCLES"
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "GAUSSIAN", 2.0
    assert (_shot(scene).pixel_filter.kind, _shot(scene).pixel_filter.radius) == ("GAUSSIAN", 3.0)
    scene.cycles.pixel_filter_type = "BOX"
    assert _shot(scene).pixel_filter.radius == 0.5
    render.engine, render.filter_size = "BLENDER_EEVEE", 1.25
    assert _shot(scene).pixel_filter.radius == 1.25
    render.filter_size = 500.0
    assert _shot(scene).pixel_filter.radius == 64.0
    render.filter_size = 0.0
    assert (jitters(_shot(scene).pixel_filter, 8) == 0.0).all()


def test_a_camera_by_name_and_one_by_marker(scene):
    other = bpy.data.objects.new("Other", bpy.data.cameras.new("Other"))
    other.location = (1.0, 2.0, 3.0)
    scene.collection.objects.link(other)
    bound = bpy.data.objects.new("Bound", bpy.data.cameras.new("Bound"))
    scene.collection.objects.link(bound)

    def name_at(frame, camera=None):
        return with_render_depsgraph(
            scene,
            scene.view_layers[0],
            lambda depsgraph: scan(depsgraph, ScanOptions(camera=camera)).shot.name,
            frame,
            camera and bpy.data.objects[camera],
        )

    assert name_at(1) == "Camera"
    marker = scene.timeline_markers.new("m", frame=5)
    marker.camera = bound
    scene.camera = bpy.data.objects["Camera"]
    assert name_at(6) == "Bound"
    assert name_at(6, "Other") == "Other"
    assert marker.camera == bound
    assert scene.camera.name == "Camera"


def test_shapes_of_the_header():
    raster = Raster(Camera("c", (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, -1)), (4, 2))
    assert Outline("s", "v", 1).triangles == 0
    with pytest.raises(StrataError, match="no pixels"):
        Raster(raster.camera, (0, 2))
    assert mathutils.Vector(raster.view.forward) == mathutils.Vector((0, 0, -1))
