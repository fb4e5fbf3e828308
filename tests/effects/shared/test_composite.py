"""The composite: lamps' light by closed forms, joins by hand, and the same on both devices."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.core.effect import LayerKind
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.graph import Step
from strata.addon.core.outline import Light, Outline
from strata.addon.core.recorder import Recorder
from strata.addon.core.roles import Role
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared import composite, lit
from strata.addon.effects.shared.joins import Join
from strata.addon.planning import Options, plan_scene
from strata.addon.scene.open import choose, open_blend
from strata.tests.support.executing import SHOT, tilted_quad_scene
from strata.tests.support.gpu_scenes import gpu_device
from strata.tests.support.places import SAMPLES
from strata.tests.support.tiny_effects import LENS, effect, registry

AXES = {"right": (1.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0), "forward": (0.0, 0.0, -1.0)}
EYE = (3.0, -2.0, 5.0)


def baked(path, backend: str, size=(120, 68), **options):
    open_blend(path)
    chosen = choose()
    how = Options(backend=backend, samples=1, probes=0, composite=True, **options)
    return bake(chosen.scene, chosen.view_layer, how, size=size)


def points(rng, height: int, width: int) -> dict[str, np.ndarray]:
    """A surface of points below the lights, facing anywhere; the first row are misses."""
    normal = rng.normal(size=(height, width, 3))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    position = rng.uniform(-2.0, 2.0, (height, width, 3)) - np.array(EYE) - (0.0, 0.0, 2.0)
    surface = {
        "position": position.astype(np.float32),
        "shading_normal": normal.astype(np.float32),
        "instance": rng.integers(0, 3, (height, width)).astype(np.int32),
        "material": rng.integers(0, 3, (height, width)).astype(np.int32),
        "uv": rng.uniform(-3.0, 3.0, (height, width, 2)).astype(np.float32),
        "corner_colour": rng.uniform(0.0, 2.0, (height, width, 3)).astype(np.float32),
    }
    for name, miss in (("position", 0.0), ("shading_normal", 0.0), ("instance", -1), ("material", -1)):
        surface[name][0] = miss
    return surface


def emitters() -> dict[str, Emitter]:
    found = {}
    for kind in EmitterKind:
        for half in (0.0, 0.3):
            found[f"{kind.name} {half}"] = Emitter(
                kind, (0.5, 0.2, 1.5), **AXES, half_width=half, half_height=half
            )
    wide = Emitter(EmitterKind.RECTANGLE, (0.5, 0.2, 1.5), **AXES, half_width=0.6, half_height=0.2)
    found["wide"] = wide
    found["line"] = replace(wide, half_height=0.0)
    found["spread"] = replace(wide, tan_half_spread=0.7)
    found["elliptic spread"] = replace(wide, kind=EmitterKind.ELLIPSE, tan_half_spread=0.7)
    found["spot"] = replace(wide, kind=EmitterKind.SPHERE, half_height=0.6, cos_cone=0.8, blend=0.3)
    found["spot from behind"] = replace(
        wide,
        kind=EmitterKind.FACING_DISK,
        forward=(0.0, -0.98, 0.199),
        half_width=2.0,
        half_height=2.0,
        cos_cone=0.09,
        blend=0.3,
    )
    found["hard spot"] = replace(wide, kind=EmitterKind.FACING_DISK, half_height=0.6, cos_cone=0.8)
    return found


@pytest.mark.parametrize("name", emitters())
@pytest.mark.parametrize("receivers", [None, frozenset({0, 2})])
def test_irradiance_is_the_same_on_both_devices(name, receivers):
    rng = np.random.default_rng(7)
    surface = points(rng, 23, 31)
    cpu, gpu = CpuDevice(), gpu_device()
    outline, arrays = tilted_quad_scene()
    for device in (cpu, gpu):
        device.set_scene(replace(outline, instances=outline.instances * 3), arrays)
    given = {"eye": EYE, "emitter": emitters()[name], "receivers": receivers}
    expected = lit.IRRADIANCE.cpu(cpu, surface, **given)
    found = gpu.to_host(lit.IRRADIANCE.gpu(gpu, gpu.from_host(surface), **given))
    assert expected.max() > 0.0
    assert not expected[0].any()
    # Both sum sixteen float32 terms of the same formulas; a sample at the rim of a cone, or of the part of a
    # light that spread leaves, may fall to either side.
    limited = any(word in name for word in ("spot", "spread"))
    close = np.abs(found - expected) <= 2e-4 * expected + 2e-5 * expected.max()
    assert close.mean() >= (0.995 if limited else 1.0), np.abs(found - expected).max()


def test_colours_and_textures_are_the_same_on_both_devices():
    rng = np.random.default_rng(3)
    surface = points(rng, 23, 31)
    outline, arrays = tilted_quad_scene()
    texels = rng.uniform(size=(5, 7, 4)).astype(np.float32)
    given = {
        "colours": ((0.1, 0.2, 0.3), (0.4, 0.5, 0.6), (9.0, 9.0, 9.0)),
        "images": ((1, 0, 0.75), (2, 1, 1.0)),
        "version": 0,
    }
    results = []
    for device in (CpuDevice(), gpu_device()):
        device.set_scene(outline, replace(arrays, textures={0: texels}))  # image 1 could not be read
        value = lit.MATERIAL_COLOUR.twin(device.name)(device, device.from_host(surface), **given)
        results.append(device.to_host(value))
    cpu, gpu = results
    assert np.array_equal(cpu[..., 3], surface["material"] >= 0)
    assert np.allclose(cpu[surface["material"] == 0][:, :3], (0.1, 0.2, 0.3))
    assert np.allclose(cpu[surface["material"] == 2][:, :3], 9.0)
    assert np.allclose(cpu, gpu, atol=1e-5)  # weights of a bilinear lookup, a few ulp of uv times width
    textured = surface["material"] == 1
    expected = np.float32(0.75) * lit.bilinear(texels, surface["uv"][textured])
    assert np.array_equal(cpu[textured][:, :3], expected)


def test_what_corners_carry_multiplies_the_colours_of_its_materials(backend):
    surface = points(np.random.default_rng(3), 23, 31)
    outline, arrays = tilted_quad_scene()
    texels = np.full((2, 2, 4), 0.5, np.float32)
    colours = ((0.1, 0.2, 0.3), (0.4, 0.5, 0.6), (0.7, 0.8, 0.9))
    device = CpuDevice() if backend == "cpu" else gpu_device()
    device.set_scene(outline, replace(arrays, textures={0: texels}))
    made = [
        device.to_host(
            lit.MATERIAL_COLOUR.twin(backend)(
                device, device.from_host(surface), colours=colours, images=((1, 0, 1.0),), version=0, **more
            )
        )
        for more in ({}, {"by_corner": (0, 1)})
    ]
    found = surface["material"]
    expected = made[0].copy()
    of_corners = (found == 0) | (found == 1)
    expected[of_corners, :3] *= surface["corner_colour"][of_corners]
    np.testing.assert_allclose(made[1], expected, rtol=1e-6)
    assert np.abs(made[1] - made[0])[of_corners].max() > 0.1


def test_a_texture_is_bilinear_and_repeats():
    texels = np.zeros((2, 4, 4), np.float32)
    texels[..., 0] = [[0.0, 1.0, 2.0, 3.0], [10.0, 11.0, 12.0, 13.0]]
    uv = np.array([(0.125, 0.25), (0.25, 0.25), (1.375, -0.75), (0.0, 0.25), (0.375, 0.5)], np.float32)
    assert np.allclose(lit.bilinear(texels, uv)[:, 0], [0.0, 0.5, 1.0, 1.5, 6.0])


def joined(device, joins, albedo, *inputs):
    value = lit.COMPOSITE.twin(device.name)(
        device, device.from_host(albedo), *map(device.from_host, inputs), joins=joins
    )
    return device.to_host(value)


def test_layers_join_as_their_role_says(backend):
    device = CpuDevice() if backend == "cpu" else gpu_device()
    rng = np.random.default_rng(5)
    shape = (6, 9)
    albedo, over = (rng.uniform(0.1, 1.0, (*shape, 4)).astype(np.float32) for _ in range(2))
    arriving, shadow, second, fog = (rng.uniform(0.1, 1.0, shape).astype(np.float32) for _ in range(4))
    scattered = rng.uniform(0.1, 1.0, (*shape, 3)).astype(np.float32)
    if backend == "gpu":  # whose images have no three channels
        scattered = np.concatenate([scattered, np.ones((*shape, 1), np.float32)], axis=2)
    joins = (
        ("light", (3.0, 2.0, 1.0), 2),
        ("light", (1.0, -1.0, 0.0), 0),
        (Join.MULTIPLY.value,),
        (Join.ADD.value,),
        (Join.OVER.value,),
    )
    found = joined(device, joins, albedo, arriving, shadow, second, arriving, fog, scattered, over)
    light = (arriving * shadow * second)[..., None] * (3.0, 2.0, 1.0) + arriving[..., None] * (1.0, -1.0, 0.0)
    colour = albedo[..., :3].astype(np.float64) / np.pi * light * fog[..., None] + scattered[..., :3]
    alpha = over[..., 3:].astype(np.float64)
    assert np.allclose(found[..., :3], over[..., :3] + (1 - alpha) * colour, rtol=2e-6, atol=1e-6)
    assert np.allclose(found[..., 3:], alpha + (1 - alpha) * albedo[..., 3:], rtol=1e-6)


def one_sun(**more) -> Light:
    """Straight down, 2 W/m2 on a facing surface."""
    emitter = Emitter(EmitterKind.DISTANT_DISK, (0.0, 0.0, 0.0), **AXES, half_width=0.0, half_height=0.0)
    return Light("Sun", "Sun", "SUN", emitter, (2.0, 1.0, 0.5), **more)


def graph_of(outline: Outline):
    recorder = Recorder(outline, SHOT)
    composite.record(recorder, outline)
    return recorder.graph()


def test_lights_that_reach_nothing_are_not_computed():
    outline, _ = tilted_quad_scene()
    dark = replace(one_sun(), name="Dark", intensity=(0.0, 0.0, 0.0))
    linked = replace(one_sun(), name="Linked", receivers=frozenset())
    aside = replace(
        one_sun(),
        name="Aside",
        emitter=Emitter(EmitterKind.RECTANGLE, (0.0, 0.0, -9.0), **AXES, half_width=1, half_height=1),
    )
    graph = graph_of(replace(outline, lights=(one_sun(), dark, linked, aside)))
    assert [node.instance for node in graph.nodes() if node.step is lit.IRRADIANCE] == ["Sun"]
    assert [node.instance for node in graph.nodes() if node.step is lit.MATERIAL_COLOUR] == ["base colour"]


def test_a_scene_with_nothing_in_view_has_no_composite():
    outline, _ = tilted_quad_scene()
    assert not graph_of(replace(outline, instances=())).layers


def test_where_nothing_is_in_view_a_lens_is_left_out():
    outline, _ = tilted_quad_scene()
    options = Options(("lens",), composite=True, registry=registry(LENS))
    graph = plan_scene(replace(outline, instances=()), SHOT, options)
    assert ("Lens", "nothing is in view") in [(entry.what, entry.reason) for entry in graph.left_out]


def test_any_later_layer_joins_by_its_kind():
    outline, _ = tilted_quad_scene()
    outline = replace(outline, lights=(one_sun(),))
    recorder = Recorder(outline, SHOT)
    node = recorder.step(Step("fog", cpu=lambda device: None))
    recorder.layer(LayerKind("Fog", "V", role=Role.TRANSMITTANCE), node)
    recorder.layer(LayerKind("Depth", "Z"), node)
    composite.record(recorder, outline)
    joins = recorder.layers[-1].node.params["joins"]
    assert [join[0] for join in joins] == ["light", "multiply"]


def test_dots_are_on_the_colours_that_their_effect_lays_over_the_picture():
    outline, _ = tilted_quad_scene()
    recorder = Recorder(replace(outline, lights=(one_sun(),)), SHOT)
    dots, pane = (
        LayerKind(n, c, role=r) for n, c, r in (("Dots", "V", Role.TRANSMITTANCE), ("P", "RGBA", Role.OVER))
    )
    toon, fog = (effect(id, (), None) for id in ("toon", "fog"))
    made = {}
    for by, kind, title in (
        (toon, pane, "Toon"),
        (toon, dots, "Dots"),
        (toon, pane, "Ink"),
        (fog, dots, "Fog"),
    ):
        recorder.effect = by
        made[title] = recorder.step(Step(title, cpu=lambda device: None))
        recorder.layer(replace(kind, title=title), made[title])
    recorder.effect = None
    composite.record(recorder, recorder.outline)
    node = recorder.layers[-1].node
    assert [join[0] for join in node.params["joins"]] == ["light", "multiply", "over", "multiply", "over"]
    assert node.inputs[-4:] == tuple(made[title] for title in ("Fog", "Toon", "Dots", "Ink"))


def test_a_comics_dots_are_to_be_seen_in_the_picture():
    open_blend(SAMPLES / "comic.blend")
    chosen = choose()
    how = Options(("toon",), "cpu", samples=1, probes=0, composite=True)
    found = bake(chosen.scene, chosen.view_layer, how, size=(120, 68))
    layers = {layer.name: layer.pixels.astype(np.float64) for layer in found.layers.layers}
    toon, ink, dots = (layers[name] for name in ("Toon", "Toon Outline", "Toon Halftone"))
    inside = toon[..., 3] == 1.0
    assert (dots[inside] < 0.5).mean() > 0.02
    expected = ink[..., :3] + (1.0 - ink[..., 3:]) * dots[..., None] * toon[..., :3]
    assert np.allclose(found.composite[inside, :3], expected[inside], rtol=1e-4, atol=1e-5)


def simple_scene() -> None:
    """A grey plane under an orthographic camera and a sun of 2 W/m2 straight above, no shadows; a plate that
    glows covers a quarter of the picture, and a quarter shows nothing."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    for name, x, y, size, emission in (("Plane", 0.5, 0.0, 1.0, 0.0), ("Plate", -0.5, 0.5, 1.0, 0.7)):
        bpy.ops.mesh.primitive_plane_add(size=size if emission else 1.0, location=(x, y, 0.0))
        thing = bpy.context.object
        thing.name = name
        if not emission:
            thing.scale = (1.0, 2.0, 1.0)
        material = bpy.data.materials.new(name)
        principled = material.node_tree.nodes["Principled BSDF"]
        principled.inputs["Base Color"].default_value = (0.6, 0.3, 0.1, 1.0)
        principled.inputs["Emission Color"].default_value = (1.0, 0.5, 0.25, 1.0)
        principled.inputs["Emission Strength"].default_value = emission
        thing.data.materials.append(material)
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle, sun.use_shadow = 2.0, 0.0, False
    scene.collection.objects.link(bpy.data.objects.new("Sun", sun))
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 2.0
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location.z = 3.0
    scene.collection.objects.link(scene.camera)


