"""Layers of roles that no effect has yet, joined to a picture: against sums of the bake's own layers."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared import lit
from strata.addon.effects.shared.joins import Join
from strata.addon.planning import Options
from strata.addon.scene.open import choose, open_blend
from strata.tests.support.gpu_scenes import gpu_device
from strata.tests.support.places import SAMPLES
from strata.tests.support.tiny_effects import BEHIND, CROSSED_PANES, GOBO, HALF_SHADOW, LENS, registry

ALL = registry(BEHIND, GOBO, HALF_SHADOW, CROSSED_PANES, LENS)
CLOSE = {"rtol": 1e-4, "atol": 1e-5}
"""The composite rounds its sum of lamps in another order than the layers that it is compared with."""


def baked(backend: str, *effects: str, **options):
    open_blend(SAMPLES / "stacked.blend")
    chosen = choose()
    how = Options(effects, backend, samples=1, probes=0, lit=True, composite=True, registry=ALL, **options)
    found = bake(chosen.scene, chosen.view_layer, how, size=(60, 34))
    assert not [warning for warning in found.layers.report["warnings"] if "failed on gpu" in warning]
    return found, {layer.name: layer for layer in found.layers.layers}


def lamps(found, *titles: str) -> np.ndarray:
    """The sum of all lamps' unshadowed light times their layers called so."""
    total = 0.0
    for index, picture in found.lit.items():
        light = picture[..., :3].astype(np.float64)
        for layer in found.layers.layers:
            if layer.of.is_lamp and layer.of.index == index and layer.name.startswith(titles):
                light = light * (layer.pixels if layer.pixels.ndim == 3 else layer.pixels[..., None])
        total = total + light
    return total


def test_a_coloured_filter_and_a_shadow_scale_a_lamp(backend):
    found, layers = baked(backend, "soft_shadow", "gobo")
    gobos = [layer for name, layer in layers.items() if name.startswith("Gobo")]
    assert gobos
    assert np.ptp(gobos[0].pixels, axis=2).max() > 0.1
    expected = lamps(found, "Gobo", "Soft Shadow")
    assert np.allclose(found.composite[..., :3], expected, **CLOSE)
    assert not np.allclose(lamps(found, "Soft Shadow"), expected, rtol=0.1)


def test_a_surface_of_an_effects_own_changes_no_other_picture(backend):
    alone, others = baked(backend, "soft_shadow", "toon")
    found, layers = baked(backend, "behind", "soft_shadow", "toon")
    assert layers.keys() - others.keys() == {"Behind"}
    assert np.array_equal(found.composite, alone.composite)
    assert found.lit.keys() == alone.lit.keys()
    assert all(np.array_equal(found.lit[index], alone.lit[index]) for index in alone.lit)
    assert all(np.array_equal(layers[name].pixels, others[name].pixels) for name in others)


def test_of_two_shadows_of_a_lamp_one_is_multiplied(backend):
    found, layers = baked(backend, "soft_shadow", "half_shadow", keeps_unused=True)
    assert {name.partition(" ")[0] for name in layers} == {"Soft", "Half"}
    assert np.allclose(found.composite[..., :3], lamps(found, "Soft Shadow"), **CLOSE)
    told = {entry["name"]: entry.get("joins") for entry in found.layers.report["layers"]}
    assert all(told[name] is (None if name.startswith("Soft") else False) for name in layers)


def test_crossed_panes_cover_each_other_by_depth(backend):
    found, layers = baked(backend, "soft_shadow", "crossed_panes")
    red, blue = (layers[name].pixels.astype(np.float64) for name in ("Red Pane", "Blue Pane"))
    under = np.concatenate([lamps(found, "Soft Shadow"), next(iter(found.lit.values()))[..., 3:]], axis=2)

    def over(layer, below):
        return layer + (1.0 - layer[..., 3:]) * below

    red_first, blue_first = over(red, over(blue, under)), over(blue, over(red, under))
    is_red, is_blue = (
        np.isclose(found.composite, expected, **CLOSE).all(axis=2) for expected in (red_first, blue_first)
    )
    assert (is_red | is_blue).all()
    assert is_red.mean() > 0.1
    assert is_blue.mean() > 0.1
    left, right = is_red[:, :5].mean(), is_red[:, -5:].mean()
    assert left != right  # each is before the other on its side


@pytest.mark.parametrize("count", [2, 5, 9])
@pytest.mark.parametrize("is_rest", [True, False])
def test_joins_of_many_images_are_those_of_numpy(backend, count, is_rest):
    device = CpuDevice() if backend == "cpu" else gpu_device()
    rng = np.random.default_rng(count)
    shape = (7, 10)
    albedo = rng.uniform(0.1, 1.0, (*shape, 4)).astype(np.float32)
    arriving = rng.uniform(0.1, 1.0, shape).astype(np.float32)
    factors = [
        rng.uniform(0.5, 1.0, (*shape, 4) if k % 2 else shape).astype(np.float32) for k in range(count)
    ]
    panes = [rng.uniform(0.1, 0.9, (*shape, 4)).astype(np.float32) for _ in range(count)]
    depths = [rng.integers(1, 4, shape).astype(np.float32) for _ in range(count)]  # many of them equal
    depths[0][0] = np.inf
    joins = ((Join.LIGHT.value, (3.0, 2.0, 1.0), count), (Join.OVER_BY_DEPTH.value, count))
    stack = [image for pair in zip(panes, depths, strict=True) for image in pair]
    inputs = [device.from_host(image) for image in (albedo, arriving, *factors, *stack)]
    value = lit.COMPOSITE.twin(device.name)(device, *inputs, joins=joins, is_rest=is_rest)
    found = device.to_host(value)

    light = np.repeat(arriving[..., None].astype(np.float64), 3, axis=2)
    for factor in factors:
        light = light * (factor[..., None] if factor.ndim == 2 else factor[..., :3])
    expected = np.zeros((*shape, 4))
    expected[..., :3] = albedo[..., :3] / np.pi * light * (3.0, 2.0, 1.0)
    expected[..., 3] = albedo[..., 3] if is_rest else 0.0
    for y, x in np.ndindex(shape):
        for k in sorted(range(count), key=lambda k: -depths[k][y, x]):
            colour = panes[k][y, x].astype(np.float64)
            veil = (1.0 - colour[3]) * expected[y, x]
            expected[y, x] = colour + veil if is_rest else veil
    # float32, of some twenty products and sums.
    assert np.allclose(found, expected, rtol=5e-6, atol=1e-6)


def test_one_effect_makes_the_picture_anew(backend):
    plain, _ = baked(backend, "soft_shadow")
    found, layers = baked(backend, "soft_shadow", "lens")
    assert np.array_equal(found.composite, np.float32(0.5) * plain.composite[::-1])
    assert not [name for name in layers if "Lens" in name]
