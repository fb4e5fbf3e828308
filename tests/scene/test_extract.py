"""Arrays against Blender's own elements, materials and pixels."""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import mathutils
import numpy as np
import pytest
import strata_kernels
from strata.addon.core.arrays import MeshArrays, OpacityArrays
from strata.addon.core.material import Opacity
from strata.addon.scene.corner_values import corner_colours, corner_opacity
from strata.addon.scene.extract import (
    BASE_COLOR,
    CORNER_NORMALS,
    OPACITY,
    UV,
    WANTS,
    extract,
    with_known_clips,
)
from strata.addon.scene.nodes.values import COLOUR, FLOAT, Attribute, converted, variable
from strata.addon.scene.open import choose, open_blend
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.addon.scene.scan import ScanOptions, scan
from strata.tests.support.places import SAMPLES


@pytest.fixture
def scene():
    """Empty but for a camera."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    return scene


def kernel_opacity(opacity: OpacityArrays) -> strata_kernels.Opacity:
    return strata_kernels.Opacity(opacity.value, opacity.texels, opacity.by_corner, opacity.threshold)


def read(scene, wants=WANTS, view_layer=None, options=None):
    def look(depsgraph):
        scanned = scan(depsgraph, options or ScanOptions())
        return scanned.outline, extract(scanned, wants)

    return with_render_depsgraph(scene, view_layer or scene.view_layers[0], look)


def material_on(thing, name="Material"):
    material = bpy.data.materials.new(name)
    thing.data.materials.append(material)
    return material, material.node_tree.nodes["Principled BSDF"]


def image_node(material, node, pixels, socket="Base Color", output="Color", space="sRGB", is_float=False):
    """An image from (H, W, 4) floats, linked to a socket of `node`."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new("Image", width, height, alpha=True, float_buffer=is_float)
    image.colorspace_settings.name = space
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    texture = material.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    material.node_tree.links.new(texture.outputs[output], node.inputs[socket])
    return texture


def test_arrays_are_blenders_elements(scene):
    """Mixed polygons (an n-gon, quads, triangles), smooth, two slots, two UV maps."""
    bpy.ops.mesh.primitive_cylinder_add(vertices=7, end_fill_type="NGON")
    thing = bpy.context.object
    bpy.ops.mesh.primitive_cone_add(vertices=5, end_fill_type="TRIFAN", location=(3.0, 0.0, 0.0))
    thing.select_set(True)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.join()
    mesh = thing.data
    mesh.shade_smooth()
    mesh.uv_layers.new(name="Second")
    mesh.uv_layers["Second"].uv.foreach_set("vector", np.random.default_rng(1).random(2 * len(mesh.loops)))
    mesh.uv_layers["Second"].active_render = True
    for name in ("One", "Two"):
        material, node = material_on(thing, name)
        image_node(material, node, np.ones((1, 1, 4)))
    mesh.polygons.foreach_set("material_index", np.arange(len(mesh.polygons)) % 2)
    outline, arrays = read(scene)
    got = arrays.meshes[0]
    np.testing.assert_array_equal(got.positions, [v.co[:] for v in mesh.vertices])
    np.testing.assert_array_equal(got.corner_vertices, [corner.vertex_index for corner in mesh.loops])
    starts = [p.loop_start for p in mesh.polygons] + [len(mesh.loops)]
    np.testing.assert_array_equal(got.face_starts, starts)
    np.testing.assert_array_equal(got.corner_normals, [n.vector[:] for n in mesh.corner_normals])
    np.testing.assert_array_equal(got.corner_uvs, [d.vector[:] for d in mesh.uv_layers["Second"].uv])
    np.testing.assert_array_equal(got.face_slots, [p.material_index for p in mesh.polygons])
    assert outline.meshes[0].triangles == len(mesh.loop_triangles)
    assert [outline.materials[m].name for m in outline.instances[0].materials] == ["One", "Two"]
    assert got.vertex_values == {}
    for array in list(vars(got).values())[:6]:
        assert array.flags.c_contiguous
    geometry = strata_kernels.Geometry()
    geometry.add_mesh(*list(vars(got).values())[:6])
    for opacities in arrays.opacities:
        sides = (kernel_opacity(opacities.casts[0]), kernel_opacity(opacities.casts[1]))
        geometry.add_material(sides, sides)
    geometry.add_instance(0, arrays.matrices[0], 0, list(outline.instances[0].materials))
    assert geometry.triangle_count() == outline.triangles


