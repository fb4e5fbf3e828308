"""What Blender bakes of materials: where it lies, by what it is known again, and what is left of it."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.scene import scan as scan_module
from strata.addon.scene.exact import reading, upstream, workshop
from strata.addon.scene.exact.layout import Layouts, layout_of
from strata.addon.scene.exact.leaves import random_of
from strata.addon.scene.exact.upstream import upstream_of
from strata.addon.scene.extract import extract
from strata.addon.scene.nodes.graph import Graph
from strata.addon.scene.rescan import Changes, patched
from strata.addon.scene.scan import ScanOptions, TooLong, scan
from strata.tests.support.cycles_card import card_scene, rendered
from strata.tests.support.exact_reading import OPTIONS, read, with_own_store
from strata.tests.support.procedural import card, clear_by, coordinates, floor_scene, noise
from strata.tests.support.random_nodes import float_image


@pytest.fixture(autouse=True)
def store(monkeypatch):
    return with_own_store(monkeypatch)


def everything() -> list[str]:
    """All that is in the file."""
    found = []
    for name in dir(bpy.data):
        collection = getattr(bpy.data, name)
        if isinstance(collection, bpy.types.bpy_prop_collection):
            found += [
                f"{name} {each.name} {each.users}" for each in collection if isinstance(each, bpy.types.ID)
            ]
    return sorted(found)


# By what it is known again


def digest(socket) -> str:
    return upstream_of(Graph(), socket.node, socket, ()).digest


def test_a_digest_changes_with_what_a_node_hangs_on_alone():
    floor_scene()
    material = bpy.data.materials.new("Card")
    tree = material.node_tree
    texture, ramp = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeValToRGB")
    tree.links.new(ramp.outputs[0], texture.inputs["Scale"])
    socket = texture.outputs[0]
    seen = [digest(socket)]
    texture.location, texture.label, texture.select = (5.0, 5.0), "Label", True
    tree.nodes.new("ShaderNodeTexVoronoi")
    assert digest(socket) == seen[0]
    for change in (
        lambda: setattr(texture, "noise_dimensions", "4D"),
        lambda: setattr(texture.inputs["Detail"], "default_value", 3.0),
        lambda: setattr(ramp.color_ramp.elements[0], "position", 0.25),
        lambda: setattr(ramp.color_ramp, "interpolation", "CONSTANT"),
        lambda: tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["UV"], texture.inputs["Vector"]),
        lambda: setattr(tree.nodes.new("ShaderNodeValue").outputs[0], "default_value", 1.0),
    ):
        change()
        seen.append(digest(socket))
    assert seen[-1] == seen[-2]  # a node that is not linked
    assert len(set(seen)) == len(seen) - 1


def test_what_only_an_eye_can_tell_stays_unread():
    scene = floor_scene()

    def by_eye(tree):
        fresnel = tree.nodes.new("ShaderNodeFresnel")
        texture = tree.nodes.new("ShaderNodeTexNoise")
        tree.links.new(fresnel.outputs[0], texture.inputs["Scale"])
        return texture.outputs[0]

    card(clear_by("Card", by_eye))
    outline, *_ = read(scene)
    assert outline.warnings == (
        "material 'Card': node 'Noise Texture' is not read for opacity, it counts as opaque",
    )
    assert any(material.unread_opacity for material in outline.materials)
    assert not outline.baked


def test_objects_share_what_does_not_tell_them_apart(monkeypatch):
    baked = []
    bake_one = workshop.Workshop.bake

    def counted(self, work):
        for leaf, values in bake_one(self, work):
            baked.append(leaf.key)
            yield leaf, values

    monkeypatch.setattr(workshop.Workshop, "bake", counted)
    scene = floor_scene()
    material = clear_by("Card", noise)
    for place in range(3):
        card(material, (0.1 * place, 0.0, 1.0 + place))
    outline, *_ = read(scene)
    assert len(baked) == 1
    (line,) = outline.baked
    assert "opacity baked by Blender" in line
    # The world's place tells them apart.
    tree = material.node_tree
    position = tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"]
    tree.links.new(position, tree.nodes["Noise Texture"].inputs["Vector"])
    outline, *_ = read(scene)
    assert len(baked) == 4
    assert "of 3 meshes" in outline.baked[0]
    # All is known now.
    outline, *_ = read(scene)
    assert len(baked) == 4
    assert outline.baked[0].endswith("kept from before")
    assert not outline.warnings


def test_random_numbers_of_objects_are_those_of_cycles(tmp_path):
    shown = card_scene((1, 1))
    material = bpy.data.materials.new("Card")
    shown.data.materials.append(material)
    tree = material.node_tree
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(tree.nodes.new("ShaderNodeObjectInfo").outputs["Random"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    for name in ("Card", "Leaf.001", "Blätter"):
        shown.name = name
        # Through a pixel filter.
        assert rendered(tmp_path)[0, 0, 0] == pytest.approx(random_of(name), rel=1e-5)


# Nothing is left of it, and nothing stops a bake


def kinds_of_scene():
    scene = floor_scene()
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    group.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketFloat")
    group.links.new(noise(group), group.nodes.new("NodeGroupOutput").inputs[0])

    def by_group(tree):
        node = tree.nodes.new("ShaderNodeGroup")
        node.node_tree = group
        return node.outputs[0]

    card(clear_by("Card", by_group))
    return scene


def test_nothing_of_it_stays_in_the_file():
    scene = kinds_of_scene()
    read(scene, read="fast")  # makes Blender's Render Result
    before, selected = everything(), bpy.context.object
    outline, *_ = read(scene)
    assert outline.baked
    assert everything() == before
    assert bpy.context.object == selected
    assert bpy.context.scene == scene


@pytest.mark.parametrize("failure", [KeyboardInterrupt, RuntimeError, workshop.StrataError])
def test_nothing_of_it_stays_where_it_fails(monkeypatch, failure):
    scene = kinds_of_scene()
    read(scene, read="fast")
    before = everything()

    def fails(*_):
        raise failure("no luck")

    monkeypatch.setattr(workshop.Workshop, "_baked", fails)
    if failure is KeyboardInterrupt:
        with pytest.raises(KeyboardInterrupt):
            read(scene)
    else:
        outline, *_ = read(scene)
        (warning,) = outline.warnings
        assert warning.startswith("material 'Card': node 'Noise Texture' (")
        assert "no luck" in warning
        assert warning.endswith("is not read for opacity, it counts as opaque")
    assert everything() == before


def test_a_scene_with_nothing_to_bake_is_read_once(monkeypatch):
    def fails(*_):
        raise AssertionError

    monkeypatch.setattr(workshop.Workshop, "__enter__", fails)
    scene = floor_scene()
    card(bpy.data.materials.new("Card"))
    outline, *_ = read(scene)
    assert not outline.baked


def test_meshes_of_all_kinds():
    """Without UVs, with faces of no area, with none, hidden, in Edit Mode, in a scene for another engine."""
    scene = floor_scene()
    scene.render.engine = "BLENDER_EEVEE"
    material = clear_by("Card", noise)
    bare = card(material)
    bare.data.uv_layers.remove(bare.data.uv_layers[0])
    flat = card(material, (0.0, 0.0, 2.0))
    flat.data.vertices.foreach_set("co", np.zeros(12, np.float32))
    flat.data.update()
    none = card(material)
    none.data.clear_geometry()
    broken = card(material, (0.2, 0.0, 3.0))
    broken.data.vertices[0].co.x = float("nan")
    card(material, (0.0, 1.0, 1.5)).hide_set(True)
    bpy.ops.object.mode_set(mode="OBJECT")
    edited = card(material, (0.0, -1.0, 1.5))
    bpy.ops.object.mode_set(mode="EDIT")
    outline, *_ = read(scene)
    assert bpy.context.object == edited
    assert bpy.context.mode == "EDIT_MESH"
    assert outline.baked
    shown = {index for instance in outline.instances for index in instance.materials}
    assert not any(outline.materials[index].unread_opacity for index in shown)


def test_an_image_is_gone_through_once_in_a_scan(monkeypatch):
    gone_through = []
    content = upstream.content_of
    monkeypatch.setattr(upstream, "content_of", lambda image: gone_through.append(image) or content(image))
    scene = floor_scene()
    image = float_image("Leaf", 8, 1)

    def by_an_image(tree):
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image = image
        return noise(tree, texture.outputs["Color"])

    for number in range(3):
        card(clear_by(f"Card {number}", by_an_image), (0.0, 0.0, 1.0 + number))
    looked_at()
    assert gone_through == [image]
    read(scene)
    before = looked_at()
    image.pixels[0] = 0.25
    after = looked_at()
    assert before.exactly.parts
    assert not after.exactly.parts  # it is another image


def looked_at(**options):
    """A scan for a panel or a preview: of what is baked already."""
    exact = reading.Exact(can_bake=False)
    return scan(bpy.context.evaluated_depsgraph_get(), ScanOptions(size=(32, 18), exact=exact, **options))


def test_faces_are_laid_out_where_arrays_are_taken_and_once(monkeypatch):
    scene = floor_scene()
    card(clear_by("Card", noise))
    read(scene)
    laid_out = []
    monkeypatch.setattr(reading, "layout_of", lambda *asked: laid_out.append(asked) or layout_of(*asked))
    monkeypatch.setattr(reading, "LAYOUTS", Layouts())
    found = [looked_at() for _edit in range(3)]
    assert not laid_out
    first, *others = [extract(each).meshes for each in found]
    assert len(laid_out) == 1
    assert sum(mesh.corner_uvs is not None for mesh in first) == 1
    for meshes in others:
        for one, other in zip(first, meshes, strict=True):
            np.testing.assert_array_equal(one.corner_uvs, other.corner_uvs)


@pytest.mark.parametrize("is_of_object", [False, True])
def test_a_moved_object_is_read_again_where_its_bakes_hang_on_it(is_of_object):
    scene = floor_scene()

    def made(tree):
        geometry = tree.nodes.new("ShaderNodeNewGeometry")
        return noise(tree, geometry.outputs["Position"] if is_of_object else coordinates(tree, "Generated"))

    shown = card(clear_by("Card", made))
    read(scene)
    before = looked_at().without_sources()
    assert before.exactly.parts
    shown.location.x += 0.5
    bpy.context.view_layer.update()
    changes = Changes(moved={shown.session_uid})
    outline = patched(before, changes, bpy.context.evaluated_depsgraph_get())
    if is_of_object:
        assert outline is None
    else:
        assert outline.instances == looked_at().outline.instances != before.outline.instances


def test_the_clock_is_looked_at_with_every_instance(monkeypatch):
    """Of one that shows what is baked: it may take long."""
    floor_scene()
    ticks = itertools.count()
    monkeypatch.setattr(scan_module, "time", SimpleNamespace(thread_time=lambda: next(ticks)))
    scan(bpy.context.evaluated_depsgraph_get(), ScanOptions(size=(32, 18), seconds=2.0))
    with pytest.raises(TooLong):
        looked_at(seconds=2.0)


def test_instances_that_nodes_tell_apart_stay_unread():
    scene = floor_scene()
    shown = card(clear_by("Card", lambda tree: tree.nodes.new("ShaderNodeObjectInfo").outputs["Random"]))
    collection = bpy.data.collections.new("Cards")
    scene.collection.children.link(collection)
    for place in range(2):
        empty = bpy.data.objects.new("Empty", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        empty.location = (place, 0.0, 1.0)
        scene.collection.objects.link(empty)
    scene.collection.objects.unlink(shown)
    collection.objects.link(shown)
    bpy.context.view_layer.layer_collection.children["Cards"].exclude = True
    outline, *_ = read(scene)
    assert "(it differs between instances)" in outline.warnings[0]


@pytest.mark.parametrize("heights", [(-300.0, 0.0, -300.0), (0.0, -300.0)])
def test_instances_are_as_fine_as_the_nearest_needs(heights):
    scene = floor_scene()
    shown = card(clear_by("Card", noise))
    mesh = bpy.data.meshes.new("Points")
    mesh.from_pydata([(0.0, 0.0, height) for height in heights], [], [])
    points = bpy.data.objects.new("Points", mesh)
    points.instance_type = "VERTS"
    scene.collection.objects.link(points)
    shown.parent = points
    bpy.context.view_layer.update()
    asked = ScanOptions(size=(960, 540), exact=reading.Exact())
    found = scan(bpy.context.evaluated_depsgraph_get(), asked)
    assert len(found.outline.instances) == 2 + len(heights)  # the floor, and the card itself
    # 3 m from 7 m away, 2 texels to each of 960 pixels: 1143, and 1024 at most; from 300 m the least will do.
    assert {part.mesh.size for part in found.exactly.parts.values()} == {1024}


def test_a_colour_by_a_voronoi_is_what_cycles_shows(tmp_path):
    shown = card_scene((24, 24))
    material = bpy.data.materials.new("Card")
    shown.data.materials.append(material)
    tree = material.node_tree
    texture = tree.nodes.new("ShaderNodeTexVoronoi")
    texture.inputs["Scale"].default_value = 3.0
    tree.links.new(coordinates(tree, "Object"), texture.inputs["Vector"])
    tree.links.new(texture.outputs["Position"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    light = bpy.data.lights.new("Sun", "SUN")
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Sun", light))
    scene = bpy.context.scene
    outline, _, arrays, _ = read(scene, composite=True)
    (index,) = {each.base_color_image for each in outline.materials} - {None}
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(texture.outputs["Position"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    seen = rendered(tmp_path)[..., :3]
    texels = arrays.textures[index][..., :3]
    # The card's square fills the picture; every pixel of 24 has a texel's middle near its own.
    ticks = np.clip(np.round((np.arange(24) + 0.5) / 24 * len(texels) - 0.5).astype(int), 0, None)
    found = texels[ticks][:, ticks]
    # Cells have sharp edges: there a texel may lie on the other side.
    assert (np.abs(found - seen).max(axis=-1) < 0.01).mean() > 0.95


def test_what_glows_by_a_noise_is_in_the_composite(tmp_path):
    shown = card_scene((24, 24))
    material = bpy.data.materials.new("Card")
    shown.data.materials.append(material)
    tree, scene = material.node_tree, bpy.context.scene
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(noise(tree), emission.inputs["Strength"])
    emission.inputs["Color"].default_value = (1.0, 0.5, 0.25, 1.0)
    tree.links.new(emission.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    lamp = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    lamp.data.energy = 1e-9
    scene.collection.objects.link(lamp)
    options = replace(OPTIONS, composite=True)
    baked = bake(scene, scene.view_layers[0], options, size=(24, 24))
    assert baked.report.baked[0].startswith("material 'Card': emission baked")
    assert not baked.report.warnings
    seen = rendered(tmp_path)[..., :3]
    assert np.ptp(seen[..., 0]) > 0.9
    # Both look through the middles of pixels, whose hundredth the filter is wide. A texel of 1/128 blurs
    # where the noise is cut off at 0 and 1.
    np.testing.assert_allclose(baked.composite[..., :3], seen, atol=0.03)
    fast = bake(scene, scene.view_layers[0], replace(options, read="fast"), size=(24, 24))
    assert np.abs(fast.composite[..., 0] - seen[..., 0]).max() > 0.9


def test_a_metal_by_a_noise_is_baked_unless_a_picture_would_get_coarser():
    scene = floor_scene()
    material = bpy.data.materials.new("Floor")
    tree = material.node_tree
    tree.links.new(noise(tree), tree.nodes["Principled BSDF"].inputs["Metallic"])
    scene.objects["Floor"].data.materials.append(material)
    card(bpy.data.materials.new("Card"))
    outline, _, arrays, _ = read(scene)
    assert outline.baked[0].startswith("material 'Floor': metallic baked by Blender")
    (index,) = {each.diffuse_image for each in outline.materials} - {None}
    # Of a base colour of 0.8 what is no metal.
    assert np.ptp(arrays.textures[index][..., 0]) == pytest.approx(0.8, abs=0.01)
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = float_image("Floor", 8, 1)
    tree.links.new(texture.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    outline, *_ = read(scene)
    assert not outline.baked
    assert outline.warnings == ("material 'Floor': node 'Noise Texture' is not read for metallic, 0 is used",)


# The cache


def test_a_folder_that_cannot_be_written_to_is_told_once(tmp_path, store):
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    store.folder = blocked / "cache"
    scene = floor_scene()
    card(clear_by("Card", noise))
    outline, *_ = read(scene)
    assert outline.baked
    (warning,) = outline.warnings
    assert warning.startswith("what Blender bakes is kept in memory only")
    baked = bake(scene, scene.view_layers[0], OPTIONS, size=(32, 18))
    assert baked.report.baked[0].endswith("kept from before")
