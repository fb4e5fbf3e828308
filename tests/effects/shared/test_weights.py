"""What samples weigh: products of finished layers are means of products."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.core.errors import StrataError
from strata.addon.core.working_space import LUMINANCE
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared.weights import FLOOR, FLOOR_OFF_SURFACES, MOST, WEIGHT
from strata.addon.planning import Options
from strata.tests.support.gpu_scenes import gpu_device
from strata.tests.support.tiny_effects import GOBO, registry

REC709 = LUMINANCE["Linear Rec.709"]
SIZE = (48, 32)


def material(name: str, colour, **inputs) -> bpy.types.Material:
    made = bpy.data.materials.new(name)
    principled = made.node_tree.nodes["Principled BSDF"]
    principled.inputs["Base Color"].default_value = (*colour, 1.0)
    for key, value in inputs.items():
        principled.inputs[key].default_value = value
    return made


def fringe_scene(lamps: int = 1, power: float = 1.0) -> bpy.types.Scene:
    """A white wall behind a black fence and metal posts, between which lamps throw shadows: most pixels show
    several surfaces, some lit and some not."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    white = material("White", (0.9, 0.9, 0.9))
    dark = material("Dark", (0.02, 0.02, 0.02))
    metal = material("Metal", (0.9, 0.9, 0.9), Metallic=1.0)
    red = material("Red", (0.8, 0.1, 0.05))
    bpy.ops.mesh.primitive_plane_add(size=6.0, location=(0.0, 0.0, 0.0))
    bpy.context.object.data.materials.append(white)
    for number in range(12):
        bpy.ops.mesh.primitive_cube_add(size=1.0, location=(0.3 * number - 1.65, 0.0, 0.6))
        bpy.context.object.scale = (0.05, 1.6 - 0.08 * number, 0.04)
        bpy.context.object.rotation_euler = (0.0, 0.1 * number, 0.2)
        bpy.context.object.data.materials.append((dark, metal, red)[number % 3])
    for number in range(lamps):
        lamp = bpy.data.lights.new(f"Lamp {number}", "AREA")
        lamp.energy, lamp.size = power * 60.0, 0.4
        thing = bpy.data.objects.new(lamp.name, lamp)
        thing.location = (1.0 - 1.5 * number, 0.7, 2.2)
        scene.collection.objects.link(thing)
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 4.0
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location.z = 3.0
    scene.collection.objects.link(scene.camera)
    return scene


def made(scene, backend: str = "cpu", **options):
    how = Options(backend=backend, **{"probes": 0, "samples": 4, "composite": True, "lit": True} | options)
    return bake(scene, scene.view_layers[0], how, size=SIZE)


def layers_of(baked) -> dict[str, np.ndarray]:
    return {layer.name: layer.pixels for layer in baked.layers.layers}


def apart(found, expected) -> float:
    """The largest difference as a share of the brightest."""
    return float(np.abs(found - expected).max() / expected.max())


def without_metal(scene) -> None:
    for each in bpy.data.materials:
        each.node_tree.nodes["Principled BSDF"].inputs["Metallic"].default_value = 0.0


@pytest.mark.parametrize("samples", [1, 4])
def test_a_shadow_times_the_unshadowed_picture_is_the_shadowed_one(backend, samples):
    scene = fringe_scene()
    without_metal(scene)
    found, plain = (made(scene, backend, samples=samples, weight=how) for how in ("radiance", "none"))
    luminance = np.array(REC709)
    expected = found.composite[..., :3] @ luminance
    lit = found.lit[0][..., :3] @ luminance
    (shadow,) = layers_of(found).values()
    assert apart(shadow * lit, expected) < 2e-6
    assert [layer.weight for how in (found, plain) for layer in how.layers.layers] == ["radiance", "none"]
    assert not [warning for warning in found.report.warnings if "failed on gpu" in warning]
    (shadow,) = layers_of(plain).values()
    assert (apart(shadow * lit, expected) > 0.02) == (samples > 1)
    assert np.array_equal(found.composite, plain.composite)