def test_triangles_need_no_look_at_faces(scene):
    bpy.ops.mesh.primitive_ico_sphere_add()
    mesh = bpy.context.object.data
    starts = read(scene)[1].meshes[0].face_starts
    np.testing.assert_array_equal(starts, [p.loop_start for p in mesh.polygons] + [len(mesh.loops)])


def test_only_what_is_wanted_comes(scene):
    bpy.ops.mesh.primitive_uv_sphere_add()
    material, node = material_on(bpy.context.object)
    image_node(material, node, np.ones((1, 1, 4)))
    bpy.context.object.data.shade_smooth()
    for wants in (set(), {CORNER_NORMALS}, {UV}, {UV, OPACITY}, {UV, BASE_COLOR}, WANTS):
        _, arrays = read(scene, wants)
        got = arrays.meshes[0]
        assert (got.corner_normals is not None) == (CORNER_NORMALS in wants)
        # The texture is of the base colour, so alpha alone needs no uv.
        assert (got.corner_uvs is not None) == ({UV, BASE_COLOR} <= set(wants))
        assert bool(arrays.textures) == (BASE_COLOR in wants)
    bpy.context.object.data.shade_flat()
    assert read(scene)[1].meshes[0].corner_normals is None


def test_missing_uv_map_is_told(scene):
    bpy.ops.mesh.primitive_cube_add()
    thing = bpy.context.object
    thing.data.uv_layers.remove(thing.data.uv_layers[0])
    material, node = material_on(thing)
    image_node(material, node, np.ones((1, 1, 4)))
    _, arrays = read(scene)
    assert arrays.meshes[0].corner_uvs is None
    assert arrays.warnings == ("object 'Cube': it has no UV map, its textures are read at one point",)


def test_principled_values(scene):
    bpy.ops.mesh.primitive_cube_add()
    _, node = material_on(bpy.context.object, "Red")
    node.inputs["Base Color"].default_value = (0.9, 0.1, 0.2, 1.0)
    node.inputs["Emission Color"].default_value = (1.0, 0.5, 0.0, 1.0)
    node.inputs["Emission Strength"].default_value = 2.0
    (outline, arrays) = read(scene)
    (material,) = outline.materials
    assert material.metallic == 0.0
    assert material.base_color == pytest.approx((0.9, 0.1, 0.2))
    assert material.emission == (2.0, 1.0, 0.0)
    assert material.opacities == {Opacity()}
    assert not outline.warnings
    node.inputs["Alpha"].default_value = 0.25
    node.inputs["Transmission Weight"].default_value = 0.5
    node.inputs["Metallic"].default_value = 0.75
    assert read(scene)[0].materials[0].metallic == 0.75
    tree, texture = node.id_data, node.id_data.nodes.new("ShaderNodeTexNoise")
    tree.links.new(texture.outputs[0], node.inputs["Metallic"])
    assert read(scene)[0].materials[0].metallic == 0.0
    node.inputs["Metallic"].default_value = 0.0
    tree.nodes.remove(texture)
    (outline, arrays) = read(scene)
    assert outline.materials[0].opacities == {Opacity(0.25)}
    opacity = arrays.opacities[0].casts[1]
    assert (opacity.value, opacity.threshold) == (0.25, 0.0)
    assert outline.warnings == ("material 'Red': of node 'Principled BSDF' Transmission is not read",)


