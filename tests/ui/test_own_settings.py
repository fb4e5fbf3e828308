"""A light's own settings."""

from __future__ import annotations

import bpy
import pytest
from strata.addon.bake import read_scene
from strata.addon.planning import Options
from strata.addon.scene.open import open_blend
from strata.addon.ui.properties import options_of
from strata.addon.ui.rows import has_own_targets
from strata.tests.support.places import SAMPLES
from strata.tests.support.settings import maps


def own_resolutions(scene, frame: int) -> dict[str, int]:
    """By light, the side of its first map, as a render at the frame plans it."""
    for light in bpy.data.lights:
        light.strata.soft_shadow.method = "bitmask"
    options = Options(backend="cpu", values=maps())
    _, graph, _, _ = read_scene(scene, scene.view_layers[0], options, frame=frame)
    found = {}
    for layer in graph.layers:
        drawn = [node for node in graph.nodes([layer.node]) if node.step.name == "layered_depth"]
        found[layer.light] = max(node.params["width"] for node in drawn)
    return found


def test_a_lights_own_settings_go_over_the_scenes():
    open_blend(SAMPLES / "courtyard.blend")
    scene = bpy.context.scene
    first = own_resolutions(scene, 1)
    name, *others = first
    lamp = bpy.data.objects[name].data
    lamp.strata.soft_shadow.resolution = 256
    assert own_resolutions(scene, 1) == first
    lamp.strata.use_own = True
    assert own_resolutions(scene, 1) == {**first, name: 256}
    assert others


def test_a_light_and_an_effect_have_target_errors_of_their_own():
    open_blend(SAMPLES / "courtyard.blend")
    scene = bpy.context.scene
    lamp = bpy.data.objects["Sun"].data
    lamp.strata.use_own = True
    lamp.strata.soft_shadow.target_error = 0.004
    scene.strata.soft_shadow.target_error = 0.01
    assert has_own_targets(scene)
    _, graph, _, _ = read_scene(scene, scene.view_layers[0], options_of(scene))
    found = {layer.light: layer.target_error for layer in graph.layers if layer.effect == "soft_shadow"}
    assert found.pop("Sun") == pytest.approx(0.004)
    assert found
    assert all(target == pytest.approx(0.01) for target in found.values())
    others = [layer for layer in graph.layers if layer.effect != "soft_shadow"]
    assert not any(layer.target_error for layer in others)
    lamp.strata.use_own, scene.strata.soft_shadow.target_error = False, 0.0
    assert not has_own_targets(scene)


def test_a_target_error_that_is_given_rules_the_whole_bake():
    """The file's own lose; what is given of an effect with it wins, over its lamps' own too."""
    open_blend(SAMPLES / "courtyard.blend")
    scene = bpy.context.scene
    lamp = bpy.data.objects["Sun"].data
    lamp.strata.use_own, lamp.strata.soft_shadow.target_error = True, 0.004
    scene.strata.soft_shadow.target_error = 0.01

    def targets(**given) -> set[float]:
        options = options_of(scene, effects=("soft_shadow",), **given)
        graph = read_scene(scene, scene.view_layers[0], options)[1]
        return {round(options.target_of(layer), 4) for layer in graph.layers}

    assert targets() == {0.004, 0.01}
    assert targets(target_error=0.03) == {0.03}
    assert targets(target_error=0.03, values={"soft_shadow": {"target_error": "0.05"}}) == {0.05}
    assert targets(target_error=0.03, values={"soft_shadow": {"target_error": "0"}}) == {0.03}
    assert targets(values={"soft_shadow": {"target_error": "0.05"}}) == {0.004, 0.05}
    assert targets(samples=8) == {0.0}


def test_a_lights_own_settings_can_be_animated_and_driven():
    open_blend(SAMPLES / "courtyard.blend")
    scene = bpy.context.scene
    first, second, *_ = own_resolutions(scene, 1)
    for name in (first, second):
        bpy.data.objects[name].data.strata.use_own = True
    animated = bpy.data.objects[first].data
    for frame, resolution in ((1, 200), (9, 400)):
        animated.strata.soft_shadow.resolution = resolution
        animated.keyframe_insert("strata.soft_shadow.resolution", frame=frame)
    driver = bpy.data.objects[second].data.driver_add("strata.soft_shadow.resolution").driver
    driver.expression = "300 + frame"
    for frame, resolution in ((1, 200), (9, 400)):
        found = own_resolutions(scene, frame)
        assert (found[first], found[second]) == (resolution, 300 + frame)


def test_layers_say_the_settings_that_they_were_made_with(tmp_path):
    from strata.ops.cli import main
    from strata.tests.support.exr_layers import read_layers

    open_blend(SAMPLES / "courtyard.blend")
    lamp = next(thing for thing in bpy.context.scene.objects if thing.type == "LIGHT")
    lamp.data.strata.use_own, lamp.data.strata.soft_shadow.layers = True, 1
    name, blend, output = lamp.name, tmp_path / "scene.blend", tmp_path / "layers.exr"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    words = [
        "bake",
        str(blend),
        "-o",
        str(output),
        "--size",
        "64x36",
        "--samples",
        "1",
        "--probes",
        "0",
        "-q",
    ]
    assert main(words) == 0
    layers = {layer.light: layer.settings["layers"] for layer in read_layers(output).layers}
    assert layers.pop(name) == 1
    assert set(layers.values()) == {3}
