"""Materials as they are read: opacity, colours and what is told, against Cycles where it shows them."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest
from strata.addon.core.arrays import MeshArrays
from strata.addon.core.material import Opacity
from strata.addon.scene.corner_values import corner_colours, corner_opacity
from strata.addon.scene.materials import Images, material_of
from strata.addon.scene.nodes.pictures import sample
from strata.addon.scene.pixels import pixels_of
from strata.tests.support.cycles_card import card_scene, rendered
from strata.tests.support.random_nodes import RandomNodes, float_image

SIZE = 16
ABSENT, WHOLE = Opacity(0.0), Opacity()


class Card:
    """A material on a card, and what is read of it."""

    def __init__(self):
        card = card_scene((SIZE, SIZE))
        self.mesh = card.data
        self.material = bpy.data.materials.new("Card")
        self.material.diffuse_color = (0.1, 0.2, 0.3, 1.0)
        self.mesh.materials.append(self.material)
        self.tree = self.material.node_tree
        self.principled = self.tree.nodes["Principled BSDF"]
        self.output = self.tree.nodes["Material Output"]

    def node(self, kind, *links, **properties):
        """A node, its inputs linked to outputs in their order; None: as it is; else it is the default."""
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for name, value in properties.items():
            setattr(node, name, value)
        for socket, given in zip([s for s in node.inputs if s.enabled], links, strict=False):
            if isinstance(given, bpy.types.NodeSocket):
                self.tree.links.new(given, socket)
            elif given is not None:
                socket.default_value = given
        return node.outputs[0]

    def show(self, shader):
        self.tree.links.new(shader, self.output.inputs["Surface"])
        return self.read()

    def read(self):
        self.images = Images()
        material, self.warnings = material_of(self.material, self.images)
        return material

    def texels(self, index):
        texels, warnings = self.images.sources[index].texels(pixels_of)
        assert not warnings
        return texels

    def alpha(self, opacity):
        """(SIZE, SIZE) where the pixels' middles are, interpolated as the kernels do."""
        if opacity.image is None:
            values = np.full((SIZE, SIZE), opacity.value)
        else:
            ticks = (np.arange(SIZE) + 0.5) / SIZE
            places = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
            texels = self.texels(opacity.image)[..., None]
            values = sample(texels, places, "REPEAT").reshape(SIZE, SIZE)
        return values


@pytest.fixture
def card():
    return Card()


def on_both_sides(material):
    assert material.seen == material.casts
    assert material.seen[0] == material.seen[1]
    return material.seen[0]


def test_a_cutout_by_a_mix_shader(card):
    image = float_image("Leaf", 8, 1)
    texture = card.tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    clear = card.node("BsdfTransparent")
    material = card.show(card.node("MixShader", texture.outputs["Alpha"], clear, card.principled.outputs[0]))
    opacity = on_both_sides(material)
    np.testing.assert_array_equal(card.texels(opacity.image), pixels_of(image)[..., 3])
    assert material.base_color == pytest.approx((0.8, 0.8, 0.8))
    assert not card.warnings
    # The other way round.
    material = card.show(card.node("MixShader", texture.outputs["Alpha"], card.principled.outputs[0], clear))
    opacity = on_both_sides(material)
    np.testing.assert_allclose(card.texels(opacity.image), 1.0 - pixels_of(image)[..., 3], atol=1e-6)


def test_what_is_transparent_alone_is_not_there(card):
    assert on_both_sides(card.show(card.node("BsdfTransparent"))) == ABSENT
    assert not card.warnings
    grey = card.show(card.node("BsdfTransparent", (0.25, 0.25, 0.25, 1.0)))
    assert on_both_sides(grey).value == pytest.approx(0.75)
    assert not card.warnings
    tinted = card.show(card.node("BsdfTransparent", (1.0, 0.0, 0.0, 1.0)))
    assert on_both_sides(tinted).value == pytest.approx(1.0 - 0.21264, abs=1e-5)
    assert tinted.tints == ("Transparent BSDF.002",)
    assert not grey.tints