def test_other_surfaces_fall_back_to_the_viewport_colour(scene):
    bpy.ops.mesh.primitive_cube_add()
    thing = bpy.context.object
    material, _ = material_on(thing, "Odd")
    material.diffuse_color = (0.1, 0.2, 0.3, 1.0)
    tree = material.node_tree
    tree.nodes.clear()
    odd, output = tree.nodes.new("ShaderNodeBsdfRayPortal"), tree.nodes.new("ShaderNodeOutputMaterial")
    reroute = tree.nodes.new("NodeReroute")
    tree.links.new(odd.outputs[0], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], output.inputs["Surface"])
    bare, _ = material_on(thing, "Bare")
    bare.node_tree.nodes.clear()
    noisy, node = material_on(thing, "Noisy")
    noise = noisy.node_tree.nodes.new("ShaderNodeTexNoise")
    noisy.node_tree.links.new(noise.outputs[0], node.inputs["Base Color"])
    noisy.node_tree.links.new(noise.outputs[0], node.inputs["Alpha"])
    thing.data.materials.append(None)
    outline, _ = read(scene)
    materials = {material.name: material for material in outline.materials}
    colours = {name: material.base_color for name, material in materials.items()}
    assert colours["Odd"] == pytest.approx((0.1, 0.2, 0.3))
    assert {name for name, material in materials.items() if material.unread_opacity} == {"Odd", "Noisy"}
    assert all(each.is_whole for material in materials.values() for each in material.opacities)
    assert colours["Bare"] == (0.0, 0.0, 0.0)
    for name in ("", "Noisy"):
        assert colours[name] == pytest.approx((0.8, 0.8, 0.8))
    assert outline.warnings == (
        "material 'Odd': node 'Ray Portal BSDF' is not read for opacity, it counts as opaque",
        "material 'Odd': node 'Ray Portal BSDF' is not read for base colour, its viewport colour is used",
        "material 'Bare': without a shader it is black, as in Cycles",
        "material 'Noisy': node 'Noise Texture' is not read for opacity, it counts as opaque",
        "material 'Noisy': node 'Noise Texture' is not read for base colour, its viewport colour is used",
    )


def test_object_slots_override_the_meshs(scene):
    bpy.ops.mesh.primitive_cube_add()
    first = bpy.context.object
    material_on(first, "Of the mesh")
    twin = bpy.data.objects.new("Twin", first.data)
    scene.collection.objects.link(twin)
    twin.material_slots[0].link = "OBJECT"
    twin.material_slots[0].material = bpy.data.materials.new("Of the object")
    outline, _ = read(scene)
    used = {i.name: outline.materials[i.materials[0]].name for i in outline.instances}
    assert used == {"Cube": "Of the mesh", "Twin": "Of the object"}
    assert len(outline.meshes) == 1


def test_a_texture_of_only_0_and_1_is_a_clip(scene):
    bpy.ops.mesh.primitive_plane_add()
    material, node = material_on(bpy.context.object)
    pixels = np.repeat(np.random.default_rng(2).integers(0, 2, (3, 5, 1)), 4, axis=2).astype(float)
    image_node(material, node, pixels, "Alpha", "Alpha", space="Non-Color")
    outline, arrays = read(scene)
    assert outline.materials[0].casts[0].is_partial
    assert arrays.opacities[0].casts[0].threshold == 0.5
    known = with_known_clips(outline, arrays)
    assert not any(opacity.is_partial for opacity in known.materials[0].opacities)


@pytest.mark.parametrize(
    ("output", "threshold"),
    [("Alpha", None), ("Color", None), ("Alpha", 0.25)],
    ids=["alpha", "colour", "math"],
)
def test_alpha_images_clip(scene, output, threshold):
    bpy.ops.mesh.primitive_plane_add()
    material, node = material_on(bpy.context.object)
    pixels = np.random.default_rng(2).integers(0, 256, (3, 5, 4)) / 255.0
    texture = image_node(material, node, pixels, "Alpha", output, space="Non-Color")
    if threshold is not None:
        math = material.node_tree.nodes.new("ShaderNodeMath")
        math.operation = "GREATER_THAN"
        math.inputs[1].default_value = threshold
        material.node_tree.links.new(texture.outputs[output], math.inputs[0])
        material.node_tree.links.new(math.outputs[0], node.inputs["Alpha"])
    outline, arrays = read(scene)
    assert not outline.warnings + arrays.warnings
    (opacities,) = arrays.opacities
    opacity = opacities.seen[0]
    assert opacity.threshold == pytest.approx(threshold or 0.0, rel=1e-6)  # more than, in float32
    expected = pixels[..., 3] if output == "Alpha" else pixels[..., :3] @ CYCLES_LUMINANCE
    np.testing.assert_allclose(opacity.texels, expected, atol=1e-6)
    assert arrays.meshes[0].corner_uvs is not None


# Red, green and blue light of a Rec.709 file as its RGB to BW turns them into floats.
CYCLES_LUMINANCE = [0.2126391, 0.7151691, 0.0721927]