def test_the_composite_of_a_plane_under_the_sun_is_albedo_over_pi_times_irradiance(backend):
    simple_scene()
    scene = bpy.context.scene
    how = Options(backend=backend, samples=1, probes=0, composite=True)
    found = bake(scene, scene.view_layers[0], how, size=(40, 40)).composite
    diffuse = np.array([0.6, 0.3, 0.1]) / np.pi * 2.0
    assert np.allclose(found[5:35, 25:35], [*diffuse, 1.0], rtol=1e-5)  # row 0 is the bottom
    assert np.allclose(found[25:35, 5:15], [*(diffuse + 0.7 * np.array([1.0, 0.5, 0.25])), 1.0], rtol=1e-5)
    assert not found[5:15, 5:15].any()  # no surface


def test_the_composite_of_a_file_is_the_sum_of_its_lights_times_their_layers(backend):
    found = baked(SAMPLES / "courtyard.blend", backend, lit=True)
    shadows = {layer.of.index: layer.pixels for layer in found.layers.layers}
    expected = sum(picture[..., :3] * shadows[index][..., None] for index, picture in found.lit.items())
    assert set(shadows) == set(found.lit)
    assert not [warning for warning in found.layers.report["warnings"] if "failed on gpu" in warning]
    difference = found.composite[..., :3] - expected
    # The lantern's glass glows; nothing else may differ.
    assert (np.abs(difference) > 1e-3 + 1e-4 * expected).any(axis=2).mean() < 0.01
    assert (difference > -1e-3).all()
    assert np.array_equal(found.composite[..., 3], found.lit[0][..., 3])
    assert {layer.name for layer in found.layers.layers} == {
        layer["name"] for layer in found.layers.report["layers"]
    }


def test_what_fog_scatters_is_not_dimmed_by_the_fog_again(backend):
    """Scattered light has been dimmed on its way already; only light from surfaces goes all the way."""
    fog = {"use_scene_medium": False, "scattering_per_m": "0.1,0.1,0.1", "light_samples": 1}
    found = baked(SAMPLES / "plain.blend", backend, lit=True, values={"volumetric_light": fog})
    layers = {layer.name: layer.pixels for layer in found.layers.layers}
    passed = layers.pop("Transmittance")[..., :3]
    surfaces, scattered = 0.0, 0.0
    for layer in found.layers.layers:
        if layer.effect == "volumetric_light" and layer.name in layers:
            scattered = scattered + layers[layer.name]
    for index, picture in found.lit.items():
        shadows = [s for s in found.layers.layers if s.effect == "soft_shadow" and s.of.index == index]
        surfaces = surfaces + picture[..., :3] * (shadows[0].pixels[..., None] if shadows else 1.0)
    assert passed.min() < 0.5
    assert np.allclose(found.composite[..., :3], surfaces * passed + scattered, rtol=1e-4, atol=1e-5)
