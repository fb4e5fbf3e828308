"""Displacement of what a material's nodes tell: positions, normals, and the boxes that plans go by."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from strata.addon.scene.rescan import Changes, patched
from strata.addon.scene.scan import scan
from strata.tests.support.displaced_scenes import displacing, grid, image_of
from strata.tests.support.scan_scenes import cube, empty_scene, read


@pytest.fixture
def scene():
    return empty_scene()


@pytest.mark.parametrize("method", ["DISPLACEMENT", "BOTH"])
def test_a_constant_moves_along_normals(scene, method):
    shown = grid("Ground", 4)
    shown.data.materials.append(displacing(height=0.8, scale=2.0, method=method))
    shown.scale = (3.0, 3.0, 3.0)
    outline, arrays = read(scene)
    assert outline.warnings == arrays.warnings == ()
    assert arrays.meshes[0].positions[:, 2] == pytest.approx(0.6)  # in its own space
    (instance,) = outline.instances
    assert instance.bounds.low[2] <= 1.8 <= instance.bounds.high[2]


def test_bumps_move_nothing(scene):
    grid("Ground", 4).data.materials.append(displacing(height=0.8, method="BUMP"))
    assert (read(scene)[1].meshes[0].positions[:, 2] == 0.0).all()


def test_a_sharp_box_grows_and_stays_sharp(scene):
    """Vertices go along their own normals, as in Cycles, which keeps the box closed."""
    cube("Box").data.materials.append(displacing(height=0.5 + 3.0**0.5))
    _, arrays = read(scene)
    assert np.abs(arrays.meshes[0].positions) == pytest.approx(2.0)


def ramp(width=16):
    """Half a texel beside its ends an image repeats: heights are straight between."""
    return np.tile((np.arange(width) + 0.5) / width, (4, 1)).astype(np.float32)


@pytest.mark.parametrize("is_float", [True, False])
def test_an_image_moves_by_its_texels(scene, is_float):
    shown = grid("Ground", 8)
    for polygon in shown.data.polygons:
        polygon.use_smooth = True
    shown.data.materials.append(displacing(height=image_of(ramp(), is_float), midlevel=0.25, scale=0.5))
    outline, arrays = read(scene)
    assert outline.warnings == outline.unknown == arrays.warnings == ()
    mesh = arrays.meshes[0]
    u = 0.5 * (mesh.positions[:, 0] + 1.0)
    inside = (u > 0.05) & (u < 0.95)
    exact = {"abs": 1e-6 if is_float else 0.5 / 255}  # bytes are rounded
    assert mesh.positions[inside, 2] == pytest.approx(0.5 * (u[inside] - 0.25), **exact)
    # At the border it is the mean of both ends.
    assert mesh.positions[~inside, 2] == pytest.approx(0.5 * (0.5 - 0.25), **exact)
    # A slope of a quarter, where all faces around have it.
    flat = (u > 0.2) & (u < 0.8)
    corners = mesh.corner_normals[flat[mesh.corner_vertices]]
    assert corners == pytest.approx(
        np.tile(np.array([-0.25, 0, 1]) / 1.0625**0.5, (len(corners), 1)), abs=0.01
    )
    low, high = outline.instances[0].bounds.low, outline.instances[0].bounds.high
    assert (mesh.positions.min(axis=0) >= np.array(low) - 1e-6).all()
    assert (mesh.positions.max(axis=0) <= np.array(high) + 1e-6).all()
    assert high[2] < 0.51


def test_an_attribute_moves_by_what_vertices_have(scene):
    """Colours beyond 1 too."""
    shown = grid("Ground", 4)
    heights = np.linspace(0.0, 8.0, len(shown.data.vertices), dtype=np.float32)
    colours = np.repeat(heights, 4)
    shown.data.color_attributes.new("Height", "FLOAT_COLOR", "POINT").data.foreach_set("color", colours)
    material = displacing(midlevel=0.0)
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "Height"
    tree.links.new(node.outputs["Color"], tree.nodes["Displacement"].inputs["Height"])
    shown.data.materials.append(material)
    outline, arrays = read(scene)
    assert arrays.meshes[0].positions[:, 2] == pytest.approx(heights, rel=1e-5)
    assert outline.instances[0].bounds.high[2] == pytest.approx(8.0)


def test_slots_move_their_own_faces(scene):
    """Vertices between go with those that move."""
    shown = grid("Ground", 4)
    shown.data.materials.append(displacing(height=0.5))  # at its midlevel: not moved
    shown.data.materials.append(displacing("Up", height=1.5))
    for index, polygon in enumerate(shown.data.polygons):
        polygon.material_index = int(index >= 8)
    mesh = read(scene)[1].meshes[0]
    faces = mesh.corner_vertices.reshape(-1, 4)
    assert (mesh.positions[faces[:4], 2] == 0.0).all()
    assert (mesh.positions[faces[8:], 2] == 1.0).all()


def test_each_object_is_displaced_by_its_own_material(scene):
    """One mesh, which an object's own slots displace otherwise."""
    first = grid("First", 2)
    first.data.materials.append(displacing("One", height=1.5))
    for name, height in (("Same", None), ("Other", 2.5), ("Flat", 0.5)):
        twin = bpy.data.objects.new(name, first.data)
        scene.collection.objects.link(twin)
        if height is not None:
            twin.material_slots[0].link = "OBJECT"
            twin.material_slots[0].material = displacing(name, height=height)
    outline, arrays = read(scene)
    heights = {i.name: float(arrays.meshes[i.mesh].positions[0, 2]) for i in outline.instances}
    assert heights == {"First": 1.0, "Same": 1.0, "Other": 2.0, "Flat": 0.0}
    assert len(outline.meshes) == 3


@pytest.mark.parametrize(
    ("how", "unread"),
    [
        ({}, "node 'Noise Texture'"),
        ({"height": 0.8, "space": "WORLD"}, "space of node 'Displacement'"),
    ],
)
def test_what_is_not_read_is_told(scene, how, unread):
    grid("Ground", 4).data.materials.append(displacing(**how))
    outline, arrays = read(scene)
    line = f"material 'Terrain' of object 'Ground': displacement by {unread} is not read, shapes and shadows "
    assert outline.warnings == outline.unknown == (f"{line}are taken without it",)
    assert (arrays.meshes[0].positions[:, 2] == 0.0).all()


def test_adaptive_subdivision_is_told(scene):
    shown = grid("Ground", 4)
    shown.data.materials.append(displacing(height=0.8))
    shown.modifiers.new("Fine", "SUBSURF").use_adaptive_subdivision = True
    line = (
        "object 'Ground': its adaptive subdivision is not read, displacement moves the vertices that it has"
    )
    outline, _ = read(scene)
    assert (outline.warnings, outline.unknown) == ((line,), ())


def test_a_moved_object_is_read_again(scene):
    """Its own box does not tell how far it reaches."""
    shown = grid("Ground", 4)
    shown.data.materials.append(displacing(height=1.5))
    plain = grid("Plain", 4)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    scanned = scan(depsgraph)
    assert patched(scanned, Changes(moved={plain.session_uid}), depsgraph) is not None
    assert patched(scanned, Changes(moved={shown.session_uid}), depsgraph) is None
