"""What a scan finds: the scene as F12 sees it, instances, visibility and bad parts."""

from __future__ import annotations

import math

import bpy
import mathutils
import numpy as np
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.scene.render_depsgraph import engine_of, with_render_depsgraph
from strata.addon.scene.scan import scan
from strata.tests.support.scan_scenes import cube, empty_scene, names, read


@pytest.fixture
def scene():
    return empty_scene()


def world_positions(outline, arrays, index):
    positions = arrays.meshes[outline.instances[index].mesh].positions.astype(np.float64)
    matrix = arrays.matrices[index]
    return positions @ matrix[:3, :3].T + matrix[:3, 3]


def test_render_and_not_viewport_settings_count(scene):
    smooth = cube("Smooth").modifiers.new("s", "SUBSURF")
    smooth.levels, smooth.render_levels = 0, 2
    cube("Array").modifiers.new("a", "ARRAY").show_render = False
    cube("Hidden in viewports").hide_viewport = True
    cube("Hidden in renders").hide_render = True
    cube("Hidden by the eye").hide_set(True)
    outline, _ = read(scene)
    assert names(outline) == ["Array", "Hidden by the eye", "Hidden in viewports", "Smooth"]
    triangles = {i.name: outline.meshes[i.mesh].triangles for i in outline.instances}
    assert triangles == {
        "Array": 12,
        "Hidden by the eye": 12,
        "Hidden in viewports": 12,
        "Smooth": 12 * 16,
    }
    # The same call on the viewport's depsgraph shows what the viewport shows: Preview relies on it.
    in_viewport = scan(bpy.context.evaluated_depsgraph_get()).outline
    assert names(in_viewport) == ["Array", "Hidden in renders", "Smooth"]


def test_looking_changes_nothing(scene):
    cube("Cube")
    second = scene.view_layers.new("Second")
    second.use = False
    scene.render.engine = "CYCLES"
    scene.frame_set(3)
    before = [
        (owner, name, getattr(owner, name))
        for owner in (scene, scene.render, *scene.view_layers)
        for name, kind in owner.bl_rna.properties.items()
        if name != "use_nodes"  # deprecated
        and kind.type in {"BOOLEAN", "INT", "FLOAT", "ENUM", "STRING", "POINTER"}
        and not getattr(kind, "is_array", False)
    ]

    def look(depsgraph):
        assert depsgraph.mode == "RENDER"
        assert depsgraph.view_layer.name == "Second"
        assert depsgraph.scene_eval.frame_current == 8
        assert engine_of(depsgraph.scene) == "CYCLES"
        return "seen"

    assert with_render_depsgraph(scene, second, look, frame=8) == "seen"
    assert [value for _, _, value in before] == [getattr(owner, name) for owner, name, _ in before]
    assert engine_of(scene) == "CYCLES"
    with pytest.raises(ZeroDivisionError):
        with_render_depsgraph(scene, second, lambda depsgraph: 1 / 0)
    assert scene.render.engine == "CYCLES"
    scene.camera = None
    with pytest.raises(StrataError, match="no camera"):
        with_render_depsgraph(scene, second, look)


def test_everything_with_a_surface_is_a_mesh(scene):
    bpy.ops.curve.primitive_bezier_circle_add()
    bpy.context.object.data.bevel_depth = 0.1
    bpy.ops.object.text_add()
    bpy.context.object.data.extrude = 0.1
    bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    bpy.ops.object.metaball_add(type="BALL")
    bpy.ops.object.metaball_add(type="BALL", location=(1.0, 0.0, 0.0))
    bpy.ops.object.empty_add()
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.data.clear_geometry()
    outline, arrays = read(scene)
    assert names(outline) == ["BézierCircle", "Mball", "SurfSphere", "Text"]
    assert not outline.warnings
    for index, instance in enumerate(outline.instances):
        positions = world_positions(outline, arrays, index)
        # Bounds are float32's, and may exceed a rotated mesh.
        slack = 1e-5 * instance.bounds.radius
        assert (positions.min(axis=0) >= np.array(instance.bounds.low) - slack).all()
        assert (positions.max(axis=0) <= np.array(instance.bounds.high) + slack).all()
        assert arrays.meshes[instance.mesh].face_starts[-1] > 0


def test_what_is_not_read_is_named(scene):
    bpy.ops.object.volume_add()
    bpy.ops.object.grease_pencil_add(type="STROKE")
    outline, _ = read(scene)
    assert names(outline) == []
    assert sorted(outline.warnings) == [
        "object 'Stroke': grease pencil is not read, Blender draws it over the picture",
        "object 'Volume': volumes are not read, what it takes of light and adds is missing",
    ]
    assert (
        "object 'Volume': volumes are not read, what it takes of light and adds is missing" in outline.unknown
    )
    assert not any("Stroke" in line for line in outline.unknown)