def test_a_gobo_and_a_shadow_multiply_like_their_samples(backend):
    scene = fringe_scene()
    without_metal(scene)
    found = made(scene, backend, effects=("soft_shadow", "gobo"), registry=registry(GOBO))
    layers, luminance = layers_of(found), np.array(REC709)
    gobo, shadow = layers["Gobo Lamp 0"], layers["Soft Shadow Lamp 0"]
    product = found.lit[0][..., :3] * gobo * shadow[..., None]
    assert apart(product @ luminance, found.composite[..., :3] @ luminance) < 3e-6


def test_metals_weigh_nothing():
    """The layer is that of what is no metal, wherever any of it is in the pixel."""
    scene = fringe_scene()
    found = made(scene)
    (shadow,) = layers_of(found).values()
    without_metal(scene)
    (other,) = layers_of(made(scene)).values()
    assert np.abs(shadow - other).max() > 0.1
    for each in bpy.data.materials:
        if each.name == "Metal":
            each.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0, 0, 0, 1)
    (other,) = layers_of(made(scene)).values()
    assert np.allclose(shadow, other, atol=1e-6)


def test_metals_of_textures_weigh_nothing(backend):
    """A texture of 1 is a metal, one of 0 is none; in the truth too."""
    for value in (1.0, 0.0):
        found = []
        for is_textured in (False, True):
            scene = fringe_scene()
            tree = bpy.data.materials["Metal"].node_tree
            socket = tree.nodes["Principled BSDF"].inputs["Metallic"]
            socket.default_value = value
            if is_textured:
                node = tree.nodes.new("ShaderNodeTexImage")
                node.image = bpy.data.images.new("Metal", 2, 2, float_buffer=True)
                node.image.colorspace_settings.name = "Non-Color"
                node.image.pixels.foreach_set(np.array([value, value, value, 1.0] * 4, np.float32))
                tree.links.new(node.outputs["Color"], socket)
            found.append(made(scene, backend, probes=256))
        first, second = found
        assert not [warning for warning in second.report.warnings if "not read" in warning]
        for name, pixels in layers_of(first).items():
            np.testing.assert_allclose(layers_of(second)[name], pixels, atol=1e-5)
        errors = [each.layers.report["layers"][0]["error"]["value"] for each in found]
        assert errors[1] == pytest.approx(errors[0], rel=1e-3)
        # The composite shows metals as bright as anything.
        np.testing.assert_allclose(second.composite, first.composite, atol=1e-6)


def by_attributes(scene) -> None:
    """Base colours as attributes of the meshes, in place of constants."""
    for thing in scene.objects:
        if thing.type == "MESH":
            tree = thing.data.materials[0].node_tree
            colour = tree.nodes["Principled BSDF"].inputs["Base Color"]
            paint = thing.data.attributes.new("Paint", "FLOAT_COLOR", "CORNER")
            paint.data.foreach_set("color", [*colour.default_value] * len(paint.data))
            if not colour.is_linked:
                node = tree.nodes.new("ShaderNodeVertexColor")
                node.layer_name = "Paint"
                tree.links.new(node.outputs["Color"], colour)


def test_colours_of_attributes_weigh_as_constants(backend):
    """And in the truth too: the error is the same."""
    found = []
    for change in (lambda scene: None, by_attributes):
        scene = fringe_scene()
        change(scene)
        found.append(made(scene, backend, probes=256))
    first, second = found
    assert not [warning for warning in second.report.warnings if "is not read" in warning]
    np.testing.assert_allclose(second.composite, first.composite, atol=1e-6)
    for name, pixels in layers_of(first).items():
        # Where no light arrives any weight is its floor.
        np.testing.assert_allclose(layers_of(second)[name], pixels, atol=1e-5)
    errors = [each.layers.report["layers"][0]["error"]["value"] for each in found]
    assert errors[1] == pytest.approx(errors[0], rel=1e-3)


def test_power_does_not_matter():
    (first,) = layers_of(made(fringe_scene())).values()
    for power in (1e-12, 1e12):
        (other,) = layers_of(made(fringe_scene(power=power))).values()
        assert np.array_equal(first, other)


