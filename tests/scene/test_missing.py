"""What a file has and Blender could not load or run is told, with its objects and what is assumed."""

from __future__ import annotations

import os

import bpy
import pytest
from strata.addon.scene.missing import named
from strata.addon.scene.open import open_blend
from strata.tests.support.scan_scenes import cube, empty_scene, read

LIBRARY = "library '//library.blend'"


@pytest.fixture
def scene():
    return empty_scene()


def saved(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def told(path, **how):
    """Warnings of the file's scene, and which of them are of unknown extent."""
    said = open_blend(path, **how)
    outline, _ = read(bpy.context.scene)
    return (*said, *outline.warnings), outline.unknown


def library(path):
    """A file with a crate in a collection, a mesh, a material and node groups of both kinds."""
    empty_scene()
    props = bpy.data.collections.new("Props")
    props.objects.link(cube("Crate"))
    made = [
        props,
        bpy.data.meshes.new("Rock"),
        bpy.data.materials.new("Moss"),
        bpy.data.node_groups.new("Scatter", "GeometryNodeTree"),
        bpy.data.node_groups.new("Wet", "ShaderNodeTree"),
    ]
    for each in made:
        each.use_fake_user = True
    return saved(path)


def linked(path, **names):
    with bpy.data.libraries.load(str(path), link=True) as (_there, wanted):
        for kind, name in names.items():
            setattr(wanted, kind, [name])
    return [getattr(bpy.data, kind)[name] for kind, name in names.items()]


def test_a_missing_library_is_told_with_its_objects(tmp_path):
    path = library(tmp_path / "library.blend")
    scene = empty_scene()
    props, rock, moss = linked(path, collections="Props", meshes="Rock", materials="Moss")
    instance = bpy.data.objects.new("Corner", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", props
    for made in (instance, bpy.data.objects.new("Boulder", rock)):
        scene.collection.objects.link(made)
    cube("Wall").data.materials.append(moss)
    user = saved(tmp_path / "user.blend")
    assert told(user)[1] == ()
    os.remove(path)
    lines, unknown = told(user)
    shapes = (
        f"{LIBRARY} is missing, with collection 'Props', mesh 'Rock' of objects 'Boulder', 'Corner': "
        "their shapes and shadows are missing"
    )
    assert unknown == (shapes,)
    assert (
        f"{LIBRARY} is missing, with material 'Moss' of object 'Wall': Blender's defaults stand in" in lines
    )


def test_a_library_that_lacks_a_node_group(tmp_path):
    """A node group that is missing has lost its type; who uses it tells what is lost."""
    path = library(tmp_path / "library.blend")
    empty_scene()
    scatter, wet = linked(path, node_groups="Scatter") + linked(path, node_groups="Wet")
    wall = cube("Wall")
    wall.modifiers.new("Nodes", "NODES").node_group = scatter
    material = bpy.data.materials.new("Paint")
    material.node_tree.nodes.new("ShaderNodeGroup").node_tree = wet
    cube("Floor").data.materials.append(material)
    user = saved(tmp_path / "user.blend")
    empty_scene()
    saved(path)
    lines, unknown = told(user)
    assert unknown == (
        f"{LIBRARY} lacks node group 'Scatter' of object 'Wall': their shapes and shadows are missing",
    )
    assert f"{LIBRARY} lacks node group 'Wet' of object 'Floor': Blender's defaults stand in" in lines


def test_what_is_missing_elsewhere_is_not_told(tmp_path):
    """A view layer that shows none of it has all that it needs."""
    path = library(tmp_path / "library.blend")
    empty_scene()
    linked(path, collections="Props")[0].use_fake_user = True
    user = saved(tmp_path / "user.blend")
    os.remove(path)
    assert told(user) == ((), ())


def test_nodes_and_engines_that_nobody_knows(scene, tmp_path):
    class Elsewhere(bpy.types.RenderEngine):
        bl_idname, bl_label = "ELSEWHERE", "Elsewhere"

    class Odd(bpy.types.Node):
        bl_idname, bl_label = "OddNode", "Odd"

    material = bpy.data.materials.new("Paint")
    cube("Wall").data.materials.append(material)
    bpy.utils.register_class(Elsewhere)
    bpy.utils.register_class(Odd)
    try:
        scene.render.engine = "ELSEWHERE"
        material.node_tree.nodes.new("OddNode")
        path = saved(tmp_path / "odd.blend")
    finally:
        bpy.utils.unregister_class(Odd)
        bpy.utils.unregister_class(Elsewhere)
    lines, unknown = told(path)
    assert lines == (
        "scene 'Scene': render engine 'ELSEWHERE' is not there, it is read as for BLENDER_EEVEE",
        "material 'Paint' of object 'Wall' has node 'Odd' of a type that this Blender does not know, "
        "which gives nothing",
    )
    assert unknown == ()


def test_scripts_and_drivers_that_did_not_run(scene, tmp_path):
    def drive(owner, path, expression, *index):
        curve = owner.driver_add(path, *index)
        curve.driver.type, curve.driver.expression = "SCRIPTED", expression

    wall = cube("Wall")
    drive(wall, "location", "len(str(5)) * 3.0", 2)
    drive(wall, "location", "frame * 2.0", 0)  # read without Python
    text = bpy.data.texts.new("rig.py")
    text.use_module = True
    text.write("import bpy\nbpy.context.scene['ran'] = 1\n")
    path = saved(tmp_path / "driven.blend")
    lines, unknown = told(path)
    off = "as scripts of the file are off (--trust-scripts runs them)"
    driver = f"object 'Wall': driver of 'location' did not run, {off}: it is taken as the file was saved"
    assert lines == (f"text 'rig.py' did not run, {off}", driver)
    assert unknown == (driver,)
    assert "ran" not in bpy.context.scene
    assert told(path, trusts_scripts=True) == ((), ())
    assert bpy.context.scene["ran"] == 1
    outline, _ = read(bpy.context.scene)
    assert (outline.instances[0].matrix[0][3], outline.instances[0].matrix[2][3]) == (2.0, 3.0)


@pytest.mark.parametrize(
    ("linked", "method", "values", "is_told"),
    [
        ("Displacement", "DISPLACEMENT", {}, True),
        ("Displacement", "BOTH", {}, True),
        ("Displacement", "BUMP", {}, False),
        (None, "DISPLACEMENT", {}, False),
        ("Displacement", "DISPLACEMENT", {"Scale": 0.0}, False),
        ("Displacement", "DISPLACEMENT", {"Height": 0.3, "Midlevel": 0.3}, False),
        ("Displacement", "DISPLACEMENT", {"Height": 0.3}, False),  # applied
    ],
)
def test_displacement_is_told(scene, linked, method, values, is_told):
    material = bpy.data.materials.new("Terrain")
    tree = material.node_tree
    material.displacement_method = method
    move = tree.nodes.new("ShaderNodeDisplacement")
    if "Height" not in values:
        noise = tree.nodes.new("ShaderNodeTexNoise")
        tree.links.new(noise.outputs[0], move.inputs["Height"])
    for name, value in values.items():
        move.inputs[name].default_value = value
    if linked:
        tree.links.new(move.outputs[0], tree.nodes["Material Output"].inputs[linked])
    cube("Hill").data.materials.append(material)
    line = (
        "material 'Terrain' of object 'Hill': displacement by node 'Noise Texture' is not read, "
        "shapes and shadows are taken without it"
    )
    outline, _ = read(scene)
    assert outline.warnings == outline.unknown == ((line,) if is_told else ())


def test_culling_of_cycles_is_told(scene):
    cube("Near")
    cube("Far").cycles.use_distance_cull = True
    scene.cycles.use_distance_cull = True
    assert read(scene)[0].warnings == ()
    scene.render.use_simplify = True
    line = "object 'Far': Cycles' culling is not read, shadows are there wherever they are"
    assert read(scene)[0].warnings == (line,)
    scene.cycles.use_distance_cull = False
    scene.cycles.use_camera_cull = True
    assert read(scene)[0].warnings == ()


def test_few_of_many_names_are_told():
    assert named([], "object") == ""
    assert named(["B", "A", "B"], "object") == "objects 'A', 'B'"
    assert named("EDCBA", "driver of", "drivers of") == "drivers of 'A', 'B', 'C' and 2 more"


def test_what_colours_light_is_told_with_its_objects(scene):
    material = bpy.data.materials.new("Pane")
    tree = material.node_tree
    clear = tree.nodes.new("ShaderNodeBsdfTransparent")
    clear.inputs["Color"].default_value = (1.0, 0.2, 0.1, 1.0)
    tree.links.new(clear.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    for name in ("Left", "Right"):
        cube(name).data.materials.append(material)
    outline, _ = read(scene)
    assert outline.warnings == (
        "material 'Pane' of objects 'Left', 'Right': node 'Transparent BSDF' colours what comes through, "
        "shadows have its luminance in all channels",
    )
    clear.inputs["Color"].default_value = (0.2, 0.2, 0.2, 1.0)
    assert not read(scene)[0].warnings
