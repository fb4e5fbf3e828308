"""Values of nodes: closed ones, and random trees of them against Cycles."""

from __future__ import annotations

import math
from itertools import pairwise

import bpy
import numpy as np
import pytest
from strata.addon.scene.nodes.graph import Graph
from strata.addon.scene.nodes.pictures import Picture, Placement, placement_of, sample
from strata.addon.scene.nodes.surface import surface_at
from strata.addon.scene.pixels import pixels_of
from strata.tests.support.cycles_card import card_scene, rendered
from strata.tests.support.random_nodes import RandomNodes, float_image

SIZE = 16


@pytest.fixture
def tree():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    tree = bpy.data.materials.new("Card").node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    return tree


def value_at(socket):
    return Graph().input(socket)


def node_of(tree, kind, **inputs):
    """A node, with inputs by their names; None leaves one as it is, a socket is linked."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    for name, given in inputs.items():
        socket = node.inputs[name.replace("_", " ")]
        if isinstance(given, bpy.types.NodeSocket):
            tree.links.new(given, socket)
        else:
            socket.default_value = given
    return node


def read_output(tree, output):
    """Of an output, by a socket of its own kind."""
    sink = tree.nodes.new("ShaderNodeMath" if output.type == "VALUE" else "ShaderNodeVectorMath")
    tree.links.new(output, sink.inputs[0])
    return value_at(sink.inputs[0])


@pytest.mark.parametrize(
    ("operation", "inputs", "expected"),
    [
        ("DIVIDE", (1.0, 0.0), 0.0),
        ("POWER", (-2.0, 3.0), -8.0),
        ("POWER", (-2.0, 0.5), 0.0),
        ("POWER", (0.0, 0.0), 1.0),
        ("LOGARITHM", (8.0, 2.0), 3.0),
        ("LOGARITHM", (-1.0, 2.0), 0.0),
        ("SMOOTH_MIN", (0.0, 0.0, 0.6), -0.1),
        ("MODULO", (-5.5, 2.0), -1.5),
        ("FLOORED_MODULO", (-5.5, 2.0), 0.5),
        ("WRAP", (5.5, 3.0, 1.0), 1.5),
        ("PINGPONG", (2.5, 1.0), 0.5),
        ("SNAP", (0.74, 0.25), 0.5),
        ("COMPARE", (0.5, 0.625, 0.125), 1.0),
        ("ROUND", (0.5,), 1.0),
        ("TRUNC", (-1.5,), -1.0),
        ("ARCSINE", (3.0,), math.pi / 2.0),
        ("INVERSE_SQRT", (0.0,), 0.0),
    ],
)
def test_math(tree, operation, inputs, expected):
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, inputs, strict=False):
        socket.default_value = value
    value = read_output(tree, node.outputs[0])
    assert value.number() == pytest.approx(expected, abs=1e-6)


def test_groups_reroutes_and_muted_nodes(tree):
    """An inner group doubles, the outer one adds 1 to what the inner makes of its input's default, 3."""

    def group(name, operation, number):
        made = bpy.data.node_groups.new(name, "ShaderNodeTree")
        made.interface.new_socket("In", in_out="INPUT", socket_type="NodeSocketFloat").default_value = 3.0
        made.interface.new_socket("Out", in_out="OUTPUT", socket_type="NodeSocketFloat")
        start, end = made.nodes.new("NodeGroupInput"), made.nodes.new("NodeGroupOutput")
        math_node = made.nodes.new("ShaderNodeMath")
        math_node.operation, math_node.inputs[1].default_value = operation, number
        made.links.new(start.outputs[0], math_node.inputs[0])
        made.links.new(math_node.outputs[0], end.inputs[0])
        return made, math_node

    inner, doubling = group("Inner", "MULTIPLY", 2.0)
    outer, adding = group("Outer", "ADD", 1.0)
    nested = outer.nodes.new("ShaderNodeGroup")
    nested.node_tree = inner
    start = next(node for node in outer.nodes if node.bl_idname == "NodeGroupInput")
    outer.links.new(start.outputs[0], nested.inputs[0])
    outer.links.new(nested.outputs[0], adding.inputs[0])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = outer
    reroutes = [tree.nodes.new("NodeReroute") for _ in range(3)]
    tree.links.new(node.outputs[0], reroutes[0].inputs[0])
    for first, second in pairwise(reroutes):
        tree.links.new(first.outputs[0], second.inputs[0])
    assert read_output(tree, reroutes[-1].outputs[0]).number() == 7.0
    given = node_of(tree, "Value")
    given.outputs[0].default_value = 0.25
    tree.links.new(given.outputs[0], node.inputs[0])
    assert read_output(tree, reroutes[-1].outputs[0]).number() == 1.5
    # Both groups' nodes are shared: the inner one by the outer's only.
    doubling.mute = True
    assert read_output(tree, reroutes[-1].outputs[0]).number() == 1.25
    node.mute = True
    assert read_output(tree, reroutes[-1].outputs[0]).number() == 0.25