def test_mappings_move_the_uvs_of_their_faces(scene):
    """A Mapping node on the second of two slots: its pictures lie elsewhere, a chart does not."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=2, y_subdivisions=2)
    mesh = bpy.context.object.data
    plain = image_node(*material_on(bpy.context.object, "Plain"), np.ones((1, 1, 4)))
    moved = image_node(*material_on(bpy.context.object, "Moved"), np.ones((1, 1, 4)))
    assert plain.image != moved.image
    tree = moved.id_data
    mapping, uv = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeUVMap")
    mapping.inputs["Location"].default_value = (0.5, 0.0, 0.0)
    mapping.inputs["Scale"].default_value = (3.0, 2.0, 1.0)
    tree.links.new(uv.outputs[0], mapping.inputs[0])
    tree.links.new(mapping.outputs[0], moved.inputs[0])
    mesh.polygons.foreach_set("material_index", [0, 1, 1, 0])
    uvs = np.array([d.vector[:] for d in mesh.uv_layers[0].uv], np.float32)
    _, arrays = read(scene)
    expected = uvs.copy()
    expected[4:12] = uvs[4:12] * (3.0, 2.0) + (0.5, 0.0)
    np.testing.assert_allclose(arrays.meshes[0].corner_uvs, expected, atol=1e-6)
    np.testing.assert_array_equal(arrays.meshes[0].chart_uvs, uvs)
    assert not arrays.warnings
    # What is only right in the unit square is told where a mesh leaves it.
    moved.extension = "CLIP"
    _, arrays = read(scene)
    assert arrays.warnings == (
        "object 'Grid': its UVs leave 0 to 1, beyond that material 'Moved' is read as repeated",
    )


def factor(name, output):
    return variable(COLOUR if output == "Color" else FLOAT, Attribute(name, output))


def test_opacity_of_corners(scene):
    """Slots 0 and 2 read attributes of points and of corners, slot 1 none, slot 3 one that is missing."""
    mesh = bpy.data.meshes.new("Strips")
    corners = [(x, y, 0.0) for y in (0.0, 1.0) for x in range(5)]
    mesh.from_pydata(corners, [], [(i, i + 1, i + 6, i + 5) for i in range(4)])
    mesh.polygons.foreach_set("material_index", np.arange(4, dtype=np.int32))
    points = mesh.attributes.new("there", "FLOAT", "POINT")
    points.data.foreach_set("value", np.linspace(0.0, 0.9, 10, dtype=np.float32))
    colours = mesh.attributes.new("tint", "FLOAT_COLOR", "CORNER")
    rgba = np.random.default_rng(1).random((16, 4)).astype(np.float32)
    rgba[8] = np.nan
    colours.data.foreach_set("color", rgba.ravel())
    faces = np.array(mesh.polygons[0].vertices[:] + mesh.polygons[1].vertices[:], np.int32)
    assert faces.tolist() == [0, 1, 6, 5, 1, 2, 7, 6]
    vertices = np.array([v for face in mesh.polygons for v in face.vertices], np.int32)
    slots = np.arange(4, dtype=np.int32)
    read_mesh = MeshArrays(
        np.array(corners, np.float32), vertices, np.arange(0, 17, 4, dtype=np.int32), face_slots=slots
    )
    warnings = []
    found = corner_opacity(
        mesh, read_mesh, [factor("there", "Fac"), None, factor("tint", "Alpha"), factor("lost", "Fac")],
        "Strips", warnings,
    )  # fmt: skip
    np.testing.assert_allclose(found[:4], [0.0, 0.1, 0.6, 0.5], atol=1e-6)
    assert (found[4:8] == 1.0).all()
    np.testing.assert_array_equal(found[8:12], [0.0, *rgba[9:12, 3]])
    assert (found[12:] == 0.0).all()
    assert warnings == ["object 'Strips': it has no attribute 'lost', which counts as 0"]
    found = corner_opacity(mesh, read_mesh, [converted(factor("tint", "Color"), FLOAT)], "Strips", warnings)
    np.testing.assert_allclose(found[9:], rgba[9:, :3] @ CYCLES_LUMINANCE, rtol=1e-5)
    rgba[9] = -1.0, 7.0, np.inf, 1.0
    colours.data.foreach_set("color", rgba.ravel())
    spread = converted(factor("there", "Fac"), COLOUR)
    found = corner_colours(mesh, read_mesh, [spread, None, factor("tint", "Color")], "Strips", warnings)
    np.testing.assert_allclose(found[:4], np.repeat([[0.0], [0.1], [0.6], [0.5]], 3, axis=1), atol=1e-6)
    assert (found[4:8] == 1.0).all()
    np.testing.assert_allclose(found[8:10], [(0.0, 0.0, 0.0), (0.0, 7.0, 1e30)], rtol=1e-6)
    np.testing.assert_array_equal(found[10:12], rgba[10:12, :3])


@pytest.mark.parametrize("working_space", ["Linear Rec.709", "Linear Rec.2020", "ACEScg"])
@pytest.mark.parametrize("space", ["sRGB", "Non-Color", "float"])
def test_colours_are_scene_linear(scene, space, working_space):
    """Against Blender's own conversion."""
    bpy.ops.wm.set_working_color_space(working_space=working_space)
    bpy.ops.mesh.primitive_plane_add()
    material, node = material_on(bpy.context.object)
    pixels = np.random.default_rng(3).integers(0, 256, (4, 2, 4)) / 255.0
    is_float = space == "float"
    image_node(material, node, pixels, space="sRGB" if not is_float and space == "sRGB" else "Non-Color",
               is_float=is_float)  # fmt: skip
    outline, arrays = read(scene)
    assert outline.working_space == working_space
    (texels,) = arrays.textures.values()
    colours = pixels[..., :3].reshape(-1, 3).tolist()
    if space == "sRGB":
        # The node's Alpha is not linked: Cycles shows colours over black then.
        colours = (pixels[..., :3] * pixels[..., 3:]).reshape(-1, 3).tolist()
        colours = [mathutils.Color(c).from_srgb_to_scene_linear()[:] for c in colours]
    np.testing.assert_allclose(texels[..., :3].reshape(-1, 3), colours, atol=1e-6)
    np.testing.assert_allclose(texels[..., 3], pixels[..., 3], atol=1e-6)


