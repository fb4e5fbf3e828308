"""Hair curves, particle hair and point clouds in a scan: what is shown, where, and of what material."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from strata.addon.planning import Options
from strata.addon.scene.scan import scan
from strata.ops.planning import described_plan, plan_lines, read_plan
from strata.tests.support.scan_scenes import cube, empty_scene, names, read


@pytest.fixture
def scene():
    return empty_scene()


def hairy(name="Hairy", **settings):
    """A plane of two by two metres with ten hairs of a metre."""
    bpy.ops.mesh.primitive_plane_add()
    shown = bpy.context.object
    shown.name = name
    hair = shown.modifiers.new("Hair", "PARTICLE_SYSTEM").particle_system.settings
    hair.type, hair.count, hair.hair_length, hair.render_step = "HAIR", 10, 1.0, 3
    for key, value in settings.items():
        setattr(hair, key, value)
    return shown


def hair_of(outline, arrays, name="Hairy"):
    """Instance and mesh that are not the plane's."""
    (found,) = (i for i in outline.instances if i.name == name and outline.meshes[i.mesh].triangles > 2)
    return found, arrays.meshes[found.mesh]


def strands(mesh, steps, sides=8):
    """(S, steps, 3): middles of the rings of vertices."""
    return mesh.positions.reshape(-1, steps, sides, 3).mean(axis=2)


def test_particle_hair_stands_on_its_emitter(scene):
    shown = hairy(root_radius=2.0, tip_radius=1.0, radius_scale=0.1, use_close_tip=False)
    shown.location, shown.scale = (5.0, 0.0, 1.0), (2.0, 2.0, 2.0)
    outline, arrays = read(scene)
    found, mesh = hair_of(outline, arrays)
    assert outline.warnings == outline.unknown == ()
    keys = strands(mesh, 9)
    assert keys.shape == (10, 9, 3)
    assert np.abs(keys[:, 0, 2]).max() < 1e-5
    assert np.abs(keys[:, 0]).max() <= 1.0
    # Hair of a metre in the world on an object twice as large: half a metre in its own space.
    assert np.allclose(keys[:, -1] - keys[:, 0], (0.0, 0.0, 0.5), atol=1e-4)
    # Widths are diameters: the scale times a half. The polygon's corners lie a little outside.
    rings = np.linalg.norm(mesh.positions.reshape(10, 9, 8, 3) - keys[:, :, None], axis=3) / 1.0262
    assert np.allclose(rings.mean(axis=2), 0.1 - 0.05 * keys[:, :, 2] / 0.5, rtol=1e-3)
    assert found.bounds.low[2] == pytest.approx(1.0, abs=0.3)
    assert found.bounds.high[2] == pytest.approx(2.0, abs=0.3)
    assert (found.visible_camera, found.casts_shadow) == (True, True)
    # The same object as its emitter, for outlines and ids.
    assert len({instance.object_id for instance in outline.instances}) == 1


@pytest.mark.parametrize(
    ("settings", "count"),
    [
        ({"child_type": "SIMPLE", "rendered_child_count": 7}, 70),
        ({"child_type": "INTERPOLATED", "rendered_child_count": 7}, 70),
        ({"child_type": "SIMPLE", "rendered_child_count": 0}, 10),
        ({"render_type": "NONE"}, None),
        ({"render_type": "OBJECT"}, None),
    ],
)
def test_children_stand_for_their_parents(scene, settings, count):
    hairy(**settings)
    outline, arrays = read(scene)
    if count is None:
        assert names(outline) == ["Hairy"]
    else:
        assert len(strands(hair_of(outline, arrays)[1], 9)) == count


def test_switches_of_particles(scene):
    hairy("Bare").show_instancer_for_render = False
    hairy("Off").modifiers[0].show_render = False
    hairy("Hidden").hide_render = True
    shown = hairy("Held")
    shown.is_holdout, shown.visible_shadow, shown.visible_camera = True, False, False
    outline, _ = read(scene)
    assert names(outline) == ["Bare", "Held", "Held", "Off"]
    held = [i for i in outline.instances if i.name == "Held"]
    assert all(i.is_holdout and not i.casts_shadow and not i.visible_camera for i in held)
    in_viewport = scan(bpy.context.evaluated_depsgraph_get()).outline
    assert names(in_viewport) == sorted(["Bare", "Held", "Hidden", "Off"] * 2)