def test_glow_added_to_what_is_clear(card):
    added = card.node(
        "AddShader", card.node("BsdfTransparent"), card.node("Emission", (1.0, 1.0, 1.0, 1.0), 3.0)
    )
    assert on_both_sides(card.show(added)) == ABSENT
    assert "adds light to a surface that is clear" in card.warnings[0]


def test_mixes_of_opaque_shaders(card):
    """A diffuse share is what counts as base colour; emission is added up."""
    red = card.node("BsdfDiffuse", (0.8, 0.0, 0.0, 1.0))
    blue = card.node("BsdfDiffuse", (0.0, 0.0, 0.4, 1.0))
    material = card.show(card.node("MixShader", 0.25, red, blue))
    assert material.base_color == pytest.approx((0.6, 0.0, 0.1))
    material = card.show(card.node("AddShader", red, blue))
    assert material.base_color == pytest.approx((0.8, 0.0, 0.4))
    glossy = card.node("BsdfAnisotropic", (1.0, 1.0, 1.0, 1.0))
    material = card.show(card.node("MixShader", 0.25, red, glossy))
    assert (material.base_color, material.metallic) == (pytest.approx((0.6, 0.0, 0.0)), 0.0)
    material = card.show(glossy)
    assert (material.base_color, material.metallic) == ((1.0, 1.0, 1.0), 1.0)
    glow = card.node("Emission", (0.5, 1.0, 0.0, 1.0), 4.0)
    material = card.show(card.node("MixShader", 0.25, red, glow))
    assert material.base_color == pytest.approx((0.6, 0.0, 0.0))
    assert material.emission == pytest.approx((0.5, 1.0, 0.0))
    assert on_both_sides(material) == WHOLE
    assert not card.warnings