def test_missing_and_broken_images(scene, tmp_path):
    bpy.ops.mesh.primitive_plane_add()
    thing = bpy.context.object
    for name, content in (("Gone", None), ("Broken", b"no picture")):
        material, node = material_on(thing, name)
        for socket, output in (("Base Color", "Color"), ("Alpha", "Alpha")):
            texture = image_node(material, node, np.ones((2, 2, 4)), socket, output)
            texture.image.source = "FILE"
            texture.image.filepath = str(tmp_path / f"{name}.png")
        if content is not None:
            (tmp_path / f"{name}.png").write_bytes(content)
        else:
            material.node_tree.nodes.new("ShaderNodeTexImage")
    outline, arrays = read(scene)
    gone = [w for w in outline.warnings if w.startswith("material 'Gone'")]
    assert len(gone) == 2
    assert all("it is missing: Gone.png" in warning for warning in gone)
    assert {w.split(":")[0] for w in arrays.warnings} == {"material 'Broken'"}
    assert not arrays.textures
    found = [each.seen[0] for each in arrays.opacities]
    assert [(opacity.value, opacity.texels) for opacity in found] == [(1.0, None), (1.0, None)]


def scene_files():
    folders = [SAMPLES]
    if os.environ.get("STRATA_SCENES"):
        folders.append(Path(os.environ["STRATA_SCENES"]))
    return sorted(path for folder in folders for path in folder.glob("*.blend"))


@pytest.mark.parametrize("path", scene_files(), ids=lambda path: path.stem)
def test_every_scene_reads(path):
    open_blend(path)
    chosen = choose()
    outline, arrays = read(chosen.scene, view_layer=chosen.view_layer)
    assert outline.instances
    assert outline.lights
    bounds = np.array([(i.bounds.low, i.bounds.high) for i in outline.instances])
    assert np.isfinite(bounds).all()
    geometry = strata_kernels.Geometry()
    for mesh in arrays.meshes:
        geometry.add_mesh(*list(vars(mesh).values())[:6])
        if mesh.corner_normals is not None:
            lengths = np.linalg.norm(mesh.corner_normals, axis=1)
            assert np.abs(lengths - 1.0).max() < 1e-3
    for opacities in arrays.opacities:
        sides = (kernel_opacity(opacities.casts[0]), kernel_opacity(opacities.casts[1]))
        geometry.add_material(sides, sides)
    for instance, matrix in zip(outline.instances, arrays.matrices, strict=True):
        geometry.add_instance(instance.mesh, matrix, instance.object_id, list(instance.materials))
    assert geometry.triangle_count() == outline.triangles
