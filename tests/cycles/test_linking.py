"""Light linking, against Cycles."""

from __future__ import annotations

import bpy
import numpy as np
import OpenEXR
import pytest
from strata.tests.support.scan_scenes import empty_scene, read


@pytest.fixture
def scene():
    return empty_scene()


def _link_state(collection, linked, state):
    links = (
        collection.collection_objects
        if isinstance(linked, bpy.types.Object)
        else collection.collection_children
    )
    things = collection.objects if isinstance(linked, bpy.types.Object) else collection.children
    things.link(linked)
    links[list(things).index(linked)].light_linking.link_state = state


@pytest.mark.parametrize(
    "states",
    [
        {},
        {"A": "INCLUDE"},
        {"A": "EXCLUDE"},
        {"A": "INCLUDE", "B": "EXCLUDE"},
        {"child of A, B": "INCLUDE"},
        {"child of A, B": "EXCLUDE"},
        {"child of A, B": "INCLUDE", "A": "EXCLUDE"},
        {"child of A, B": "EXCLUDE", "A": "INCLUDE"},
    ],
    ids=str,
)
@pytest.mark.parametrize("use", ["receiver", "blocker"])
def test_linking_is_that_of_cycles(scene, tmp_path, states, use):
    """Three floors, each under a ceiling: with Cycles a linked floor is lit, a linked ceiling darkens."""
    floors, ceilings = [], []
    for index, name in enumerate("ABC"):
        for z, made in ((0.0, floors), (1.0, ceilings)):
            bpy.ops.mesh.primitive_plane_add(size=0.9, location=(index - 1.0, 0.0, z))
            bpy.context.object.name = f"{name}{z:g}"
            made.append(bpy.context.object)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.angle = 3.0, 0.0
    scene.collection.objects.link(sun)
    linked = floors if use == "receiver" else ceilings
    for ceiling in ceilings:
        ceiling.visible_camera = False
        ceiling.hide_render = use == "receiver"
    collection = bpy.data.collections.new("Linked")
    for name, state in states.items():
        if name.startswith("child"):
            child = bpy.data.collections.new("Child")
            for thing in linked[:2]:
                child.objects.link(thing)
            _link_state(collection, child, state)
        else:
            _link_state(collection, linked["ABC".index(name)], state)
    setattr(sun.light_linking, f"{use}_collection", collection)
    outline, _ = read(scene)
    (light,) = outline.lights
    found = light.receivers if use == "receiver" else light.casters
    ours = [outline.instances[i].name[0] for i in sorted(found)]
    if use == "blocker":
        ours = [i.name[0] for k, i in enumerate(outline.instances) if k in found and i.name.endswith("1")]

    camera = scene.camera
    camera.location, camera.data.type, camera.data.ortho_scale = (0.0, 0.0, 9.0), "ORTHO", 3.0
    scene.render.engine, scene.cycles.samples = "CYCLES", 4
    scene.render.resolution_x, scene.render.resolution_y = 9, 3
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.filepath = str(tmp_path / "linked.exr")
    bpy.ops.render.render(write_still=True)
    with OpenEXR.File(scene.render.filepath) as file:
        row = np.array(file.channels()["RGB"].pixels)[1, 1::3, 0]
    lit = row > 0.5  # a lit floor gives 3/pi, and the pixel filter reaches over
    theirs = [name for name, is_lit in zip("ABC", lit, strict=True) if is_lit == (use == "receiver")]
    assert ours == theirs