def test_kinds_of_sockets_turn_into_each_other(tree):
    """A colour's luminance, a vector's mean, and a float three times over."""
    colour = node_of(tree, "RGB")
    colour.outputs[0].default_value = (0.0, 1.0, 0.0, 1.0)
    assert value_at(node_of(tree, "Math", Value=colour.outputs[0]).inputs[0]).number() == pytest.approx(
        0.71517, abs=1e-5
    )
    vector = node_of(tree, "CombineXYZ", X=0.0, Y=1.0, Z=0.5)
    assert value_at(node_of(tree, "Math", Value=vector.outputs[0]).inputs[0]).number() == pytest.approx(0.5)
    spread = node_of(tree, "Invert", Color=node_of(tree, "Math").outputs[0])
    np.testing.assert_allclose(value_at(spread.inputs["Color"]).constant, [1.0] * 3)


def test_what_is_not_read_is_named_unless_nothing_hangs_on_it(tree):
    noise = tree.nodes.new("ShaderNodeTexNoise")
    mix = tree.nodes.new("ShaderNodeMixRGB")
    tree.links.new(noise.outputs[0], mix.inputs["Fac"])
    for name in ("Color1", "Color2"):
        mix.inputs[name].default_value = (0.5, 0.25, 0.125, 1.0)
    np.testing.assert_allclose(read_output(tree, mix.outputs[0]).constant, [0.5, 0.25, 0.125])
    mix.inputs["Color2"].default_value = (0.5, 0.25, 0.25, 1.0)
    assert read_output(tree, mix.outputs[0]).unread == ["node 'Noise Texture'"]
    zero = node_of(tree, "Math", Value=noise.outputs[0])
    zero.operation, zero.inputs[1].default_value = "MULTIPLY", 0.0
    assert read_output(tree, zero.outputs[0]).number() == 0.0


def with_card(seed, *image_sizes):
    """A card's material tree, images, and random nodes for them."""
    card = card_scene((SIZE, SIZE))
    material = bpy.data.materials.new("Card")
    card.data.materials.append(material)
    tree = material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    images = [float_image(f"Image{i}", size, i) for i, size in enumerate(image_sizes)]
    return tree, RandomNodes(tree, images, seed)


def texels_of(value):
    """(SIZE, SIZE, 3) at the middles of the pixels, and the finest size that was evaluated."""
    if value.is_constant:
        return np.broadcast_to(value.constant, (SIZE, SIZE, 3)), SIZE
    texels, warnings = Picture(value, Placement()).texels(pixels_of)
    assert not warnings
    ticks = (np.arange(SIZE) + 0.5) / SIZE
    places = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    found = sample(texels[..., :3], places, "EXTEND").reshape(SIZE, SIZE, -1)
    return found, len(texels)


