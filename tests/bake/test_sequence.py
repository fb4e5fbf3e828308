"""The layers of a sequence follow from scene and settings alone, whichever frames are baked."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys

import bpy
import numpy as np
import OpenEXR
import pytest
from strata.addon.layers.exr_header import header_of
from strata.addon.scene.changing import may_change
from strata.addon.scene.open import open_blend
from strata.addon.sequence import coarse_to_fine
from strata.tests.bake.sequence_scenes import keyed, lamp, names_of
from strata.tests.support.exr_layers import read_layers
from strata.tests.support.places import SAMPLES

QUICK = ("--backend", "cpu", "--size", "24x16", "--samples", "1", "--probes", "0")
QUICK += ("--set", "soft_shadow.resolution=128")


pytestmark = pytest.mark.usefixtures("registered")


def strata(*words, check: int = 0) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "strata", *map(str, words)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert result.returncode == check, result.stderr
    return result


def test_every_frame_comes_once_and_ends_first():
    assert list(coarse_to_fine(1, 9, 4)) == [4, 1, 9, 5, 3, 7, 2, 6, 8]
    assert list(coarse_to_fine(-3, -3, 9)) == [-3]
    assert sorted(coarse_to_fine(0, 100, 0)) == list(range(101))


def test_a_still_scene_has_what_each_frame_needs(scene):
    crate = bpy.data.objects["Crate"]
    crate.modifiers.new("Bevel", "BEVEL")
    assert not may_change(scene)
    assert names_of(scene) is None


def baked(scene, tmp_path, *words):
    """Layers by frame, of a copy that is baked by the command."""
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    result = strata(
        "bake", blend, "-o", tmp_path / "o_##.exr", "--report", tmp_path / "o_##.json", *words, *QUICK
    )
    found = {int(path.stem[-2:]): read_layers(path) for path in sorted(tmp_path.glob("o_*.exr"))}
    for path in tmp_path.glob("o_*"):
        path.unlink()
    return result, found


def test_every_frame_has_images_of_its_errors_and_neutral_layers_have_none(scene, tmp_path):
    keyed(lamp("Torch").data, "energy", f1=100.0, f3=0.0, f4=100.0)
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    words = ("--frames", "1,3", *QUICK, "--probes", "8", "--error-images")
    strata("bake", blend, "-o", tmp_path / "o_##.exr", *words)
    found = [header_of(tmp_path / f"o_{frame:02}.exr") for frame in (1, 3)]
    first, third = ({name for names in header.passes.values() for name in names} for header in found)
    assert first - third == {"Soft Shadow Torch Error"}
    assert third == {"Soft Shadow Key", "Soft Shadow Torch", "Soft Shadow Key Error"}


def test_all_files_have_the_same_layers_neutral_where_a_frame_needs_none(scene, tmp_path):
    keyed(lamp("Torch").data, "energy", f1=100.0, f3=0.0, f4=100.0)
    result, found = baked(scene, tmp_path, "--frames", "1-4,6")
    assert sorted(found) == [1, 2, 3, 4, 6]
    assert "frame 6 is outside scene 'Scene', which runs from 1 to 4" in result.stderr
    for frame, layers in found.items():
        assert [layer.name for layer in layers.layers] == ["Soft Shadow Key", "Soft Shadow Torch"]
        told = layers.report
        torch = layers.layers[1]
        assert told["frame"] == frame
        assert [entry.get("neutral", False) for entry in told["layers"]] == [False, frame == 3]
        assert (torch.pixels == 1.0).all() == (frame == 3)
        reasons = [entry["reason"] for entry in told["left_out"] if entry["what"] == "Soft Shadow Torch"]
        assert reasons == (["neutral (1), other frames need it: no power"] if frame == 3 else [])
        assert any("outside" in warning for warning in told["warnings"]) == (frame == 6)
    # A farm's task for one frame, whatever it is, agrees, and so does what was baked with others.
    for frame in (3, 2):
        _, alone = baked(scene, tmp_path, "--frames", str(frame))
        for one, other in zip(alone[frame].layers, found[frame].layers, strict=True):
            assert one.name == other.name
            np.testing.assert_array_equal(one.pixels, other.pixels)


def test_a_frame_that_needs_nothing_has_its_file(scene, tmp_path):
    keyed(bpy.data.objects["Key"], "hide_render", f1=False, f2=True, f3=False)
    _, found = baked(scene, tmp_path, "--frames", "2")
    (layer,) = found[2].layers
    assert (layer.name, layer.light) == ("Soft Shadow Key", "Key")
    assert (layer.pixels == 1.0).all()
    assert any("the lamp is not there" in entry["reason"] for entry in found[2].report["left_out"])
    scene.frame_start = scene.frame_end = 2
    result, found = baked(scene, tmp_path, "--frames", "2")
    assert not found
    assert "nothing to bake, no file written" in result.stderr


def test_the_plan_tells_what_is_neutral(scene, tmp_path):
    keyed(lamp("Torch").data, "energy", f1=100.0, f3=0.0, f4=100.0)
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    plans = json.loads(strata("plan", blend, "--frames", "1-3x2", "--json").stdout)
    assert [plan["frame"] for plan in plans] == [1, 3]
    for plan, neutral in zip(plans, ([], ["Soft Shadow Torch"]), strict=True):
        assert [layer["name"] for layer in plan["layers"] if layer.get("neutral")] == neutral
    text = strata("plan", blend, "--frames", "1,3").stdout
    assert (
        "left out: Soft Shadow Torch: neutral (1), other frames need it: no power"
        in text.partition("frame 3")[2]
    )
    assert "neutral" not in text.partition("frame 3")[0]


def test_another_scene_is_evaluated_at_its_own_frame(scene, tmp_path):
    """The file's active scene is at frame 1, the other at 4; its sun is hidden but at frame 3."""
    other = bpy.data.scenes.new("Other")
    for thing in scene.objects:
        other.collection.objects.link(thing)
    other.camera, other.frame_start, other.frame_end = scene.camera, 1, 4
    keyed(bpy.data.objects["Key"], "hide_render", f1=True, f3=False, f4=True)
    crate = bpy.data.objects["Crate"]
    keyed(crate, "location", f1=(0, 0, 0.5), f3=(2, 0, 0.5), f4=(-2, 0, 0.5))
    other.frame_set(4)
    _, found = baked(scene, tmp_path, "--scene", "Other", "--frames", "3")
    assert found[3].report["frame"] == 3
    assert found[3].layers[0].pixels.min() < 1.0
    blend = tmp_path / "scene.blend"
    plan = json.loads(strata("plan", blend, "--scene", "Other", "--json").stdout)
    assert plan["frame"] == 4
    assert plan["layers"][0]["neutral"]


