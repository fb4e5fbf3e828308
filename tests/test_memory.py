"""Memory: layers worked off in groups of lamps are the same bits, within a bound, and told before."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest
from strata.addon.bake import Options, bake
from strata.addon.effects.registry import EFFECTS

ENDLESS = 1 << 50
SIZE = (64, 35)  # of no whole tile


def street(lamps: int = 3) -> bpy.types.Scene:
    """Boxes on a plain under point lamps in a row."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=40.0)
    for number in range(lamps):
        x = 3.0 * (number - 0.5 * (lamps - 1))
        bpy.ops.mesh.primitive_cube_add(size=1.5, location=(x, 1.0, 0.75))
        data = bpy.data.lights.new("Lamp", "POINT")
        data.energy, data.shadow_soft_size = 100.0, 0.2
        lamp = bpy.data.objects.new("Lamp", data)
        lamp.location = (x + 0.5, -1.0, 3.0)
        scene.collection.objects.link(lamp)
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.location, scene.camera.rotation_euler = (0.0, -9.0, 6.0), (0.96, 0.0, 0.0)
    scene.collection.objects.link(scene.camera)
    return scene


def options(**more) -> Options:
    values = {
        "soft_shadow": {"resolution": 128},
        "volumetric_light": {"use_scene_medium": False, "light_samples": 1, "resolution": 64},
        "toon": {"halftone": True},
    }
    return Options(values=values, **{"samples": 3, "probes": 0, "composite": True} | more)


@pytest.mark.parametrize(
    "effects", [tuple(effect.id for effect in EFFECTS), ("soft_shadow", "volumetric_light")]
)
def test_layers_are_the_same_bits_whatever_the_budget(backend, effects, monkeypatch):
    monkeypatch.setattr("strata.addon.core.sampling.PIXELS_PER_TILE", SIZE[0] * 11)
    scene = street()
    how = options(effects=effects, backend=backend, memory_bytes=ENDLESS)
    whole = bake(scene, scene.view_layers[0], how, size=SIZE)
    few = bake(scene, scene.view_layers[0], replace(how, memory_bytes=1), size=SIZE)
    assert whole.layers.report["memory"]["groups"] == 1
    assert few.layers.report["memory"]["groups"] >= 6
    assert len(whole.layers.layers) >= 7
    assert [layer.name for layer in whole.layers.layers] == [layer.name for layer in few.layers.layers]
    for one, other in zip(whole.layers.layers, few.layers.layers, strict=True):
        assert one.pixels.tobytes() == other.pixels.tobytes(), one.name
    # The picture is a sum over lamps and samples in another order: as many roundings of half an ulp each as
    # there are lamps, terms and samples, about 30, of numbers below its largest.
    assert whole.composite.max() > 0.1
    assert np.abs(few.composite - whole.composite).max() <= 32 * 2.0**-24 * whole.composite.max()


def test_errors_are_measured_alike_in_groups():
    scene = street()
    how = options(effects=("soft_shadow", "volumetric_light"), backend="cpu", samples=1, probes=32)
    whole, few = (
        bake(scene, scene.view_layers[0], replace(how, memory_bytes=budget), size=SIZE)
        for budget in (ENDLESS, 1)
    )
    for one, other in zip(whole.layers.layers, few.layers.layers, strict=True):
        assert one.error.pop("seconds") > 0.0 < other.error.pop("seconds")
        assert one.error == other.error, one.name
    assert any("memory" in warning for warning in few.layers.report["warnings"])
    assert not any("memory" in warning for warning in whole.layers.report["warnings"])