def test_a_layer_has_the_same_bits_in_whatever_tiles(monkeypatch):
    scene = foggy_scene()
    options = {"effects": FOGGY, "values": {"volumetric_light": FOG}}
    whole = layers_of(made(scene, **options))
    monkeypatch.setattr("strata.addon.core.sampling.PIXELS_PER_TILE", SIZE[0] * 5)
    for name, image in layers_of(made(scene, **options)).items():
        assert np.array_equal(whole[name], image), name


def test_where_no_light_arrives_the_plain_mean_over_surfaces_stands():
    """A lamp behind the wall: it shines on the posts' sides and beside the wall's edge on nothing."""
    scene = fringe_scene()
    scene.objects["Lamp 0"].location.z = 0.3
    scene.objects["Lamp 0"].rotation_euler.x = np.pi  # upwards
    scene.objects["Plane"].scale = (0.4, 0.4, 1.0)
    found, plain = (made(scene, weight=how) for how in ("radiance", "none"))
    (weighed,), (mean,) = layers_of(found).values(), layers_of(plain).values()
    coverage, lit = found.lit[0][..., 3], found.lit[0][..., :3].max(axis=2)
    dark = (lit == 0.0) & (coverage == 1.0)
    assert dark.sum() > 50
    assert np.allclose(weighed[dark], mean[dark], rtol=0.0, atol=1e-6)
    edge = (lit == 0.0) & (coverage > 0.0) & (coverage < 1.0)
    # Off surfaces a layer is neutral: 1.
    over_surfaces = (mean[edge] - (1.0 - coverage[edge])) / coverage[edge]
    assert edge.sum() > 10
    assert np.allclose(weighed[edge], over_surfaces, atol=1e-5)
    assert (weighed[coverage == 0.0] == 1.0).all()


FOG = {"use_scene_medium": False, "scattering_per_m": "0.1,0.2,0.3", "light_samples": 1}
FOGGY = ("soft_shadow", "volumetric_light")


def foggy_scene(lamps: int = 1) -> bpy.types.Scene:
    """The wall ends within the picture, beside nothing, and its posts stand far before it."""
    scene = fringe_scene(lamps)
    without_metal(scene)
    for thing in scene.objects:
        if thing.type == "MESH":
            thing.location.z *= -3.0 if thing.name == "Plane" else 1.0
    scene.objects["Plane"].location.z = -4.0
    scene.objects["Plane"].scale = (0.25, 0.3, 1.0)
    return scene


def test_a_transmittance_times_the_picture_behind_it_is_the_picture(backend):
    scene = foggy_scene(2)
    found = made(scene, backend, effects=FOGGY, values={"volumetric_light": FOG})
    clear = made(scene, backend, effects=("soft_shadow",)).composite[..., :3]
    layers = layers_of(found)
    scattered = sum(layer for name, layer in layers.items() if name.startswith("Volumetric"))
    passed = layers["Transmittance"][..., :3]
    behind = found.composite[..., :3] - scattered
    assert passed.min() == 0.0  # nothing comes out of fog without an end
    assert 0.5 < passed.max() < 0.9
    assert apart(passed * clear, behind) < 1e-5  # what is scattered is as bright, and taken off again
    plain = made(scene, backend, effects=FOGGY, values={"volumetric_light": FOG}, weight="none")
    assert apart(layers_of(plain)["Transmittance"][..., :3] * clear, behind) > 0.01
    assert not [warning for warning in found.report.warnings if "failed on gpu" in warning]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_groups_of_lamps_make_the_same_layers(sign):
    scene = foggy_scene(3)
    bpy.data.lights["Lamp 1"].energy *= sign
    options = {"effects": FOGGY, "values": {"volumetric_light": FOG}}
    whole, parts = (made(scene, memory_bytes=size, **options) for size in (0, 1))
    assert (whole.report.memory.groups, parts.report.memory.groups > 2) == (1, True)
    for name, image in layers_of(whole).items():
        assert np.allclose(layers_of(parts)[name], image, rtol=2e-6, atol=1e-7), name


