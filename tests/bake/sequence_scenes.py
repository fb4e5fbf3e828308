"""Scenes of a few frames, and the layers that a sequence of them gets."""

from __future__ import annotations

import bpy
from strata.addon.sequence import sequence_layers
from strata.addon.ui.properties import options_of
from strata.tests.support.scan_scenes import empty_scene


def lamp(name: str, kind="POINT", place=(2.0, 0.0, 4.0), energy=100.0):
    made = bpy.data.objects.new(name, bpy.data.lights.new(name, kind))
    made.location, made.data.energy = place, energy
    bpy.context.scene.collection.objects.link(made)
    return made


def box(name: str, side: float, place):
    mesh, h = bpy.data.meshes.new(name), side / 2
    corners = [(x, y, z) for x in (-h, h) for y in (-h, h) for z in (-h, h)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh.from_pydata(corners, [], faces)
    made = bpy.data.objects.new(name, mesh)
    made.location = place
    bpy.context.scene.collection.objects.link(made)
    return made


def keyed(owner, path: str, **values) -> None:
    """Keyframes, by frame (`f3=0.0`), without anything between."""
    for frame, value in values.items():
        setattr(owner, path, value)
        owner.keyframe_insert(path, frame=int(frame[1:]))
    for layer in owner.animation_data.action.layers:
        for bag in layer.strips[0].channelbags:
            for curve in bag.fcurves:
                for point in curve.keyframe_points:
                    point.interpolation = "CONSTANT"


def names_of(scene, frames=(1,), **options) -> list[str] | None:
    """By each of several first frames: the same."""
    asked = [
        sequence_layers(scene, scene.view_layers[0], lambda s: options_of(s, **options), (frame,))
        for frame in frames
    ]
    found = [None if layers is None else [layer.name for layer in layers] for layers in asked]
    assert all(each == found[0] for each in found)
    return found[0]


def still_scene():
    """A crate on a floor from above, and a sun that never changes; four frames."""
    scene = empty_scene()
    scene.camera.location = (0, 0, 12)
    box("Floor", 8, (0, 0, -4))
    box("Crate", 1, (0, 0, 0.5))
    lamp("Key", "SUN", energy=3.0).rotation_euler = (0.7, 0, 0)
    scene.frame_start, scene.frame_end = 1, 4
    return scene