@pytest.mark.parametrize("first", range(0, 80, 20))
def test_random_trees_are_cycles_own(first, tmp_path):
    """Emitted by a card; in a pixel's middle is a texel of all images, so nothing is interpolated. Numbers
    from -4 to 4 come out as 0 to 1, all in float32. Cycles' ray is up to a two hundredth of a pixel off the
    middle: where a node steps, one pixel in fifty may fall to the other side."""
    kinds = set()
    for seed in range(first, first + 20):
        tree, nodes = with_card(seed, SIZE, SIZE, SIZE)
        made = nodes.colour(1 + seed % 4)
        split = node_of(tree, "SeparateColor", Color=made)
        parts = [node_of(tree, "MapRange", Value=part) for part in split.outputs]
        for part in parts:
            part.inputs["From Min"].default_value, part.inputs["From Max"].default_value = -4.0, 4.0
        joined = node_of(tree, "CombineColor")
        for part, socket in zip(parts, joined.inputs, strict=True):
            tree.links.new(part.outputs[0], socket)
        emission = node_of(tree, "Emission", Color=joined.outputs[0])
        tree.links.new(emission.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
        value = value_at(emission.inputs["Color"])
        assert not value.unread, seed
        found, size = texels_of(value)
        if size == SIZE:
            off = np.abs(found - rendered(tmp_path)[..., :3]).max(axis=-1)
            assert (off > 1e-3).sum() <= SIZE * SIZE / 50, (seed, nodes.used, off.max())
            kinds.update(nodes.used)
    assert len(kinds) > 20


@pytest.mark.parametrize("space", ["sRGB", "Non-Color"])
@pytest.mark.parametrize("alpha_mode", ["STRAIGHT", "PREMUL", "CHANNEL_PACKED", "NONE"])
@pytest.mark.parametrize("uses_alpha", [False, True])
@pytest.mark.parametrize("is_float", [False, True])
def test_colours_and_alpha_of_images(space, alpha_mode, uses_alpha, is_float, tmp_path):
    tree, _nodes = with_card(0)
    image = bpy.data.images.new("Image", SIZE, SIZE, alpha=True, float_buffer=is_float)
    image.colorspace_settings.name, image.alpha_mode = space, alpha_mode
    pixels = np.random.default_rng(4).integers(0, 256, (SIZE, SIZE, 4)) / 255.0
    # Kept times alpha, a colour is at most that.
    pixels[..., 3] = np.maximum(pixels[..., 3], pixels[..., :3].max(axis=-1))
    image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    texture = node_of(tree, "TexImage")
    texture.image = image
    emission = node_of(tree, "Emission", Color=texture.outputs["Color"])
    if uses_alpha:
        tree.links.new(texture.outputs["Alpha"], emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    colours = Picture(value_at(emission.inputs["Color"]), Placement()).texels(pixels_of)[0][..., :3]
    strength = value_at(emission.inputs["Strength"])
    if not strength.is_constant:
        colours = colours * Picture(strength, Placement()).texels(pixels_of)[0][..., None]
    # Cycles keeps bytes times alpha as bytes, cut off: a byte, over the alpha, where sRGB is steepest.
    smallest = pixels[..., 3].min()
    tolerance = 1e-5 if is_float or space != "sRGB" else 2.3 / 255.0 / (smallest if uses_alpha else 1.0)
    assert np.abs(colours - rendered(tmp_path)[..., :3]).max() < tolerance


@pytest.mark.parametrize("extension", ["REPEAT", "EXTEND", "CLIP", "MIRROR"])
@pytest.mark.parametrize("interpolation", ["Linear", "Closest"])
def test_images_are_sampled_as_cycles_does(extension, interpolation, tmp_path):
    """Moved, turned and enlarged by a Mapping node: the card sees beyond the image."""
    tree, _nodes = with_card(0)
    image = float_image("Image", 4, 1)
    mapping = node_of(
        tree, "Mapping", Location=(-0.7, 0.3, 0.0), Rotation=(0.1, 0.2, 0.4), Scale=(2.3, 1.7, 1)
    )
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], mapping.inputs["Vector"])
    texture = node_of(tree, "TexImage", Vector=mapping.outputs[0])
    texture.image, texture.extension, texture.interpolation = image, extension, interpolation
    emission = node_of(tree, "Emission", Color=texture.outputs["Color"])
    tree.links.new(emission.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    value = value_at(emission.inputs["Color"])
    (lookup,) = [part for part in value.parts() if part.texture is not None]
    ticks = (np.arange(SIZE) + 0.5) / SIZE
    places = np.stack([*map(np.ravel, np.meshgrid(ticks, ticks)), np.ones(SIZE * SIZE)], axis=-1)
    placement, warnings = placement_of([value])
    assert not warnings
    moved = places @ np.array(placement.matrix).reshape(2, 3).T
    found = sample(pixels_of(image), moved, extension, interpolation)[:, :3].reshape(SIZE, SIZE, 3)
    assert lookup.texture.extension == extension
    # Cycles interpolates in float32; a pixel at the edge of a texel may fall to either side.
    off = np.abs(found - rendered(tmp_path)[..., :3]).max(axis=-1)
    assert (off > 1e-4).sum() <= (2 if interpolation == "Closest" else 0)
    assert Picture(value, placement).repeats == (extension == "REPEAT")


def test_surfaces_without_shaders_are_black(tmp_path):
    tree, _nodes = with_card(0)
    surface = surface_at(tree.nodes["Material Output"].inputs["Surface"])
    assert surface.shown.opacity.equals(1.0)
    assert surface.shown.base.equals(0.0)
    np.testing.assert_array_equal(rendered(tmp_path), np.broadcast_to([0, 0, 0, 1], (SIZE, SIZE, 4)))


@pytest.mark.parametrize("kelvin", [500.0, 900.0, 1000.0, 1300.0, 1700.0, 3000.0, 5000.0, 6500.0, 20000.0])
def test_black_bodies_are_cycles_own(kelvin, tmp_path):
    tree, _nodes = with_card(0)
    body = node_of(tree, "Blackbody", Temperature=kelvin)
    emission = node_of(tree, "Emission", Color=body.outputs[0])
    tree.links.new(emission.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    # Cycles' coefficients are float32.
    np.testing.assert_allclose(
        value_at(emission.inputs["Color"]).constant, rendered(tmp_path)[0, 0, :3], rtol=1e-5, atol=1e-6
    )


@pytest.mark.parametrize("is_packed", [False, True])
def test_tiles_are_one_image(tmp_path, is_packed):
    """Of a square of four one is missing: three files of different colours and sizes."""
    tree, _nodes = with_card(0)
    random = np.random.default_rng(5)
    column, row = (2, 1) if is_packed else (0, 0)  # of files, Cycles finds none without the first
    first = 1001 + column + 10 * row
    for number, size in ((first, SIZE // 2), (first + 1, SIZE // 2), (first + 10, SIZE // 4)):
        tile = bpy.data.images.new(f"{number}", size, size, alpha=True)
        tile.pixels.foreach_set((random.integers(0, 256, size * size * 4) / 255.0).astype(np.float32))
        tile.filepath_raw, tile.file_format = str(tmp_path / f"tile.{number}.png"), "PNG"
        tile.save()
    image = bpy.data.images.load(str(tmp_path / f"tile.{first}.png"))
    image.source, image.filepath = "TILED", str(tmp_path / "tile.<UDIM>.png")
    image.colorspace_settings.name = "Non-Color"
    if is_packed:
        image.pack()
        for path in tmp_path.glob("*.png"):
            path.unlink()
    texture = node_of(tree, "TexImage")
    texture.image = image
    emission = node_of(tree, "Emission", Color=texture.outputs["Color"])
    tree.links.new(emission.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    uv = bpy.data.meshes["Card"].uv_layers[0].uv
    corners = np.array([(0, 0), (2, 0), (2, 2), (0, 2)]) + np.array([column, row])
    uv.foreach_set("vector", corners.ravel().astype(np.float32))
    value = value_at(emission.inputs["Color"])
    placement, _ = placement_of([value])
    assert placement.matrix == (0.5, 0.0, -column / 2, 0.0, 0.5, -row / 2)
    texels, warnings = Picture(value, placement).texels(pixels_of)
    assert texels.shape == (SIZE, SIZE, 4)
    assert not warnings
    off = np.abs(texels[..., :3] - rendered(tmp_path)[..., :3]).max(axis=-1)
    half = SIZE // 2
    assert off[:half].max() < 1e-5
    assert off[half:, half:].max() < 1e-5
    # The small one is not interpolated, as it is laid out beside larger ones.
    small = texels[half:, :half, :3]
    np.testing.assert_array_equal(small[::2, ::2], small[1::2, 1::2])
