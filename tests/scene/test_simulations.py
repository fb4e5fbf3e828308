"""Simulations without a cache are told, since a frame of them depends on what was evaluated before it."""

from __future__ import annotations

import bpy
import pytest
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.addon.scene.scan import scan
from strata.tests.support.scan_scenes import empty_scene


@pytest.fixture
def scene():
    scene = empty_scene()
    bpy.ops.mesh.primitive_grid_add()
    scene.frame_end = 10
    return scene


def told(scene, frame: int) -> list[str]:
    def look(depsgraph):
        return [w for w in scan(depsgraph).outline.warnings if "not baked" in w]

    return with_render_depsgraph(scene, scene.view_layers[0], look, frame)


def cloth(grid):
    grid.modifiers.new("Cloth", "CLOTH").point_cache.frame_end = 10


def soft_body(grid):
    grid.modifiers.new("Softbody", "SOFT_BODY").point_cache.frame_end = 10


def particles(grid):
    grid.modifiers.new("Particles", "PARTICLE_SYSTEM").particle_system.point_cache.frame_end = 10


def rigid_body(grid):
    bpy.ops.rigidbody.object_add()


def fluid(grid):
    grid.modifiers.new("Fluid", "FLUID").fluid_type = "DOMAIN"


def nodes(grid):
    tree = bpy.data.node_groups.new("Tree", "GeometryNodeTree")
    start, end = tree.nodes.new("GeometryNodeSimulationInput"), tree.nodes.new("GeometryNodeSimulationOutput")
    start.pair_with_output(end)
    grid.modifiers.new("Simulation", "NODES").node_group = tree


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (cloth, "object 'Grid': its cloth"),
        (soft_body, "object 'Grid': its soft body"),
        (particles, "object 'Grid': its particle system 'Particles'"),
        (rigid_body, "scene 'Scene': the rigid body simulation"),
        (fluid, "object 'Grid': its fluid"),
        (nodes, "object 'Grid': its simulation in modifier 'Simulation'"),
    ],
)
def test_unbaked_simulations_are_told_after_their_start(scene, make, what):
    assert told(scene, 5) == []
    make(bpy.context.object)
    assert told(scene, 1) == []
    assert told(scene, 5) == [f"{what} is not baked: frame 5 may differ from run to run"]
    bpy.context.object.hide_render = True
    assert told(scene, 5) == [] or make is rigid_body


def test_what_is_baked_or_was_played_is_not_told(scene):
    cloth(bpy.context.object)
    for frame in range(1, 6):
        scene.frame_set(frame)
    assert told(scene, 5) == []
    assert told(scene, 9) != []
    bpy.ops.ptcache.bake_all(bake=True)
    assert told(scene, 9) == []