def test_sample_blends_animation_is_the_same_whatever_is_asked_first():
    open_blend(SAMPLES / "animated.blend")
    assert names_of(bpy.context.scene, (1, 5, 10)) == ["Soft Shadow Moving panel"]


def test_only_the_layers_of_named_lamps(scene, tmp_path):
    lamp("Torch")
    lamp("Lamp.001", place=(-2, 1, 4))
    scene.strata.toon.enabled = True
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    words = ("--lights", "Lamp.001, Key", "--effects", "soft_shadow,toon")
    strata("bake", blend, "-o", tmp_path / "few.exr", *words, *QUICK)
    few = read_layers(tmp_path / "few.exr").layers
    assert [layer.name for layer in few] == ["Soft Shadow Key", "Soft Shadow Lamp_001"]
    strata("bake", blend, "-o", tmp_path / "all.exr", "--effects", "soft_shadow,toon", *QUICK)
    everything = {layer.name: layer.pixels for layer in read_layers(tmp_path / "all.exr").layers}
    assert len(everything) > 3
    for layer in few:
        np.testing.assert_array_equal(layer.pixels, everything[layer.name])
    plan = json.loads(strata("plan", blend, "--lights", "Torch", "--json").stdout)
    assert [layer["name"] for layer in plan["layers"]] == ["Soft Shadow Torch"]
    for command in (("plan", blend), ("bake", blend, "-o", tmp_path / "x.exr")):
        error = strata(*command, "--lights", "Key,Nope", check=2).stderr
        assert error == "strata: --lights: there is no lamp 'Nope' (there is 'Key', 'Lamp.001', 'Torch')\n"
    assert sorted(os.listdir(tmp_path)) == ["all.exr", "few.exr", "scene.blend"]


