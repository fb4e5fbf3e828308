"""What a scan finds of an object that is being edited, sculpted or painted."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from strata.addon.scene.extract import extract
from strata.addon.scene.scan import scan
from strata.tests.support.scan_scenes import cube, empty_scene, names, read


@pytest.fixture
def scene():
    return empty_scene()


def shape(outline, arrays):
    """Of the only mesh: triangles, vertices, and the box around them."""
    (instance,) = outline.instances
    mesh = arrays.meshes[instance.mesh]
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    return outline.meshes[instance.mesh].triangles, len(mesh.positions), low.tolist(), high.tolist()


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT", "TEXTURE_PAINT"])
@pytest.mark.parametrize("modifier", [None, "SUBSURF", "ARRAY"])
@pytest.mark.parametrize("in_viewport", [False, True])
def test_every_mode_shows_what_object_mode_would(scene, mode, modifier, in_viewport):
    def found():
        if not in_viewport:
            return read(scene)
        scanned = scan(bpy.context.evaluated_depsgraph_get())
        return scanned.outline, extract(scanned)

    thing = cube("Cube")
    if modifier:
        thing.modifiers.new("m", modifier)
    thing.data.materials.append(bpy.data.materials.new("M"))
    before = found()
    bpy.ops.object.mode_set(mode=mode)
    during = found()
    assert shape(*during) == shape(*before)
    assert during[0].instances[0].materials == before[0].instances[0].materials
    assert during[1].meshes[0].corner_normals is None or np.isfinite(during[1].meshes[0].corner_normals).all()
    bpy.ops.object.mode_set(mode="OBJECT")


def test_what_is_being_edited_is_read_as_it_is_now(scene):
    cube("Cube").data.materials.append(bpy.data.materials.new("M"))
    linked = bpy.data.objects.new("Linked", bpy.context.object.data)
    scene.collection.objects.link(linked)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.resize(value=(3.0, 3.0, 3.0))
    outline, arrays = read(scene)
    assert names(outline) == ["Cube", "Linked"]
    for instance in outline.instances:
        assert arrays.meshes[instance.mesh].positions.max() == 3.0
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("modifier", ["SUBSURF", "MULTIRES"])
def test_modifiers_that_edit_mode_leaves_out_are_told(scene, modifier):
    thing = cube("Cube")
    made = thing.modifiers.new("Smooth", modifier)
    if modifier == "SUBSURF":
        made.show_in_editmode = False
    else:
        bpy.ops.object.multires_subdivide(modifier="Smooth")
    bpy.ops.object.mode_set(mode="EDIT")
    outline, _ = read(scene)
    assert "object 'Cube' is in Edit Mode: shown without its modifiers 'Smooth'" in outline.warnings
    bpy.ops.object.mode_set(mode="OBJECT")
    outline, _ = read(scene)
    assert not outline.warnings


def test_levels_that_only_sculpting_has_are_told_in_a_viewport(scene):
    thing = cube("Cube")
    thing.modifiers.new("Levels", "MULTIRES")
    bpy.ops.object.multires_subdivide(modifier="Levels")
    bpy.ops.object.mode_set(mode="SCULPT")
    shown = scan(bpy.context.evaluated_depsgraph_get()).outline
    baked, _ = read(scene)
    triangles = [sum(mesh.triangles for mesh in outline.meshes) for outline in (shown, baked)]
    bpy.ops.object.mode_set(mode="OBJECT")
    assert triangles == [12, 48]
    assert shown.warnings == (
        "object 'Cube' is in Sculpt Mode: the preview shows it without 'Levels', a bake shows it",
    )
    assert not baked.warnings
