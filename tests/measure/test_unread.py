"""A surface of unread opacity: the truth lies between clear and opaque, and the interval holds all of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.bake import BakeJob
from strata.addon.core.arrays import CLEAR
from strata.addon.core.material import Material
from strata.addon.core.metrics import mean_brightness
from strata.addon.core.outline import Instances
from strata.addon.core.shot import Camera, PixelFilter, Raster, Shot
from strata.addon.measure.report import LayerError
from strata.addon.measure.report_text import format_table
from strata.addon.measure.unread import between
from strata.addon.planning import Options, plan_scene
from strata.tests.support.flat_scenes import DOWN, FLOOR, PLATE, lamp, scene_of

SHOT = Shot(
    "Camera",
    Raster(Camera("Camera", (0.0, 0.0, 8.0), **DOWN), (48, 48)),
    PixelFilter("BLACKMAN_HARRIS", 0.75),
)
OTHER_PLATE = ((-2.4, -2.4, 1.2), (-1.6, -1.6, 1.2))
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def job_of(unread: bool, clear: bool = False, visible: bool = False, **options) -> BakeJob:
    """A floor under two plates, of which the first may be unread, and may not really be there."""
    outline, arrays = scene_of([FLOOR, PLATE, OTHER_PLATE], [lamp()])
    floor, plate, other = outline.instances
    plate = replace(plate, materials=(1,), visible_camera=visible)
    materials = Material("Grey"), Material("Unread", unread_opacity=unread)
    outline = replace(outline, instances=Instances((floor, plate, other)), materials=materials)
    grey = arrays.opacities[0]
    arrays = replace(arrays, opacities=(grey, CLEAR if clear else grey))
    how = Options(("soft_shadow",), "cpu", **{"samples": 4, "probes": 1024, **options})
    return BakeJob(outline, plan_scene(outline, SHOT, how), arrays, how)


@pytest.mark.parametrize("visible", [False, True])
def test_the_interval_reaches_from_opaque_to_clear(visible):
    baked = job_of(True, visible=visible).result()
    (layer,) = baked.layers.layers
    error, plain = layer.error, job_of(False, visible=visible).result().layers.layers[0].error
    assert error["value"] == plain["value"]  # as it was read
    assert "unread" not in plain
    truth = job_of(False, clear=True, visible=visible, samples=64, probes=0, lit=True).result()
    light = truth.lit[0][..., :3] @ LUMINANCE
    difference = (layer.pixels - truth.layers.layers[0].pixels) * light
    farthest = np.sqrt(np.mean((difference / (light + mean_brightness(light))) ** 2))
    low, high = error["ci95"]
    assert low <= plain["value"] <= farthest <= high < 1.3 * farthest
    assert error["unread"] == pytest.approx(np.sqrt(high**2 - plain["ci95"][1] ** 2), rel=0.05)
    (entry,) = baked.report.layers
    assert "since a material's opacity is not read" in entry.words


def test_what_is_missing_leaves_the_interval_without_an_upper_end():
    """A library of which nobody knows what it holds."""
    job, plain = job_of(False), job_of(False).result().layers.layers[0].error
    lines = ("library '//props.blend' is missing",)
    job.outline = replace(job.outline, warnings=lines, unknown=lines)
    baked = job.result()
    (layer,) = baked.layers.layers
    assert layer.error["value"] == plain["value"]
    assert layer.error["ci95"] == [plain["ci95"][0], None]
    assert layer.error["unknown"] == list(lines)
    (entry,) = baked.report.layers
    assert entry.verdict.endswith("perhaps visible")
    assert "since part of the scene is not read" in entry.words
    assert " or more" in format_table(baked.report)


def test_what_no_ray_of_a_layer_meets_changes_nothing():
    """The unread plate lets light pass and nobody sees it."""
    job = job_of(True)
    floor, plate, other = job.outline.instances
    outline = replace(job.outline, instances=Instances((floor, replace(plate, casts_shadow=False), other)))
    how = job.options
    _, arrays = scene_of([FLOOR, PLATE, OTHER_PLATE], [lamp()])
    arrays = replace(arrays, opacities=(arrays.opacities[0],) * 2)
    (layer,) = BakeJob(outline, plan_scene(outline, SHOT, how), arrays, how).result().layers.layers
    assert "unread" not in layer.error


def test_a_tint_counts_as_what_is_not_read():
    """Of light that comes through in colour the layer has the luminance."""
    job = job_of(False)
    materials = job.outline.materials[0], replace(job.outline.materials[1], tints=("Transparent BSDF",))
    job.outline = replace(job.outline, materials=materials)
    (layer,) = job.result().layers.layers
    assert layer.error["unread"] > 0.0
    assert layer.error["ci95"] == job_of(True).result().layers.layers[0].error["ci95"]


def error_of(value, low, high) -> LayerError:
    return LayerError("in use", value, (low, high), 0.0, value, value, 9, "rays", 0.0, 1.0)


def test_between_takes_the_nearest_and_the_farthest():
    found = between(error_of(0.02, 0.01, 0.03), error_of(0.3, 0.25, 0.5))
    assert (found.value, found.ci95) == (0.02, (0.01, 0.5))
    assert found.unread == pytest.approx(np.sqrt(0.5**2 - 0.03**2))
    assert between(error_of(0.02, 0.01, 0.03), error_of(0.01, 0.0, 0.02)).ci95 == (0.0, 0.03)
    assert between(error_of(0.02, 0.01, 0.03), error_of(0.01, 0.0, 0.02)).unread == 0.0
