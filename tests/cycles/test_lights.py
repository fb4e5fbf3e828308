"""Radiometry: our Light, integrated in float64, against Cycles on a white diffuse plane."""

from __future__ import annotations

import math

import bpy
import mathutils
import numpy as np
import OpenEXR
import pytest
from strata.addon.core.emitter import EmitterKind
from strata.addon.core.outline import Light, emitter_measure
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.addon.scene.scan import scan

SIDE = 8  # pixels
EXTENT = 4.0  # metres that the image shows of the plane


def relative_radiance(emitter, directions):
    """By the formulas of `Emitter`; `directions` (..., 3) unit, from the light to the point."""
    cosine = directions @ np.array(emitter.forward)
    if emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE):
        if math.isinf(emitter.tan_half_spread):
            return (cosine > 0.0).astype(float)
        tangent = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, 1e-12)
        half = emitter.tan_half_spread
        return np.where(cosine > 0.0, np.maximum(half - tangent, 0.0) / (half - math.atan(half)), 0.0)
    if emitter.cos_cone <= -1.0:
        return np.ones_like(cosine)
    t = np.clip((cosine - emitter.cos_cone) / max((1.0 - emitter.cos_cone) * emitter.blend, 1e-12), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _disk(count):
    """Midpoints (count², 2) of cells of equal area on the unit disk."""
    radii = np.sqrt((np.arange(count) + 0.5) / count)
    angles = (np.arange(count) + 0.5) / count * 2.0 * math.pi
    r, a = np.meshgrid(radii, angles)
    return np.stack([r * np.cos(a), r * np.sin(a)], -1).reshape(-1, 2)


def _frame(axis):
    other = np.eye(3)[np.argmin(np.abs(axis))]
    u = np.cross(axis, other)
    u /= np.linalg.norm(u)
    return u, np.cross(axis, u)


def _cone(axis, half_angle, count):
    """Directions (count², 3), each of the same solid angle, that fill a cone; and the cone's solid angle."""
    u, v = _frame(axis)
    disk = _disk(count)
    cosine = 1.0 - (1.0 - math.cos(half_angle)) * (disk**2).sum(1, keepdims=True)
    around = disk / np.linalg.norm(disk, axis=1, keepdims=True)
    directions = axis * cosine + np.sqrt(1.0 - cosine**2) * (around[:, :1] * u + around[:, 1:] * v)
    return directions, 2.0 * math.pi * (1.0 - math.cos(half_angle))


def irradiance(light: Light, point, normal=(0.0, 0.0, 1.0), count=64):
    """∫ radiance · cos⁺ · G dA by a midpoint rule; (3,)."""
    emitter, intensity = light.emitter, np.array(light.intensity)
    point, normal, centre = (np.array(v, float) for v in (point, normal, emitter.centre))
    right, up, forward = (np.array(v) for v in (emitter.right, emitter.up, emitter.forward))
    measure = emitter_measure(emitter)
    if emitter.kind is EmitterKind.DISTANT_DISK:
        if measure == 0.0:
            return intensity * max(-forward @ normal, 0.0)
        to_light, solid_angle = _cone(-forward, math.atan(emitter.half_width), count)
        return intensity / measure * solid_angle * np.maximum(to_light @ normal, 0.0).mean()
    away = centre - point
    distance = np.linalg.norm(away)
    if measure == 0.0:
        relative = relative_radiance(emitter, -away[None] / distance)[0]
        return intensity * relative * max(away @ normal, 0.0) / distance**3
    if emitter.kind is EmitterKind.SPHERE:
        to_light, solid_angle = _cone(away / distance, math.asin(emitter.half_width / distance), count)
        shaded = relative_radiance(emitter, -to_light) * np.maximum(to_light @ normal, 0.0)
        return intensity / measure * solid_angle * shaded.mean()
    if emitter.kind is EmitterKind.FACING_DISK:
        forward = -away / distance
        right, up = _frame(forward)
    if emitter.kind is EmitterKind.RECTANGLE:
        ticks = (np.arange(count) + 0.5) / count * 2.0 - 1.0
        places = np.stack(np.meshgrid(ticks, ticks), -1).reshape(-1, 2)
    else:
        places = _disk(count)
    samples = places[:, :1] * emitter.half_width * right + places[:, 1:] * emitter.half_height * up + away
    squared = (samples**2).sum(1)
    to_light = samples / np.sqrt(squared)[:, None]
    geometry = np.maximum(-to_light @ forward, 0.0) / squared
    shaded = relative_radiance(emitter, -to_light) * np.maximum(to_light @ normal, 0.0) * geometry
    return intensity * shaded.mean()


@pytest.fixture
def plane_scene(tmp_path):
    """An orthographic camera straight above a white diffuse plane; Cycles, direct light only."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.samples, cycles.use_adaptive_sampling, cycles.use_denoising, cycles.max_bounces = (
        1024,
        False,
        False,
        0,
    )
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 0.01
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGB", "32"
    scene.render.filepath = str(tmp_path / "cycles.exr")
    mesh = bpy.data.meshes.new("Plane")
    mesh.from_pydata([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("White")
    nodes = material.node_tree.nodes
    nodes.clear()
    diffuse, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    material.node_tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", EXTENT, (0.0, 0.0, 30.0)
    scene.camera = camera
    for thing in (bpy.data.objects.new("Plane", mesh), camera):
        scene.collection.objects.link(thing)
    return scene


def cycles_image(scene) -> np.ndarray:
    """(SIDE, SIDE, 3), row 0 at the bottom."""
    bpy.ops.render.render(write_still=True)
    with OpenEXR.File(scene.render.filepath) as file:
        return np.array(file.channels()["RGB"].pixels, np.float64)[::-1]


def pixel_points() -> np.ndarray:
    ticks = ((np.arange(SIDE) + 0.5) / SIDE - 0.5) * EXTENT
    return np.array([[(x, y, 0.0) for x in ticks] for y in ticks])


def add_light(
    scene, kind, location=(0.7, -0.4, 3.0), target=(0.2, 0.3, 0.0), scale=(1.0, 1.0, 1.0), **values
):
    data = bpy.data.lights.new("Light", kind)
    for name, value in values.pop("nodes", {}).items():
        data.node_tree.nodes["Emission"].inputs[name].default_value = value
    for name, value in values.items():
        setattr(data, name, value)
    light = bpy.data.objects.new("Light", data)
    away = mathutils.Vector(location) - mathutils.Vector(target)
    light.matrix_world = mathutils.Matrix.LocRotScale(location, away.to_track_quat("Z", "Y"), scale)
    scene.collection.objects.link(light)
    return light


def scanned(scene):
    return with_render_depsgraph(scene, scene.view_layers[0], lambda depsgraph: scan(depsgraph).outline)


SUN = {"kind": "SUN", "energy": 3.0}
POINT = {"kind": "POINT", "energy": 100.0}
SPOT = {"kind": "SPOT", "energy": 100.0, "shadow_soft_size": 0.3}
AREA = {"kind": "AREA", "energy": 50.0}
CASES = {
    "sun, a point": {**SUN, "angle": 0.0},
    "sun, 5 degrees": {**SUN, "angle": math.radians(5.0)},
    "sun, 60 degrees": {**SUN, "angle": math.radians(60.0)},
    "sun, not normalised": {**SUN, "angle": math.radians(5.0), "normalize": False},
    "point, no radius": {**POINT, "shadow_soft_size": 0.0},
    "point, soft": {**POINT, "shadow_soft_size": 0.8, "use_soft_falloff": True},
    "point, sphere": {**POINT, "shadow_soft_size": 0.8, "use_soft_falloff": False},
    "point, small": {**POINT, "shadow_soft_size": 0.1, "use_soft_falloff": False},
    "point, scaled": {**POINT, "shadow_soft_size": 0.8, "scale": (0.5, 2.0, 3.0)},
    "point, not normalised": {**POINT, "shadow_soft_size": 0.5, "normalize": False},
    "point, no radius, not normalised": {**POINT, "shadow_soft_size": 0.0, "normalize": False},
    "spot, blend": {**SPOT, "spot_size": 1.0, "spot_blend": 0.6, "use_soft_falloff": True},
    "spot, sphere": {**SPOT, "spot_size": 1.0, "spot_blend": 1.0, "use_soft_falloff": False},
    "spot, scaled evenly": {**SPOT, "spot_size": 1.2, "spot_blend": 0.8, "scale": (2.0, 2.0, 2.0)},
    "area, square": {**AREA, "shape": "SQUARE", "size": 1.0},
    "area, rectangle": {**AREA, "shape": "RECTANGLE", "size": 1.0, "size_y": 0.3},
    "area, disk": {**AREA, "shape": "DISK", "size": 1.2},
    "area, ellipse, scaled": {
        **AREA,
        "shape": "ELLIPSE",
        "size": 1.2,
        "size_y": 0.5,
        "scale": (0.5, 2.0, 3.0),
    },
    "area, mirrored": {**AREA, "shape": "RECTANGLE", "size": 1.2, "size_y": 0.3, "scale": (-1.0, 1.0, 1.0)},
    "area, spread": {**AREA, "shape": "SQUARE", "size": 1.0, "spread": math.radians(60.0)},
    "area, disk, spread": {**AREA, "shape": "DISK", "size": 1.0, "spread": math.radians(120.0)},
    "area, not normalised": {**AREA, "shape": "DISK", "size": 0.5, "normalize": False},
    "exposure and colour": {**POINT, "shadow_soft_size": 0.1, "exposure": 1.5, "color": (1.0, 0.4, 0.1)},
    "temperature": {**AREA, "use_temperature": True, "temperature": 3000.0, "color": (0.5, 1.0, 1.0)},
    "emission node": {**AREA, "nodes": {"Strength": 2.5, "Color": (0.2, 0.9, 0.5, 1.0)}},
}


def test_colour_and_temperature_are_in_the_working_space(plane_scene):
    bpy.ops.wm.set_working_color_space(working_space="ACEScg")
    add_light(plane_scene, **{**CASES["temperature"], "size": 1e-3})
    (light,) = scanned(plane_scene).lights
    ours = irradiance(light, pixel_points()[4, 4]) / math.pi
    assert ours == pytest.approx(cycles_image(plane_scene)[4, 4], rel=5e-3)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_radiance_is_that_of_cycles(plane_scene, case):
    add_light(plane_scene, **case)
    (light,) = scanned(plane_scene).lights
    ours = np.array([[irradiance(light, point) for point in row] for row in pixel_points()]) / math.pi
    truth = cycles_image(plane_scene)
    assert truth.max() > 1e-3
    # 1024 Sobol samples leave about 0.1%, the midpoint rule less; dim edges are held to the image's scale.
    scale = np.maximum(truth, 0.1 * truth.max())
    assert np.abs((ours - truth) / scale).max() < 0.01
    assert ours.mean() == pytest.approx(truth.mean(), rel=2e-3)
