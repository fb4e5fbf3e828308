"""What stands close to spots and points, through plans, maps, tables and rays, against rays alone."""

from __future__ import annotations

from collections import Counter

import bpy
import numpy as np
import pytest
from strata.addon.core.graph import Graph
from strata.addon.effects.soft_shadow.close_casters import reach_m
from strata.scripts.bench import against_cycles, close_casters
from strata.tests.support.settings import maps

SIZE = (60, 45)

BOUND = 0.0125
"""Weighted RMSE: the rays' own noise is .003, the 256 samples give .004 for an edge, of which a plate with
holes has many in a penumbra, and what lies within a texel of an edge as much again. Found are .003 to .010,
and .012 below a plate with holes. It was .14 to .2 in shades while boxes told how close they are."""


def errors(lamp: str, fixture: str, radius_m: float, methods=("bitmask", "hybrid")):
    found = close_casters.measure([lamp], [fixture], [radius_m], methods, SIZE)
    return {each.method: each for each in found}


@pytest.mark.parametrize(
    ("lamp", "fixture", "radius_m"),
    [
        ("spot of 45 degrees", "gobo", 0.1),
        ("spot of 45 degrees", "window", 0.25),
        ("spot of 45 degrees", "cylinder", 0.5),
        ("spot of 100 degrees", "barn doors", 0.5),
        ("spot of 100 degrees", "cylinder", 0.25),
        ("spot of 100 degrees", "cone", 0.5),
        ("point", "gobo", 0.25),
        ("point", "barn doors", 0.05),
        ("point", "cylinder", 0.25),
        ("point", "cone", 0.25),
    ],
)
def test_what_is_close_to_a_lamp_hides_what_it_should(lamp, fixture, radius_m):
    for method, found in errors(lamp, fixture, radius_m).items():
        assert found.rmse < BOUND, method
        assert abs(found.bias) < 0.4 * BOUND, method


def test_what_only_the_rim_of_a_spot_lights_is_shadowed_too():
    """Outside the cone; .014 while maps ended where the cone does. The plate darkens all of it."""
    for method, found in errors("spot of 45 degrees", "plate", 0.5).items():
        assert found.rmse < 0.001, method


def test_a_shade_around_a_bulb_is_what_cycles_renders():
    """Cycles has its own lamps, rays and samples."""
    (what, *_) = close_casters.IN_CYCLES
    settings = {"bitmask": maps()}
    ((_, found),) = against_cycles.compare_all(close_casters.scene_of(*what), 128, SIZE, settings)
    assert 0.0 < found.cycles_noise < 0.01
    assert found.rmse < BOUND
    assert abs(found.bias) < 0.4 * BOUND


@pytest.mark.parametrize("fixture", ["cylinder", "barn doors"])
def test_a_lamp_of_no_size_has_hard_shadows_of_what_is_close(fixture):
    """Points on an edge may fall to either side, and are few."""
    for method, found in errors("spot of 100 degrees", fixture, 0.0).items():
        assert found.rmse < BOUND, method


def test_the_fixtures_cast_shadows():
    """A scene whose lamp is left alone would pass everything."""
    case = close_casters.read(close_casters.scene_of("point", "gobo", 0.1), SIZE)
    surface, _ = close_casters.surface_of(case)
    truth, weight = close_casters.traced(case, close_casters.accelerator_of(case), surface, 64, seed=1)
    share = (truth * weight).sum() / weight.sum()
    assert 0.05 < share < 0.95


def lamp_in(mesh: close_casters.Mesh, radius_m: float) -> close_casters.Case:
    """A point 3 m above a ground, and the mesh about it."""
    scene = close_casters.scene_of("point", "cylinder", radius_m)
    points, faces = mesh
    fixture = bpy.data.meshes.new("Other")
    fixture.from_pydata((points + np.array([0.0, 0.0, close_casters.HEIGHT_M])).tolist(), [], faces)
    bpy.data.objects["Fixture"].data = fixture
    bpy.context.view_layer.update()
    return close_casters.read(scene, SIZE)


def steps_of(case: close_casters.Case, **values) -> tuple[Counter, Graph]:
    graph = case.planned_closely(case.device.geometry(), values)
    return Counter(node.step.name for node in graph.nodes()), graph


def test_a_room_around_a_lamp_is_not_close_to_it():
    """As one mesh its box is, and a lamp in it would pay for tables, wide windows and rays."""
    radius_m = 0.1
    (light,) = lamp_in(close_casters.cylinder(radius_m), radius_m).outline.lights
    shade = [(1.01 * reach_m(light.emitter), z) for z in (0.5, -0.5)]
    for method in ("bitmask", "hybrid"):
        # A shade that is just out of reach, though its box is around the lamp.
        far, _ = steps_of(lamp_in(close_casters.tube(shade, 480), radius_m), method=method)
        near, _ = steps_of(lamp_in(close_casters.cylinder(radius_m), radius_m), method=method)
        assert "soft_shadow/close_casters" not in far
        assert near["soft_shadow/close_casters"] > 0
        assert near["soft_shadow/rays"] == 1
        assert far["soft_shadow/rays"] == (method == "hybrid")


def test_nothing_is_traced_where_no_rays_are_wanted():
    case = lamp_in(close_casters.cylinder(0.1), 0.1)
    for values in ({"rays": 0}, {"rays": 0, "method": "hybrid"}, {"method": "area"}):
        steps, _ = steps_of(case, **values)
        assert not {"soft_shadow/close_casters", "soft_shadow/rays", "ray_accelerator"} & steps.keys()


def test_before_the_arrays_are_read_a_box_around_a_lamp_tells_nothing():
    """Plans are made from the outline alone at first, and ask for no more of what they may need."""
    case = lamp_in(close_casters.cylinder(0.1), 0.1)
    assert case.outline.distance_m is None
    assert not any(node.step.name == "soft_shadow/close_casters" for node in case.graph.nodes())
    _, graph = steps_of(case)
    assert graph.instances <= case.graph.instances


def test_as_close_as_the_mesh_is_as_wide_are_the_windows():
    """A cylinder of 1.5 radii reaches far beside the windows that one of a meter fits into."""
    widest = {}
    for around in (0.15, 1.0):
        case = lamp_in(close_casters.tube([(around, 0.12), (around, -0.12)]), 0.1)
        _, graph = steps_of(case)
        views = [node.params["view"] for node in graph.nodes() if node.step.name == "soft_shadow/prepare"]
        down = [view.window for view in views if view.forward == (0.0, 0.0, -1.0)]
        widest[around] = max((max(map(abs, window)) for window in down), default=0.0)
    assert widest[0.15] > 5.0
    assert widest[1.0] < 1.5