def test_what_blurs_the_picture_and_no_layer_is_named(scene):
    scene.render.use_motion_blur = False
    assert read(scene)[0].warnings == ()
    scene.camera.data.dof.use_dof = True
    scene.render.use_motion_blur = True
    assert read(scene)[0].warnings == (
        f"camera '{scene.camera.name}' has depth of field: layers are sharp and do not fit what it blurs",
        "motion blur is on: layers show one instant and do not fit what moves",
    )


def test_instances_share_one_mesh(scene):
    # Linked duplicates.
    first = cube("First")
    twin = bpy.data.objects.new("Twin", first.data)
    twin.location = (0.0, 5.0, 0.0)
    scene.collection.objects.link(twin)
    # A collection instanced twice, with a light in it.
    library = bpy.data.collections.new("Library")
    bpy.ops.mesh.primitive_cone_add()
    cone = bpy.context.object
    scene.collection.objects.unlink(cone)
    library.objects.link(cone)
    library.objects.link(bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT")))
    for index in range(2):
        empty = bpy.data.objects.new(f"Empty{index}", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", library
        empty.location = (10.0 * index, 0.0, 0.0)
        scene.collection.objects.link(empty)
    # Particles.
    bpy.ops.mesh.primitive_plane_add()
    emitter = bpy.context.object
    emitter.show_instancer_for_render = False
    settings = emitter.modifiers.new("p", "PARTICLE_SYSTEM").particle_system.settings
    settings.type, settings.count, settings.render_type = "HAIR", 7, "OBJECT"
    settings.instance_object = first
    # Geometry nodes.
    bpy.ops.mesh.primitive_plane_add()
    group = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    nodes = [group.nodes.new(kind) for kind in ("GeometryNodeMeshLine", "GeometryNodeMeshIcoSphere")]
    on_points, output = group.nodes.new("GeometryNodeInstanceOnPoints"), group.nodes.new("NodeGroupOutput")
    group.links.new(nodes[0].outputs[0], on_points.inputs["Points"])
    group.links.new(nodes[1].outputs[0], on_points.inputs["Instance"])
    group.links.new(on_points.outputs[0], output.inputs[0])
    bpy.context.object.modifiers.new("g", "NODES").node_group = group
    bpy.context.object.name = "Scattered"
    outline, arrays = read(scene)
    assert names(outline) == ["Cone"] * 2 + ["First"] * 8 + ["Scattered"] * 10 + ["Twin"]
    meshes = {}
    for instance in outline.instances:
        meshes.setdefault(instance.name, set()).add(instance.mesh)
    assert {name: len(found) for name, found in meshes.items()} == dict.fromkeys(meshes, 1)
    assert meshes["First"] == meshes["Twin"]
    assert len(outline.meshes) == len(arrays.meshes) == 3
    assert len({mesh.key for mesh in outline.meshes}) == 3
    assert [light.name for light in outline.lights] == ["Lamp Empty0", "Lamp Empty1"]
    assert len({light.key for light in outline.lights}) == 2
    assert [light.emitter.centre[0] for light in outline.lights] == [0.0, 10.0]
    again, _ = read(scene)
    assert [mesh.key for mesh in again.meshes] == [mesh.key for mesh in outline.meshes]
    assert again == outline


def test_visibility(scene):
    excluded, held, indirect = (bpy.data.collections.new(n) for n in ("Excluded", "Held", "Indirect"))
    for collection in (excluded, held, indirect):
        scene.collection.children.link(collection)
    layer = scene.view_layers[0].layer_collection.children
    cube("Plain")
    cube("In excluded", excluded)
    cube("In held", held)
    cube("In indirect", indirect)
    layer["Excluded"].exclude = True
    layer["Held"].holdout = True
    layer["Indirect"].indirect_only = True
    cube("Holdout").is_holdout = True
    cube("Catcher").is_shadow_catcher = True  # a surface like any other
    cube("No camera").visible_camera = False
    cube("No shadow").visible_shadow = False
    unseen = cube("Unseen holdout")
    unseen.is_holdout, unseen.visible_camera, unseen.is_shadow_catcher = True, False, True
    outline, _ = read(scene)
    assert outline.warnings == (
        "shadow catcher 'Catcher': layers take it for a surface like any other, and Cycles' passes of light, "
        "which layers are multiplied onto, have none of it",
    )
    assert outline.unknown == ()
    flags = {i.name: (i.visible_camera, i.casts_shadow, i.is_holdout) for i in outline.instances}
    assert flags == {
        "Plain": (True, True, False),
        "In held": (True, True, True),
        "In indirect": (False, True, False),
        "Holdout": (True, True, True),
        "Catcher": (True, True, False),
        "No camera": (False, True, False),
        "No shadow": (True, False, False),
        "Unseen holdout": (False, True, True),
    }


def test_what_no_ray_meets_is_not_there(scene):
    """By its materials: to cameras, to shadow rays, or to both; one slot that is met is enough."""
    for name in ("Clear", "Shadowless", "Unseen", "Half"):
        shown, material = cube(name), bpy.data.materials.new(name)
        shown.data.materials.append(material)
        tree = material.node_tree
        clear = tree.nodes.new("ShaderNodeBsdfTransparent")
        output, path = tree.nodes["Material Output"], tree.nodes.new("ShaderNodeLightPath")
        mix = tree.nodes.new("ShaderNodeMixShader")
        tree.links.new(tree.nodes["Principled BSDF"].outputs[0], mix.inputs[1])
        tree.links.new(clear.outputs[0], mix.inputs[2])
        tree.links.new(mix.outputs[0], output.inputs["Surface"])
        if name in ("Shadowless", "Unseen"):
            ray = "Is Shadow Ray" if name == "Shadowless" else "Is Camera Ray"
            tree.links.new(path.outputs[ray], mix.inputs[0])
        else:
            mix.inputs[0].default_value = 1.0 if name == "Clear" else 0.5
    outline, _ = read(scene)
    flags = {i.name: (i.visible_camera, i.casts_shadow) for i in outline.instances}
    assert flags == {
        "Clear": (False, False), "Shadowless": (True, False), "Unseen": (False, True), "Half": (True, True)
    }  # fmt: skip
    scene.objects["Clear"].data.materials.append(bpy.data.materials["Half"])
    outline, _ = read(scene)
    (met,) = [(i.visible_camera, i.casts_shadow) for i in outline.instances if i.name == "Clear"]
    assert met == (True, True)


def test_a_view_layer_overrides_materials_and_the_world(scene):
    shown = cube("Cube")
    for name in ("First", "Second"):
        shown.data.materials.append(bpy.data.materials.new(name))
    shown.data.polygons[3].material_index = 1
    clay = bpy.data.materials.new("Clay")
    clay.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.1, 0.2, 0.3, 1.0)
    scene.world, night = bpy.data.worlds.new("Day"), bpy.data.worlds.new("Night")
    second = scene.view_layers.new("Second")
    second.material_override, second.world_override = clay, night
    plain, _ = read(scene)
    assert [material.name for material in plain.materials] == ["First", "Second"]
    assert plain.world_light == "Day"
    overridden, _ = read(scene, layer=1)
    assert [material.name for material in overridden.materials] == ["Clay"]
    assert overridden.materials[0].base_color == pytest.approx((0.1, 0.2, 0.3))
    assert overridden.instances[0].materials == (0,)
    assert overridden.world_light == "Night"


def test_an_instancer_hides_its_instances(scene):
    library = bpy.data.collections.new("Library")
    cube("Cube", library)
    empty = bpy.data.objects.new("Empty", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", library
    empty.visible_shadow = False
    empty.visible_camera = False
    scene.collection.objects.link(empty)
    (instance,) = read(scene)[0].instances
    assert (instance.visible_camera, instance.casts_shadow) == (False, False)


def test_area_lights_are_read_where_cycles_is_switched_off(scene):
    """Its add-on brings the lights' own settings, portals among them."""
    import addon_utils  # found once bpy is there

    scene.collection.objects.link(bpy.data.objects.new("Area", bpy.data.lights.new("Area", "AREA")))
    addon_utils.disable("cycles")
    try:
        outline, _ = read(scene)
    finally:
        addon_utils.enable("cycles")
    assert "Area" in [light.name for light in outline.lights]


def test_lights_that_do_nothing(scene):
    def lamp(name, kind="POINT", **values):
        made = bpy.data.objects.new(name, bpy.data.lights.new(name, kind))
        for field, value in values.items():
            setattr(made.data, field, value)
        scene.collection.objects.link(made)
        return made

    lamp("Off", energy=0.0)
    lamp("Black", color=(0.0, 0.0, 0.0))
    lamp("No shadow", use_shadow=False)
    lamp("No area", "AREA", size=0.0)
    lamp("Portal", "AREA").data.cycles.is_portal = True
    lamp("Unlinked").data.node_tree.nodes.clear()
    lamp("Not diffuse").visible_diffuse = False
    lamp("Hidden").hide_render = True
    falloff = lamp("Falloff").data.node_tree
    node = falloff.nodes.new("ShaderNodeLightFalloff")
    falloff.links.new(node.outputs["Linear"], falloff.nodes["Emission"].inputs["Strength"])
    skewed = lamp("Skewed", "AREA")
    skewed.parent = scene.camera
    skewed.matrix_parent_inverse = mathutils.Matrix(
        ((1, 0.5, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    )
    lamp("Elliptic", "SPOT").scale = (1.0, 2.0, 1.0)
    lamp("Nowhere").location = (math.nan, 0.0, 0.0)
    lamp("Flat", "SUN").scale = (0.0, 0.0, 0.0)
    outline, _ = read(scene)
    lights = {light.name: light for light in outline.lights}
    dark = {name for name, light in lights.items() if light.is_dark}
    assert dark == {"Off", "Black", "No area", "Unlinked"}
    assert {name for name, light in lights.items() if not light.casts_shadow} == {"No shadow"}
    assert lights["Not diffuse"].receivers == frozenset()
    assert not {"Portal", "Hidden", "Nowhere"} & set(lights)
    warned = sorted(warning.split("'")[1] for warning in outline.warnings)
    assert warned == ["Elliptic", "Falloff", "Nowhere", "Portal", "Skewed"]
    for light in lights.values():
        axes = np.array([light.emitter.right, light.emitter.up, light.emitter.forward])
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-6)
        assert np.isfinite(light.emitter.packed()[:15]).all()


def test_bad_parts_are_left_out(scene):
    def add(name, vertices, faces=((0, 1, 2),)):
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(vertices, [], faces)
        made = bpy.data.objects.new(name, mesh)
        scene.collection.objects.link(made)
        return made

    good = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    add("Good", good)
    add("Flat", good).scale = (1.0, 1.0, 0.0)
    add("Nowhere", good).location = (0.0, math.nan, 0.0)
    add("Endless", good).location = (math.inf, 0.0, 0.0)
    add("Partly", [*good, (math.nan, 0.0, 0.0), (math.inf, 1.0, 0.0)], [(0, 1, 2), (0, 1, 3), (1, 2, 4)])
    add("All bad", [(math.nan, 0.0, 0.0)] * 3)
    add("Pointless", [(0.0, 0.0, 0.0)] * 3)
    add("Edge", good[:2], ())
    add("Thin", good).scale = (1.0, 1e-3, 1e-3)
    outline, arrays = read(scene)
    assert names(outline) == ["All bad", "Good", "Partly", "Pointless", "Thin"]
    assert sorted(warning.split(":")[0] for warning in outline.warnings) == [
        "object 'Endless' is left out",
        "object 'Flat' is left out",
        "object 'Nowhere' is left out",
    ]
    assert sorted(arrays.warnings) == [
        "object 'All bad' is left out: none of its vertices is finite",
        "object 'Partly': faces are left out, 2 of 5 vertices are not finite",
    ]
    for instance in outline.instances:
        assert np.isfinite([instance.bounds.low, instance.bounds.high]).all()
    assert np.isfinite(arrays.matrices).all()


def test_far_away(scene):
    """Matrices are as exact as Blender's own float32, and bounds follow them in float64."""
    far = cube("Far", location=(1e7, -1e7, 0.0))
    far.scale = (0.25, 0.25, 0.25)
    (instance,) = read(scene)[0].instances
    assert instance.matrix[0] == (0.25, 0.0, 0.0, 1e7)
    assert instance.bounds.low == (1e7 - 0.25, -1e7 - 0.25, -0.25)
    assert instance.bounds.high == (1e7 + 0.25, -1e7 + 0.25, 0.25)


def test_an_empty_scene(scene):
    outline, arrays = read(scene)
    assert (outline.instances, outline.lights) == ((), ())
    assert arrays.matrices.shape == (0, 4, 4)


def test_terminator_offsets_are_those_of_smooth_faces(scene):
    """Of an object's own, also where an empty instances it; flat faces have none in Cycles."""
    for name, smooth, offset in (("Flat", False, 0.3), ("Smooth", True, 0.3), ("None", True, 0.0)):
        made = cube(name)
        made.shadow_terminator_geometry_offset = offset
        made.data.polygons[0].use_smooth = smooth
    parts = bpy.data.collections.new("Parts")
    cube("Part", parts)
    bpy.data.objects["Part"].data.shade_smooth()
    empty = bpy.data.objects.new("Empty", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", parts
    empty.shadow_terminator_geometry_offset = 0.7
    scene.collection.objects.link(empty)
    outline, _ = read(scene)
    found = {each.name: each.terminator_offset for each in outline.instances}
    assert found == {
        "Flat": 0.0,
        "Smooth": pytest.approx(0.3),
        "None": 0.0,
        "Part": pytest.approx(0.1),  # Blender's default
    }


def test_shading_offsets_are_told(scene):
    cube("Plain")
    cube("Shifted").shadow_terminator_shading_offset = 0.2
    outline, _ = read(scene)
    (line,) = (line for line in outline.warnings if "shading offset" in line)
    assert line.startswith("object 'Shifted': ")