def test_what_is_clear_has_no_share_in_colours(card):
    red = card.node("BsdfDiffuse", (0.8, 0.0, 0.0, 1.0))
    glow = card.node("Emission", (0.0, 1.0, 0.0, 1.0), 2.0)
    half = card.node("MixShader", 0.5, red, glow)
    material = card.show(card.node("MixShader", 0.75, card.node("BsdfTransparent"), half))
    assert on_both_sides(material).value == 0.75
    assert material.base_color == pytest.approx((0.4, 0.0, 0.0))
    assert material.emission == pytest.approx((0.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("operation", "other", "is_second", "step"),
    [("GREATER_THAN", 0.3, False, 0.3), ("GREATER_THAN", 0.3, True, None), ("LESS_THAN", 0.7, False, None),
     ("LESS_THAN", 0.7, True, 0.7), ("ROUND", None, False, 0.5), ("MULTIPLY", 0.5, False, 0.0)],
)  # fmt: skip
def test_steps_stay_steps(card, operation, other, is_second, step):
    """So that what is compared is the interpolated texture, as in Cycles, and not texels."""
    texture = card.tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Leaf", 8, 1)
    alpha = pixels_of(texture.image)[..., 3]
    inputs = (other, texture.outputs["Alpha"]) if is_second else (texture.outputs["Alpha"], other)
    card.tree.links.new(card.node("Math", *inputs, operation=operation), card.principled.inputs["Alpha"])
    opacity = on_both_sides(card.read())
    texels = card.texels(opacity.image)
    if step is None:
        # What is less than 0.7 has more than 0.3 left.
        np.testing.assert_allclose(texels, 1.0 - alpha, atol=1e-6)
        assert opacity.threshold == pytest.approx(1.0 - other, rel=1e-6)
    elif step == 0.0:
        np.testing.assert_allclose(texels, 0.5 * alpha, atol=1e-6)
        assert opacity.threshold == 0.0
    else:
        np.testing.assert_array_equal(texels, alpha)
        assert opacity.threshold == pytest.approx(step, rel=1e-6)


@pytest.mark.parametrize("operation", ["GREATER_THAN", "LESS_THAN"])
def test_steps_have_cycles_edges(card, operation, tmp_path):
    """Of a texture that is four times as coarse as the pixels."""
    texture = card.tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Leaf", SIZE // 4, 1)
    step = card.node("Math", texture.outputs["Alpha"], 0.6, operation=operation)
    clear = card.node("BsdfTransparent")
    opacity = on_both_sides(card.show(card.node("MixShader", step, clear, card.node("Emission"))))
    expected = rendered(tmp_path)[..., 3]
    assert 0.2 < expected.mean() < 0.8
    # One pixel may have an edge as near as Cycles' ray is off its middle.
    assert ((card.alpha(opacity) >= opacity.threshold) != expected).sum() <= 1


def test_a_ramp_without_a_slope_is_a_step(card):
    texture = card.tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Leaf", 8, 1)
    ramp = card.tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.interpolation = "CONSTANT"
    ramp.color_ramp.elements[1].position = 0.4
    card.tree.links.new(texture.outputs["Alpha"], ramp.inputs[0])
    card.tree.links.new(ramp.outputs["Color"], card.principled.inputs["Alpha"])
    opacity = on_both_sides(card.read())
    # The first of Cycles' 256 entries that is beyond.
    assert opacity.threshold == pytest.approx(102 / 255, abs=1e-6)


def test_shadows_and_backs_may_differ(card):
    clear, path = card.node("BsdfTransparent"), card.tree.nodes.new("ShaderNodeLightPath")
    shadowless = card.node("MixShader", path.outputs["Is Shadow Ray"], card.principled.outputs[0], clear)
    material = card.show(shadowless)
    assert material.seen == (WHOLE, WHOLE)
    assert material.casts == (ABSENT, ABSENT)
    geometry = card.tree.nodes.new("ShaderNodeNewGeometry")
    material = card.show(card.node("MixShader", geometry.outputs["Backfacing"], shadowless, clear))
    assert material.seen == (WHOLE, ABSENT)
    assert material.casts == (ABSENT, ABSENT)
    assert not card.warnings
    # Cycles does not heed EEVEE's own.
    card.material.use_backface_culling = card.material.use_backface_culling_shadow = True
    assert card.show(card.principled.outputs[0]).seen == (WHOLE, WHOLE)


def test_backs_are_as_cycles_shows_them(card, tmp_path):
    geometry = card.tree.nodes.new("ShaderNodeNewGeometry")
    mix = card.node(
        "MixShader", geometry.outputs["Backfacing"], card.principled.outputs[0], card.node("BsdfTransparent")
    )
    card.show(mix)
    card.material.use_backface_culling = True
    assert (rendered(tmp_path)[..., 3] == 1.0).all()
    card.mesh.flip_normals()
    assert (rendered(tmp_path)[..., 3] == 0.0).all()
    card.show(card.principled.outputs[0])
    assert (rendered(tmp_path)[..., 3] == 1.0).all()


def test_what_is_not_read_counts_as_opaque_and_is_told(card):
    noise = card.tree.nodes.new("ShaderNodeTexNoise")
    clear = card.node("BsdfTransparent")
    material = card.show(card.node("MixShader", noise.outputs[0], clear, card.principled.outputs[0]))
    assert material.unread_opacity
    assert on_both_sides(material) == WHOLE
    assert card.warnings == [
        "material 'Card': node 'Noise Texture' is not read for opacity, it counts as opaque"
    ]
    # Between two that are opaque nothing hangs on it.
    red = card.node("BsdfDiffuse", (0.8, 0.0, 0.0, 1.0))
    material = card.show(card.node("MixShader", noise.outputs[0], red, card.principled.outputs[0]))
    assert not material.unread_opacity
    assert on_both_sides(material) == WHOLE
    assert material.base_color == pytest.approx((0.1, 0.2, 0.3))
    assert card.warnings == [
        "material 'Card': node 'Noise Texture' is not read for base colour, its viewport colour is used"
    ]


def test_holdouts(card):
    assert card.show(card.node("Holdout")).is_holdout
    assert on_both_sides(card.read()) == WHOLE
    assert not card.show(
        card.node("MixShader", 0.5, card.node("Holdout"), card.principled.outputs[0])
    ).is_holdout
    assert "holdout" in card.warnings[0]


def test_vertex_alpha_and_its_product_with_a_texture(card):
    texture = card.tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Leaf", 8, 1)
    paint = card.tree.nodes.new("ShaderNodeVertexColor")
    paint.layer_name = "Paint"
    product = card.node("Math", texture.outputs["Alpha"], paint.outputs["Alpha"], operation="MULTIPLY")
    clear = card.node("BsdfTransparent")
    material = card.show(card.node("MixShader", product, clear, card.principled.outputs[0]))
    opacity = on_both_sides(material)
    np.testing.assert_array_equal(card.texels(opacity.image), pixels_of(texture.image)[..., 3])
    (source,) = card.images.corners[opacity.corners].sources
    assert (source.name, source.output) == ("Paint", "Alpha")
    assert not material.unread_opacity
    # No product: neither a picture nor a factor of corners.
    total = card.node("Math", texture.outputs["Alpha"], paint.outputs["Alpha"], operation="ADD")
    assert card.show(card.node("MixShader", total, clear, card.principled.outputs[0])).unread_opacity


def test_base_colours_of_attributes(card):
    paint = card.tree.nodes.new("ShaderNodeVertexColor")
    paint.layer_name = "Paint"
    texture = card.tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Leaf", 8, 1)

    def base(colour):
        card.tree.links.new(colour, card.principled.inputs["Base Color"])
        return card.read()

    def mixed(blend, share, *colours):
        return card.node("MixRGB", share, *colours, blend_type=blend)

    alone = base(paint.outputs["Color"])
    (source,) = card.images.corners[alone.base_color_corners].sources
    assert (source.name, source.output) == ("Paint", "Color")
    assert (alone.base_color, alone.base_color_image) == ((1.0, 1.0, 1.0), None)
    tinted = base(mixed("MULTIPLY", 1.0, paint.outputs["Color"], (0.5, 0.25, 1.0, 1.0)))
    assert tinted.base_color == pytest.approx((0.5, 0.25, 1.0))
    assert tinted.base_color_corners == alone.base_color_corners
    both = base(mixed("MULTIPLY", 1.0, texture.outputs["Color"], paint.outputs["Color"]))
    assert both.base_color_corners == alone.base_color_corners
    expected = pixels_of(texture.image)
    np.testing.assert_array_equal(card.texels(both.base_color_image)[..., :3], expected[..., :3])
    grey = base(mixed("MULTIPLY", 0.75, texture.outputs["Color"], paint.outputs["Alpha"]))
    np.testing.assert_array_equal(card.texels(grey.base_color_image)[..., :3], expected[..., :3])
    assert grey.base_color_corners
    assert not card.warnings
    # No product: neither a picture nor a factor of corners.
    assert not base(mixed("ADD", 1.0, texture.outputs["Color"], paint.outputs["Color"])).base_color_corners
    assert card.warnings == [
        "material 'Card': image 'Leaf' and attribute 'Paint' are not read for base colour, its viewport "
        "colour is used"
    ]


def test_a_metal_by_a_scaled_attribute_keeps_the_scale(card):
    """Of 1 less a quarter of an alpha: beside what corners carry, or in the picture if there is one."""
    paint = card.mesh.attributes.new("Paint", "FLOAT_COLOR", "POINT")
    alphas = [1.0, 0.5, 0.25, 0.0]
    paint.data.foreach_set("color", np.array([(0.0, 0.0, 0.0, each) for each in alphas], np.float32).ravel())
    reader = card.tree.nodes.new("ShaderNodeVertexColor")
    reader.layer_name = "Paint"
    quarter = card.node("Math", reader.outputs["Alpha"], 0.25, operation="MULTIPLY")
    metallic = card.node("Math", 1.0, quarter, operation="SUBTRACT")
    card.tree.links.new(metallic, card.principled.inputs["Metallic"])
    material = card.read()
    positions = np.array([v.co[:] for v in card.mesh.vertices], np.float32)
    arrays = MeshArrays(positions, np.arange(4, dtype=np.int32), np.array([0, 4], np.int32))
    values = [card.images.corners[material.diffuse_corners]]
    corners = corner_colours(card.mesh, arrays, values, "Card", card.warnings)
    shares = (1.0 - material.metallic) * corners[:, 0]
    np.testing.assert_allclose(shares, 0.25 * np.array(alphas), atol=1e-7)  # as floats
    assert material.base_color == pytest.approx((0.8, 0.8, 0.8))
    texture = card.tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Leaf", 8, 1)
    card.tree.links.new(texture.outputs["Color"], card.principled.inputs["Base Color"])
    material = card.read()
    expected = 0.25 * pixels_of(texture.image)[..., :3]
    found = (1.0 - material.metallic) * card.texels(material.diffuse_image)[..., :3]
    np.testing.assert_allclose(found, expected, rtol=1e-6)  # as floats
    assert card.images.corners[material.diffuse_corners].key == values[0].key
    assert not card.warnings


@pytest.mark.parametrize(
    ("kind", "domain", "node", "output"),
    [("FLOAT", "FACE", "Attribute", "Fac"), ("FLOAT_COLOR", "CORNER", "Attribute", "Color"),
     ("FLOAT_COLOR", "CORNER", "Attribute", "Fac"), ("BYTE_COLOR", "POINT", "VertexColor", "Color"),
     ("FLOAT_COLOR", "POINT", "VertexColor", "Alpha"), ("FLOAT_VECTOR", "POINT", "Attribute", "Vector"),
     ("FLOAT2", "CORNER", "Attribute", "Fac"), ("INT", "FACE", "Attribute", "Fac"),
     ("BOOLEAN", "FACE", "Attribute", "Fac"), ("FLOAT", "POINT", "Attribute", "Alpha")],
)  # fmt: skip
def test_attributes_are_cycles_own(card, kind, domain, node, output, tmp_path):
    """The same all over the card, so that nothing is interpolated; half of it is the opacity."""
    numbers = [0.8, 0.3, 0.1, 0.6]
    attribute = card.mesh.attributes.new("Paint", kind, domain)
    for element in attribute.data:
        field = "color" if "COLOR" in kind else "vector" if kind in ("FLOAT2", "FLOAT_VECTOR") else "value"
        count = {"FLOAT_VECTOR": 3, "FLOAT2": 2}.get(kind, 4)
        value = numbers[:count] if field != "value" else 1 if kind in ("INT", "BOOLEAN") else numbers[0]
        setattr(element, field, value)
    reader = card.tree.nodes.new(f"ShaderNode{node}")
    setattr(reader, "layer_name" if node == "VertexColor" else "attribute_name", "Paint")
    half = card.node("Math", reader.outputs[output], 0.5, operation="MULTIPLY")
    opacity = on_both_sides(
        card.show(card.node("MixShader", half, card.node("BsdfTransparent"), card.node("Emission")))
    )
    warnings = []
    positions = np.array([v.co[:] for v in card.mesh.vertices], np.float32)
    arrays = MeshArrays(positions, np.arange(4, dtype=np.int32), np.array([0, 4], np.int32))
    found = corner_opacity(card.mesh, arrays, [card.images.corners[opacity.corners]], "Card", warnings)
    assert not warnings
    # Cycles keeps painted bytes as bytes.
    np.testing.assert_allclose(found, rendered(tmp_path)[SIZE // 2, SIZE // 2, 3], atol=1e-5)


def test_pictures_of_a_material_lie_where_its_mapping_puts_them(card):
    """One Mapping moves the mesh's coordinates; with two, pictures are evaluated over the unit square."""
    texture = card.tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Leaf", 8, 1)
    uv = card.tree.nodes.new("ShaderNodeUVMap")
    uv.uv_map = "Second"
    moved = card.node("Mapping", uv.outputs[0], (0.5, 0.0, 0.0), None, (3.0, 2.0, 1.0))
    card.tree.links.new(moved, texture.inputs[0])
    card.tree.links.new(texture.outputs["Color"], card.principled.inputs["Base Color"])
    card.tree.links.new(texture.outputs["Alpha"], card.principled.inputs["Alpha"])
    material = card.read()
    assert (material.uv_map, material.uv_matrix) == ("Second", (3.0, 0.0, 0.5, 0.0, 2.0, 0.0))
    np.testing.assert_array_equal(card.texels(material.base_color_image), pixels_of(texture.image))
    other = card.tree.nodes.new("ShaderNodeTexImage")
    other.image = float_image("Rough", 4, 2)
    card.tree.links.new(uv.outputs[0], other.inputs[0])
    card.tree.links.new(other.outputs["Alpha"], card.principled.inputs["Alpha"])
    material = card.read()
    assert material.uv_matrix == (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    assert card.texels(material.base_color_image).shape == (16, 24, 4)
    assert all(image.repeats for image in card.images.headers)


@pytest.mark.parametrize("first", range(0, 40, 20))
def test_random_opacities_are_cycles_alpha(first, tmp_path):
    """Of mixes of Transparent and opaque shaders by random trees, over nothing. One pixel in fifty may fall
    to the other side of a step (see the trees of values)."""
    for seed in range(first, first + 20):
        card = Card()
        nodes = RandomNodes(card.tree, [float_image(f"Image{i}", SIZE, i) for i in range(2)], seed)
        shader = card.node("Emission")  # so that Cycles has nothing to choose from: what is clear is exact
        for _layer in range(1 + seed % 3):
            factor = nodes.number(1 + seed % 2)
            clear = card.node("BsdfTransparent")
            pair = (clear, shader) if nodes.random.random() < 0.5 else (shader, clear)
            shader = card.node("MixShader", factor, *pair)
        material = card.show(shader)
        assert not material.unread_opacity, card.warnings
        opacity = on_both_sides(material)
        if opacity.threshold > 0.0:
            continue  # a step: see above
        if opacity.image is not None and len(card.texels(opacity.image)) != SIZE:
            continue  # by texture coordinates alone
        found = card.alpha(opacity)
        expected = rendered(tmp_path)[..., 3]
        off = np.abs(found - expected)
        assert (off > 1e-3).sum() <= SIZE * SIZE / 50, (seed, nodes.used, off.max())


def test_equal_pictures_are_one(card):
    texture = card.tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Leaf", 8, 1)
    half = card.node("Math", texture.outputs["Alpha"], 0.5, operation="ADD")
    card.tree.links.new(half, card.principled.inputs["Alpha"])
    first = on_both_sides(card.read())
    twin = card.material.copy()
    images = card.images
    second = on_both_sides(material_of(twin, images)[0])
    assert first == replace(second)
    assert len(images.headers) == 1


def test_a_cutout_in_nested_groups(card):
    """As a material of a library may be: the picture outside, the shaders inside, a value through both."""

    def group(name, *inputs):
        made = bpy.data.node_groups.new(name, "ShaderNodeTree")
        for label, kind in inputs:
            made.interface.new_socket(label, in_out="INPUT", socket_type=f"NodeSocket{kind}")
        made.interface.new_socket("Surface", in_out="OUTPUT", socket_type="NodeSocketShader")
        return made, made.nodes.new("NodeGroupInput"), made.nodes.new("NodeGroupOutput")

    inner, start, end = group("Cut", ("Mask", "Float"), ("Shader", "Shader"))
    clear, mix = inner.nodes.new("ShaderNodeBsdfTransparent"), inner.nodes.new("ShaderNodeMixShader")
    for source, target in (
        (start.outputs["Mask"], mix.inputs[0]),
        (clear.outputs[0], mix.inputs[1]),
        (start.outputs["Shader"], mix.inputs[2]),
        (mix.outputs[0], end.inputs[0]),
    ):
        inner.links.new(source, target)
    outer, start, end = group("Leaf", ("Mask", "Float"), ("Colour", "Color"))
    cut, diffuse = outer.nodes.new("ShaderNodeGroup"), outer.nodes.new("ShaderNodeBsdfDiffuse")
    cut.node_tree = inner
    for source, target in (
        (start.outputs["Mask"], cut.inputs["Mask"]),
        (start.outputs["Colour"], diffuse.inputs["Color"]),
        (diffuse.outputs[0], cut.inputs["Shader"]),
        (cut.outputs[0], end.inputs[0]),
    ):
        outer.links.new(source, target)
    node = card.tree.nodes.new("ShaderNodeGroup")
    node.node_tree = outer
    node.inputs["Colour"].default_value = (0.1, 0.6, 0.2, 1.0)
    texture = card.tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Leaf", 8, 1)
    card.tree.links.new(texture.outputs["Alpha"], node.inputs["Mask"])
    material = card.show(node.outputs[0])
    opacity = on_both_sides(material)
    np.testing.assert_array_equal(card.texels(opacity.image), pixels_of(texture.image)[..., 3])
    assert material.base_color == pytest.approx((0.1, 0.6, 0.2))
    assert not card.warnings