def test_instances_share_their_hair(scene):
    library = bpy.data.collections.new("Library")
    shown = hairy()
    scene.collection.objects.unlink(shown)
    library.objects.link(shown)
    for index in range(3):
        empty = bpy.data.objects.new(f"Empty{index}", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", library
        empty.location = (10.0 * index, 0.0, 0.0)
        scene.collection.objects.link(empty)
    outline, _ = read(scene)
    assert names(outline) == ["Hairy"] * 6
    assert len(outline.meshes) == 2
    lows = sorted(i.bounds.low[0] for i in outline.instances if outline.meshes[i.mesh].triangles > 2)
    assert np.diff(lows) == pytest.approx([10.0, 10.0])
    assert read(scene)[0] == outline


def test_hair_has_the_material_that_it_says(scene):
    shown = hairy(material=2)
    for name in ("Skin", "Fur"):
        shown.data.materials.append(bpy.data.materials.new(name))
    outline, arrays = read(scene)
    found, _ = hair_of(outline, arrays)
    assert [outline.materials[slot].name for slot in found.materials] == ["Fur"]
    shown.particle_systems[0].settings.material = 9  # more than there are: the last
    outline, arrays = read(scene)
    assert [outline.materials[slot].name for slot in hair_of(outline, arrays)[0].materials] == ["Fur"]


def textured():
    """A material whose colour is an image's."""
    material = bpy.data.materials.new("Painted")
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.new("Paint", 4, 4)
    material.node_tree.links.new(node.outputs[0], material.node_tree.nodes["Principled BSDF"].inputs[0])
    return material


@pytest.mark.parametrize("child_type", ["NONE", "INTERPOLATED"])
def test_hair_is_textured_at_its_root(scene, child_type):
    """The plane's own UV map goes from corner to corner."""
    hairy(child_type=child_type, rendered_child_count=5).data.materials.append(textured())
    _, mesh = hair_of(*read(scene))
    roots = strands(mesh, 9)[:, 0]
    expected = 0.5 * (roots[:, :2] + 1.0)
    of_strand = mesh.corner_uvs.reshape(len(roots), -1, 2)
    assert (of_strand == of_strand[:, :1]).all()
    # Interpolated children start a little beside the place that their texture is read at.
    assert np.abs(of_strand[:, 0] - expected).max() < (1e-4 if child_type == "NONE" else 0.05)


def curves(name, points, lengths, **attributes):
    made = bpy.data.hair_curves.new(name)
    if lengths:
        made.add_curves(lengths)
        made.attributes["position"].data.foreach_set("vector", np.asarray(points, np.float32).ravel())
    for attribute, (domain, kind, values) in attributes.items():
        item = "vector" if kind == "FLOAT2" else "value"
        data = made.attributes.new(attribute, kind, domain).data
        data.foreach_set(item, np.asarray(values, np.float32).ravel())
    shown = bpy.data.objects.new(name, made)
    bpy.context.scene.collection.objects.link(shown)
    return shown


def test_a_plan_tells_what_much_hair_takes(scene):
    """A hundred thousand children of four segments: six triangles a segment, 230 bytes each at least."""
    shown = hairy(count=1000, child_type="SIMPLE", rendered_child_count=100, render_step=2, kink="CURL")
    scene.camera.location = (0.0, 0.0, 9.0)
    scene.collection.objects.link(bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN")))

    def plan():
        read = read_plan(scene, scene.view_layers[0], lambda _: Options(), size=(64, 64))
        return described_plan(*read)

    full = plan()
    shown.modifiers[0].show_render = False
    bare = plan()
    hair = 6 * 4 * 100_000
    assert full["triangles_read"] - bare["triangles_read"] == hair
    assert full["memory"]["shared_bytes"] - bare["memory"]["shared_bytes"] >= 230 * hair
    assert f"geometry: 2 of 2 instances, {hair + 2:,} triangles" in list(plan_lines(full))


def test_hair_curves(scene):
    points = [(0, 0, 0), (0, 0, 1), (1, 0, 0), (1, 0, 1), (1, 0, 2)]
    shown = curves(
        "Fur", points, [2, 3],
        radius=("CURVE", "FLOAT", [0.1, 0.2]),
        surface_uv_coordinate=("CURVE", "FLOAT2", [(0.25, 0.5), (0.75, 1.0)]),
    )  # fmt: skip
    shown.data.materials.append(textured())
    outline, arrays = read(scene)
    assert outline.warnings == outline.unknown == arrays.warnings == ()
    ((instance,), (mesh,)) = outline.instances, arrays.meshes
    assert outline.meshes[0].triangles == 2 * 8 * 3
    assert outline.materials[instance.materials[0]].name == "Painted"
    rings = mesh.positions.reshape(5, 8, 3)
    assert np.allclose(rings.mean(axis=1), points, atol=1e-6)
    radii = np.linalg.norm(rings - rings.mean(axis=1, keepdims=True), axis=2).mean(axis=1)
    assert np.allclose(radii / 1.0262, [0.1, 0.1, 0.2, 0.2, 0.2], rtol=1e-3)
    assert mesh.corner_uvs[0].tolist() == [0.25, 0.5]
    assert mesh.corner_uvs[-1].tolist() == [0.75, 1.0]


def test_bad_curves_and_points_are_left_out(scene):
    curves("Short", [(0, 0, 0)], [1])
    curves("Nowhere", [(0, 0, np.nan), (0, 0, 1)], [2])
    curves("None", [], [])
    curves("Thin", [(0, 0, 0), (0, 0, 1)], [2], radius=("POINT", "FLOAT", [0.0, 0.0]))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Void", bpy.data.pointclouds.new("Void")))
    outline, _ = read(scene)
    assert outline.instances == ()


def test_point_clouds(scene):
    cloud = bpy.data.pointclouds.new("Dust")
    cloud.resize(3)
    cloud.attributes["position"].data.foreach_set("vector", [0, 0, 0, 3, 0, 0, np.inf, 0, 0])
    shown = bpy.data.objects.new("Dust", cloud)
    scene.collection.objects.link(shown)
    outline, arrays = read(scene)
    assert (outline.meshes[0].triangles, outline.unknown) == (640, ())
    spheres = arrays.meshes[0].positions.reshape(2, -1, 3)
    assert np.allclose(spheres.mean(axis=1), [(0, 0, 0), (3, 0, 0)], atol=1e-3)
    assert np.linalg.norm(spheres[0], axis=1) == pytest.approx(0.01, rel=0.02)  # without an attribute
    cloud.attributes.new("f_dc_0", "FLOAT", "POINT")
    line = "object 'Dust': Gaussian splats are not read, they count as spheres"
    outline, _ = read(scene)
    assert outline.warnings == outline.unknown == (line,)


@pytest.mark.parametrize(
    ("make", "triangles"),
    [
        (lambda: curves("Maker", [(0, 0, 0), (0, 0, 1)], [2]), [2 * 16, 4 * 320]),
        # Curves that a mesh's nodes make Cycles does not render, either.
        (lambda: cube("Maker"), [12, 4 * 320]),
    ],
    ids=["of curves", "of a mesh"],
)
def test_curves_and_points_of_geometry_nodes(scene, make, triangles):
    shown = make()
    group = bpy.data.node_groups.new("Made", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeCurvePrimitiveLine", "GeometryNodePoints")
    first, last, line, points = map(group.nodes.new, kinds)
    points.inputs["Count"].default_value = 4
    join = group.nodes.new("GeometryNodeJoinGeometry")
    for node in (first, line, points):
        group.links.new(node.outputs[0], join.inputs[0])
    group.links.new(join.outputs[0], last.inputs[0])
    shown.modifiers.new("Made", "NODES").node_group = group
    outline, _ = read(scene)
    assert names(outline) == ["Maker"] * 2
    assert sorted(mesh.triangles for mesh in outline.meshes) == triangles
