"""What scales a lamp besides its shadow, joined by nodes: rendered, and compared with the layers by hand."""

from __future__ import annotations

import numpy as np
from strata.addon.bake import bake
from strata.addon.core.roles import Role
from strata.addon.layers.compositor import build
from strata.addon.layers.exr import write_layers
from strata.addon.layers.exr_header import header_of
from strata.addon.planning import Options
from strata.tests.layers.compositor.scene import COMBINED, GROUP, SIZE, composited, lamps
from strata.tests.support.tiny_effects import GOBO, HALF_SHADOW, gobo, registry

ALL = registry(GOBO, HALF_SHADOW, gobo("Soft"), gobo("Smoke", Role.TRANSMITTANCE))


def baked(scene, tmp_path, *effects: str, **options):
    """Layers of each lamp by its name, and what was built of them."""
    path = tmp_path / "roles.exr"
    how = Options(effects, "cpu", **{"samples": 1, "probes": 0, "registry": ALL} | options)
    layers = bake(scene, scene.view_layers[0], how, size=SIZE).layers
    write_layers(path, layers)
    made = build(scene, {scene.view_layers[0]: path}, False, False, registry=ALL)
    of_lamps: dict[str, dict[str, np.ndarray]] = {}
    for layer in layers.layers:
        pixels = layer.pixels if layer.pixels.ndim == 3 else layer.pixels[..., None]
        of_lamps.setdefault(layer.light, {})[layer.effect] = pixels.astype(np.float64)
    return made, of_lamps


def test_filters_in_colour_and_shadows_are_multiplied_onto_a_lamps_group(scene, tmp_path):
    made, of_lamps = baked(scene, tmp_path, "soft_shadow", "gobo")
    assert len(of_lamps) > 2
    assert made.joined[0].startswith("Gobo ")
    assert not made.others
    expected = COMBINED + GROUP * sum(
        found["gobo"] * found.get("soft_shadow", 1.0) - 1.0 for found in of_lamps.values()
    )
    image = composited(scene, tmp_path)[:, :, :3]
    np.testing.assert_allclose(image, expected, atol=1e-6)  # a few roundings of float32
    assert np.ptp(expected, axis=2).max() > 0.05
    shadowed = {name for name, found in of_lamps.items() if "soft_shadow" in found}
    assert {name for name, lamp in lamps(scene).items() if not lamp.data.use_shadow} == shadowed


def test_shadows_in_colour_are_multiplied_onto_a_lamps_group(scene, tmp_path):
    made, of_lamps = baked(scene, tmp_path, "soft_shadow", rgb_layers=True, samples=4)
    assert len(made.joined) == len(of_lamps)
    expected = COMBINED + GROUP * sum(found["soft_shadow"] - 1.0 for found in of_lamps.values())
    assert np.ptp(expected, axis=2).max() > 0.001
    np.testing.assert_allclose(composited(scene, tmp_path)[:, :, :3], expected, atol=1e-6)


def test_a_lamp_that_only_has_a_filter_keeps_its_shadow(scene, tmp_path):
    made, of_lamps = baked(scene, tmp_path, "gobo")
    assert not made.switched
    assert all(lamp.data.use_shadow for lamp in lamps(scene).values())
    expected = COMBINED + GROUP * sum(found["gobo"] - 1.0 for found in of_lamps.values())
    np.testing.assert_allclose(composited(scene, tmp_path)[:, :, :3], expected, atol=1e-6)


def test_what_a_lamps_light_passes_is_multiplied_onto_its_group_too(scene, tmp_path):
    made, of_lamps = baked(scene, tmp_path, "smoke")
    assert len(made.joined) == len(of_lamps)
    assert not made.others
    expected = COMBINED + GROUP * sum(found["smoke"] - 1.0 for found in of_lamps.values())
    np.testing.assert_allclose(composited(scene, tmp_path)[:, :, :3], expected, atol=1e-6)


def test_a_filter_whose_name_begins_as_a_shadows_is_no_part_of_it(scene, tmp_path):
    made, of_lamps = baked(scene, tmp_path, "soft_shadow", "soft")
    assert not made.apart
    assert len(made.joined) == sum(map(len, of_lamps.values()))


def test_of_two_shadows_of_a_lamp_one_is_joined(scene, tmp_path):
    made, of_lamps = baked(scene, tmp_path, "soft_shadow", "half_shadow", keeps_unused=True)
    assert all(name.startswith("Soft Shadow ") for name in made.joined)
    assert all(name.startswith("Half Shadow ") for name in made.others)
    assert made.others
    masks = [found["soft_shadow"] for found in of_lamps.values() if "soft_shadow" in found]
    expected = np.broadcast_to(COMBINED + GROUP * sum(mask - 1.0 for mask in masks), (SIZE[1], SIZE[0], 3))
    np.testing.assert_allclose(composited(scene, tmp_path)[:, :, :3], expected, atol=1e-6)


def test_images_of_errors_have_no_part_in_it(scene, tmp_path):
    made, of_lamps = baked(scene, tmp_path, "soft_shadow", probes=16, error_images=True)
    report = header_of(tmp_path / "roles.exr").json("strata:report")
    names = {layer["error_image"] for layer in report["layers"]}
    there = header_of(tmp_path / "roles.exr").passes[scene.view_layers[0].name]
    assert len(names) == len(of_lamps)
    assert names < there
    assert set(made.joined) == there - names
    assert not made.others
    masks = [found["soft_shadow"] for found in of_lamps.values()]
    expected = np.broadcast_to(COMBINED + GROUP * sum(mask - 1.0 for mask in masks), (SIZE[1], SIZE[0], 3))
    np.testing.assert_allclose(composited(scene, tmp_path)[:, :, :3], expected, atol=1e-6)