def test_named_lamps_of_a_sequence(scene):
    keyed(lamp("Torch").data, "energy", f1=0.0, f3=100.0)
    assert names_of(scene, (1, 3), lights=("Torch",)) == ["Soft Shadow Torch"]


def test_folders_are_made_and_slashes_are_beside_the_blend(scene, tmp_path):
    (tmp_path / "a").mkdir()
    blend = tmp_path / "a" / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    words = ("-o", "//deep/er/o_#.exr", "--report", "//reports/o.json", "--frames", "2", *QUICK)
    strata("bake", blend, *words)
    assert (tmp_path / "a" / "deep" / "er" / "o_2.exr").is_file()
    assert json.loads((tmp_path / "a" / "reports" / "o.json").read_text())["frame"] == 2
    # Nothing of it where nothing is baked, or the bake fails.
    strata("bake", blend, "-o", tmp_path / "none" / "x.exr", "--effects", "volumetric_light", *QUICK)
    scene.camera.data.type = "PANO"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    strata("bake", blend, "-o", tmp_path / "none" / "x.exr", *QUICK, check=2)
    assert os.listdir(tmp_path) == ["a"]
    scene.camera = None
    bpy.data.scenes.new("Other").camera = bpy.data.objects["Camera"]
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    error = strata("bake", blend, "-o", tmp_path / "x.exr", check=2).stderr
    assert error == "strata: scene 'Scene' has no camera; --scene: 'Other' has one\n"


def test_all_view_layers_go_into_one_file(scene, tmp_path):
    keyed(lamp("Torch").data, "energy", f1=0.0, f3=100.0)
    lamps = bpy.data.collections.new("Lamps")
    scene.collection.children.link(lamps)
    lamps.objects.link(bpy.data.objects["Torch"])
    scene.collection.objects.unlink(bpy.data.objects["Torch"])
    scene.view_layers.new("Without.lamp").layer_collection.children["Lamps"].exclude = True
    scene.view_layers.new("Unused").use = False
    _, found = baked(scene, tmp_path, "--view-layer", "all", "--frames", "1")
    whole = found[1].report
    blend = tmp_path / "scene.blend"
    names = ["ViewLayer.Soft Shadow Key", "ViewLayer.Soft Shadow Torch", "Without.lamp.Soft Shadow Key"]
    assert [f"{entry['view_layer']}.{entry['name']}" for entry in whole["layers"]] == names
    strata("bake", blend, "-o", tmp_path / "x.exr", "--view-layer", "all", "--composite", *QUICK)
    with OpenEXR.File(str(tmp_path / "x.exr")) as file:
        parts = {part.name() for part in file.parts}
    composites = {"ViewLayer.Combined", "Without.lamp.Combined"}
    assert parts == {*names, *composites}
    for name in ("ViewLayer", "Without.lamp"):
        strata("bake", blend, "-o", tmp_path / "one.exr", "--view-layer", name, *QUICK)
        for layer in read_layers(tmp_path / "one.exr").layers:
            with OpenEXR.File(str(tmp_path / "x.exr"), separate_channels=True) as file:
                (part,) = (part for part in file.parts if part.name() == f"{name}.{layer.name}")
                (channel,) = part.channels.values()
                np.testing.assert_array_equal(channel.pixels[::-1], layer.pixels)
    plans = json.loads(strata("plan", blend, "--view-layer", "all", "--json").stdout)
    assert [plan["view_layer"] for plan in plans] == ["ViewLayer", "Without.lamp"]
    few = json.loads(strata("plan", blend, "--view-layer", "all", "--lights", "Torch", "--json").stdout)
    assert [[layer["name"] for layer in plan["layers"]] for plan in few] == [["Soft Shadow Torch"], []]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_looking_at_once(scene, tmp_path, number):
    """A lamp that no frame needs, though it is animated: the whole range has to be looked at."""
    keyed(lamp("Torch").data, "energy", f1=0.0, f2=0.0)
    scene.frame_end = 100_000
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    words = ["bake", blend, "-o", tmp_path / "folder" / "x.exr", *QUICK]
    command = [sys.executable, "-m", "strata", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert "Looking which layers the sequence needs" in process.stderr.readline()
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert (out, err.splitlines()[-1]) == ("", "strata: interrupted")
    assert os.listdir(tmp_path) == ["scene.blend"]
