"""Shadows in colour: each channel is weighed by itself, right where colours share a pixel."""

from __future__ import annotations

import json

import bpy
import numpy as np
import OpenEXR
import pytest
from strata.addon.engine import passes
from strata.addon.layers import images
from strata.ops.cli import main
from strata.tests.bake.sequence_scenes import keyed, lamp
from strata.tests.effects.shared.test_weights import apart, fringe_scene, layers_of, made, without_metal
from strata.tests.support.exr_layers import read_layers
from strata.tests.support.tiny_effects import GOBO, registry

pytestmark = pytest.mark.usefixtures("registered")

QUICK = ("--backend", "cpu", "--size", "24x16", "--samples", "2", "--probes", "0")


def two_colours(lamps: int = 1) -> bpy.types.Scene:
    """Red posts before a green wall, in the light of a white lamp, in part shadowed."""
    scene = fringe_scene(lamps)
    without_metal(scene)
    for each in bpy.data.materials:
        colour = (0.05, 0.8, 0.02, 1.0) if each.name == "White" else (0.8, 0.02, 0.1, 1.0)
        each.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = colour
    return scene


def test_a_shadow_in_colour_is_right_where_colours_share_a_pixel(backend):
    scene = two_colours()
    grey, colour = (made(scene, backend, rgb_layers=rgb) for rgb in (False, True))
    expected, lit = colour.composite[..., :3], colour.lit[0][..., :3]
    (layer,) = colour.layers.layers
    assert (layer.channels, layer.weight) == ("RGB", "radiance")
    assert apart(layer.pixels * lit, expected) < 2e-6
    (shadow,) = layers_of(grey).values()
    assert apart(shadow[..., None] * lit, expected) > 0.05
    assert np.array_equal(grey.composite, colour.composite)
    assert not [warning for warning in colour.report.warnings if "failed on gpu" in warning]


def test_with_a_gobo_before_it_too(backend):
    found = made(
        two_colours(), backend, effects=("soft_shadow", "gobo"), registry=registry(GOBO), rgb_layers=True
    )
    layers = layers_of(found)
    product = found.lit[0][..., :3] * layers["Gobo Lamp 0"] * layers["Soft Shadow Lamp 0"]
    assert apart(product, found.composite[..., :3]) < 3e-6


def test_plain_means_are_the_same_in_all_channels():
    scene = two_colours()
    grey, colour = (made(scene, rgb_layers=rgb, weight="none") for rgb in (False, True))
    (shadow,), (found,) = layers_of(grey).values(), layers_of(colour).values()
    assert np.array_equal(found, np.stack([shadow] * 3, axis=-1))


def test_groups_of_lamps_and_their_errors_are_the_same():
    scene = two_colours(3)
    whole, parts = (made(scene, rgb_layers=True, probes=64, memory_bytes=size) for size in (0, 1))
    assert (whole.report.memory.groups, parts.report.memory.groups > 2) == (1, True)
    for name, image in layers_of(whole).items():
        assert np.allclose(layers_of(parts)[name], image, rtol=2e-6, atol=1e-7), name
    for one, other in zip(whole.report.layers, parts.report.layers, strict=True):
        assert one.error.value == pytest.approx(other.error.value, rel=1e-3, abs=1e-6)


def test_file_plan_and_report_say_three_channels(tmp_path, capfd):
    """Also of a layer that a frame does not need."""
    scene = two_colours()
    keyed(lamp("Torch", place=(0.5, 0.5, 2.0)).data, "energy", f1=100.0, f2=0.0)
    scene.frame_start, scene.frame_end = 1, 2
    scene.strata.soft_shadow.enabled = True
    blend, output = tmp_path / "scene.blend", tmp_path / "o_#.exr"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    words = [str(blend), "-o", str(output), "--frames", "1,2", "-q", *QUICK]
    assert main(["bake", *words, "--rgb-layers"]) == 0
    for frame in (1, 2):
        with OpenEXR.File(str(tmp_path / f"o_{frame}.exr"), separate_channels=True) as file:
            for part in file.parts:
                assert {name.rpartition(".")[2] for name in part.channels} == set("RGB")
        layers = read_layers(tmp_path / f"o_{frame}.exr").layers
        torch = next(layer for layer in layers if layer.light == "Torch")
        assert (torch.pixels == 1.0).all() == (frame == 2)
    capfd.readouterr()
    assert main(["plan", str(blend), "--frames", "1,2", "--json", "--rgb-layers"]) == 0
    plans = json.loads(capfd.readouterr().out)
    assert {layer["channels"] for plan in plans for layer in plan["layers"]} == {"RGB"}


def test_the_scene_says_it_too():
    scene = two_colours()
    scene.view_layers[0].update()
    scene.strata.rgb_layers = True
    kinds = {kind.name: kind for kind in passes.registered(scene, scene.view_layers[0])}
    assert (kinds["Soft Shadow Lamp 0"].channels, kinds["Soft Shadow Lamp 0"].type) == ("RGB", "COLOR")
    assert kinds["Soft Shadow Lamp 0"].pixels(3, 2).shape == (2, 3, 3)
    scene.strata.rgb_layers = False
    kinds = {kind.name: kind for kind in passes.registered(scene, scene.view_layers[0])}
    assert (kinds["Soft Shadow Lamp 0"].channels, kinds["Soft Shadow Lamp 0"].type) == ("V", "VALUE")


def test_an_image_has_the_channels():
    scene = two_colours()
    found = made(scene, rgb_layers=True).layers
    (image,) = images.fill_images(scene.name, found, images.packed(found))
    pixels = np.array(image.pixels[:], np.float32).reshape(found.height, found.width, 4)
    assert np.array_equal(pixels[..., :3], found.layers[0].pixels)
    assert np.ptp(pixels[..., :3], axis=2).max() > 0.1
