"""Scenes made in Blender for tests of the scan."""

from __future__ import annotations

import bpy
from strata.addon.scene.extract import extract
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.addon.scene.scan import scan


def empty_scene():
    """Empty but for a camera."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    return scene


def read(scene, layer=0):
    """Outline and arrays."""

    def look(depsgraph):
        scanned = scan(depsgraph)
        return scanned.outline, extract(scanned)

    return with_render_depsgraph(scene, scene.view_layers[layer], look)


def cube(name, collection=None, location=(0.0, 0.0, 0.0)):
    bpy.ops.mesh.primitive_cube_add(location=location)
    made = bpy.context.object
    made.name = name
    if collection is not None:
        for other in list(made.users_collection):
            other.objects.unlink(made)
        collection.objects.link(made)
    return made


def names(outline):
    return sorted(instance.name for instance in outline.instances)
