"""Simulations that have no cache: a render evaluates them from wherever it happens to start, so that a whole
sequence, one frame of it and a farm's task give different pictures."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator

import bpy

from .changing import has_nodes


def unbaked_simulations(depsgraph: bpy.types.Depsgraph) -> list[str]:
    """A warning for each simulation of the view layer that the frame depends on and no cache holds."""
    scene, frame = depsgraph.scene, depsgraph.scene_eval.frame_current
    found: dict[str, None] = {}
    for thing in depsgraph.view_layer.objects:
        if not thing.hide_render:
            for modifier in thing.modifiers:
                if modifier.show_render:
                    for what in _of_modifier(thing, modifier, frame):
                        found[f"object '{thing.name}': its {what}"] = None
    world = scene.rigidbody_world
    if world is not None and world.enabled and not _holds(world.point_cache, frame):
        members = () if world.collection is None else world.collection.all_objects
        if any(member.rigid_body and member.rigid_body.type == "ACTIVE" for member in members):
            found[f"scene '{scene.name}': the rigid body simulation"] = None
    return [f"{what} is not baked: frame {frame} may differ from run to run" for what in found]


def _of_modifier(thing: bpy.types.Object, modifier: bpy.types.Modifier, frame: int) -> Iterator[str]:
    """What simulates in it without a cache."""
    if modifier.type in ("CLOTH", "SOFT_BODY"):
        if not _holds(modifier.point_cache, frame):
            yield "cloth" if modifier.type == "CLOTH" else "soft body"
    elif modifier.type == "PARTICLE_SYSTEM":
        system = modifier.particle_system
        is_hair = system.settings.type == "HAIR"
        moves = system.use_hair_dynamics if is_hair else system.settings.physics_type != "NO"
        if moves and not _holds(system.point_cache, frame):
            yield f"particle system '{system.name}'"
    elif modifier.type == "DYNAMIC_PAINT" and modifier.canvas_settings is not None:
        surfaces = modifier.canvas_settings.canvas_surfaces
        if any(s.is_active and not _holds(s.point_cache, frame) for s in surfaces):
            yield "dynamic paint"
    elif modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN":
        domain = modifier.domain_settings
        if frame > domain.cache_frame_start and not domain.has_cache_baked_any:
            yield "fluid"
    elif modifier.type == "NODES" and has_nodes(modifier.node_group, ("SimulationOutput",)):
        # Whether a packed bake is there Python is not told.
        first = bpy.context.scene.frame_start
        if frame > first and not any(_is_on_disk(thing, modifier, bake) for bake in modifier.bakes):
            yield f"simulation in modifier '{modifier.name}'"


def _holds(cache: bpy.types.PointCache, frame: int) -> bool:
    """Whether it needs no simulation to tell the frame: baked, simulated up to there, or at its start."""
    if cache.is_baked or frame <= cache.frame_start:
        return True
    known = re.match(r"\d+", cache.info)
    needed = min(frame, cache.frame_end) - cache.frame_start + 1
    return known is not None and int(known[0]) >= needed and not cache.is_outdated


def _is_on_disk(thing: bpy.types.Object, modifier: bpy.types.Modifier, bake) -> bool:
    if bake.bake_target == "PACKED" or (bake.bake_target == "INHERIT" and modifier.bake_target == "PACKED"):
        return False
    folder = bake.directory if bake.use_custom_path else modifier.bake_directory
    return bool(folder) and os.path.isdir(bpy.path.abspath(folder, library=thing.library))