def test_fog_before_metal_is_measured_like_fog_before_plaster():
    errors = []
    for metallic in (0.0, 1.0):
        scene = foggy_scene()
        for each in bpy.data.materials:
            each.node_tree.nodes["Principled BSDF"].inputs["Metallic"].default_value = metallic
        layers = made(scene, probes=64, effects=FOGGY, values={"volumetric_light": FOG}).report.layers
        errors.append(next(layer.error.value for layer in layers if layer.name == "Transmittance"))
    assert errors[0] > 0.001
    assert errors[1] == pytest.approx(errors[0], rel=1e-3)


def test_errors_are_measured_once_in_whatever_groups():
    options = {"effects": FOGGY, "values": {"volumetric_light": FOG}}
    whole, parts = (made(foggy_scene(3), probes=64, memory_bytes=size, **options) for size in (0, 1))
    for one, other in zip(whole.report.layers, parts.report.layers, strict=True):
        assert one.error.value == pytest.approx(other.error.value, rel=1e-3, abs=1e-6)


def test_what_weighs_is_a_choice():
    scene = fringe_scene()
    found = {
        how: next(iter(layers_of(made(scene, weight=how)).values()))
        for how in ("radiance", "irradiance", "none")
    }
    assert np.abs(found["radiance"] - found["irradiance"]).max() > 0.1
    assert np.abs(found["irradiance"] - found["none"]).max() > 0.01
    with pytest.raises(StrataError, match="weight: 'light' is none of radiance, irradiance, none"):
        Options(weight="light")


def weigh(device, colour, *factors, share=(1.0, 0.5, 0.25), luminance=REC709):
    inputs = [device.from_host(each) for each in (colour, *factors)]
    limits = (MOST, FLOOR, FLOOR_OFF_SURFACES)
    value = WEIGHT.twin(device.name)(device, *inputs, share=share, luminance=luminance, limits=limits)
    return device.to_host(value)


def device_of(backend: str):
    return CpuDevice() if backend == "cpu" else gpu_device()


def test_a_weight_has_a_floor_and_a_ceiling_and_is_a_number(backend):
    colour = np.ones((1, 6, 4), np.float32)
    colour[0, 5] = 0.0
    factor = np.array([[0.0, np.nan, np.inf, -1.0, 2.0, 7.0]], np.float32)
    expected = [[FLOOR, FLOOR, MOST, FLOOR, 2.0, FLOOR_OFF_SURFACES]]
    device = device_of(backend)
    assert np.allclose(weigh(device, colour, factor, share=(1.0, 1.0, 1.0)), expected, rtol=1e-6)
    found = weigh(device, colour, factor, share=(1.0, 1.0, 1.0), luminance=None)
    assert np.allclose(found, np.repeat(np.array(expected)[..., None], 3, axis=2), rtol=1e-6)


@pytest.mark.parametrize("luminance", [REC709, None])
@pytest.mark.parametrize("channels", [(), (1,), (1, 3, 1), (1, 1, 3, 4, 1, 1)])
def test_weights_are_the_same_on_both_devices(luminance, channels):
    rng = np.random.default_rng(4)
    colour = rng.uniform(0.0, 1.0, (23, 31, 4)).astype(np.float32)
    colour[0] = 0.0
    shapes = [(23, 31) if count == 1 else (23, 31, count) for count in channels]
    factors = [rng.uniform(0.0, 2.0, shape).astype(np.float32) for shape in shapes]
    cpu, gpu = (
        weigh(device, colour, *factors, luminance=luminance) for device in (CpuDevice(), gpu_device())
    )
    assert cpu.shape == gpu.shape == ((23, 31) if luminance else (23, 31, 3))
    assert np.allclose(cpu, gpu, rtol=1e-6, atol=0.0)  # a few products and a sum of three, rounded apart
    expected = colour[..., :3].astype(np.float64) * (1.0, 0.5, 0.25)
    for factor in factors:
        expected *= factor[..., None] if factor.ndim == 2 else factor[..., :3]
    expected = expected @ np.array(luminance) if luminance else expected
    assert np.allclose(cpu[1:], expected[1:], rtol=1e-6)
    assert np.allclose(cpu[0], FLOOR_OFF_SURFACES, rtol=1e-6)
