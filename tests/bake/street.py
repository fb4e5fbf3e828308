"""A street of lamps."""

from __future__ import annotations

import bpy


def street(lamps: int = 3) -> bpy.types.Scene:
    """Boxes on a plain under point lamps in a row."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=40.0)
    for number in range(lamps):
        x = 3.0 * (number - 0.5 * (lamps - 1))
        bpy.ops.mesh.primitive_cube_add(size=1.5, location=(x, 1.0, 0.75))
        data = bpy.data.lights.new("Lamp", "POINT")
        data.energy, data.shadow_soft_size = 100.0, 0.2
        lamp = bpy.data.objects.new("Lamp", data)
        lamp.location = (x + 0.5, -1.0, 3.0)
        scene.collection.objects.link(lamp)
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.location, scene.camera.rotation_euler = (0.0, -9.0, 6.0), (0.96, 0.0, 0.0)
    scene.collection.objects.link(scene.camera)
    return scene
