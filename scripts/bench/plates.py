"""Plates over a ground, each kind of light: layers against closed forms (tests/support/closed_forms.py)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
import numpy as np
from strata.addon.core.emitter import EmitterKind
from strata.addon.core.metrics import maximum, quantile
from strata.tests.support.closed_forms import visibility
from strata.tests.support.figures import weighted_bias, weighted_rmse

from .methods import Effect, surface_of
from .scenes import read

SIZE = (480, 270)

# Centre, half sizes and turn about Z of plates, metres: one alone, and two that overlap for the light.
ONE_PLATE = (((0.0, 0.0, 0.6), (0.7, 0.5), 0.3),)
TWO_PLATES = (*ONE_PLATE, ((0.35, 0.2, 1.1), (0.5, 0.6), 0.9))

LIGHTS = {
    "rectangle": ("AREA", {"shape": "RECTANGLE", "size": 0.8, "size_y": 0.5}),
    "ellipse": ("AREA", {"shape": "ELLIPSE", "size": 0.8, "size_y": 0.5}),
    "sphere": ("POINT", {"shadow_soft_size": 0.3, "use_soft_falloff": False}),
    "disk that faces the point": ("POINT", {"shadow_soft_size": 0.3, "use_soft_falloff": True}),
    "sun": ("SUN", {"angle": math.radians(6.0)}),
}


def _corners(centre, half, turn) -> np.ndarray:
    plan = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    return np.column_stack([plan @ rotation.T, np.zeros(4)]) + centre


def _polygon(name: str, corners: np.ndarray) -> None:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners.tolist(), [], [tuple(range(len(corners)))])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))


def _scene(kind: str, settings: dict, plates) -> bpy.types.Scene:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _polygon("Ground", _corners((0, 0, 0), (3, 3), 0))
    for number, plate in enumerate(plates):
        _polygon(f"Plate {number}", _corners(*plate))
    data = bpy.data.lights.new("Light", kind)
    for name, value in settings.items():
        setattr(data, name, value)
    light = bpy.data.objects.new("Light", data)
    light.location = (0.5, -0.4, 2.6)
    light.rotation_euler = (math.radians(8.0), math.radians(9.0), 0.4)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    # From below the plates' height and aside, so that most of the frame is ground in penumbra.
    camera.location, camera.rotation_euler = (0.0, -3.4, 2.4), (math.radians(55.0), 0.0, 0.0)
    scene.collection.objects.link(light)
    scene.collection.objects.link(camera)
    scene.camera = camera
    bpy.context.view_layer.update()
    return scene


def ground_under(kind: str, settings: dict) -> bpy.types.Scene:
    """A bare ground with one light, Cycles' white material on it."""
    return _scene(kind, settings, ())


@dataclass(frozen=True)
class PlateError:
    """Errors over the ground in view."""

    light: str
    plates: int
    method: str
    rmse: float
    bias: float
    p99: float
    largest: float


def measure(method: str, size=SIZE) -> list[PlateError]:
    """Every light over one and two plates, at default settings but the method."""
    found = []
    for name, (kind, settings) in LIGHTS.items():
        for plates in (ONE_PLATE, TWO_PLATES):
            case = read(_scene(kind, settings, plates), size)
            effect = Effect(case, {"method": method})
            effect()
            surface, hit = surface_of(case)
            world = surface.position.astype(np.float64) + case.eye
            ground = np.flatnonzero(hit.ravel() & (np.abs(world[:, 2]) < 1e-4))
            up = np.tile([0.0, 0.0, 1.0], (len(ground), 1))
            emitter = case.outline.lights[0].emitter
            truth, weight = _truth(emitter, world[ground], up, [_corners(*plate) for plate in plates])
            errors = effect.visibility.ravel()[ground] - truth
            found.append(
                PlateError(
                    name,
                    len(plates),
                    method,
                    weighted_rmse(errors, weight),
                    weighted_bias(errors, weight),
                    quantile(errors, weight, 0.99),
                    maximum(errors, weight),
                )
            )
    return found


def _truth(emitter, points, normals, plates):
    """The ellipse's closed form goes point by point, so it is taken at some of them only."""
    if emitter.kind == EmitterKind.ELLIPSE:
        truth, weight = np.zeros(len(points)), np.zeros(len(points))
        some = np.arange(0, len(points), max(1, len(points) // 1500))
        truth[some], weight[some] = visibility(emitter, points[some], normals[some], plates)
        return truth, weight
    return visibility(emitter, points, normals, plates)
