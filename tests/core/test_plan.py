"""Planning again after an edit: equal content is an equal key; only what an edit touches is worked out."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import bpy
import numpy as np
import pytest
from strata.addon.bake import BakeJob, read_scene
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.graph import Node, Step
from strata.addon.core.outline import Instances
from strata.addon.core.recorder import Recorder
from strata.addon.planning import Options, plan_scene
from strata.addon.scene.open import choose, open_blend
from strata.addon.scene.scan import ScanOptions, scan
from strata.tests.support.places import SAMPLES
from strata.tests.support.settings import maps

STEP = Step("step", cpu=lambda device, **params: None)
DOWN = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0))


def key(value) -> str:
    return Node(STEP, "", (), {"value": value}).key


def word() -> str:
    """Made anew, so that it is not the same object as another of these letters."""
    return "".join(["li", "ght"])


def emitter(**more) -> Emitter:
    return Emitter(EmitterKind.SPHERE, (1.0, 2.0, 3.0), *DOWN, 0.1, 0.1, **more)


@pytest.mark.parametrize(
    "make",
    [
        lambda: (1.5, ("add", None, True), [word()]),
        lambda: frozenset([3, 5000, 1]),
        lambda: (frozenset([3, 5000, 1]), word()),
        lambda: np.arange(6.0).reshape(2, 3),
        emitter,
        lambda: (emitter(), 2),
    ],
    ids=["plain", "set", "set in a tuple", "array", "emitter", "emitter in a tuple"],
)
def test_equal_content_is_an_equal_key(make):
    assert key(make()) == key(make())


def test_unlike_content_has_unlike_keys():
    array = np.arange(6, dtype=np.float32)
    values = [
        *(0.0, -0.0, 0, False, None, "0", b"0", 1, 1.0, True, np.nextafter(1.0, 2.0)),
        *((1,), (1.0,), (True,), ((1,), 2), (1, (2,)), ("ab", "c"), ("a", "bc")),
        *(frozenset(), frozenset([1]), frozenset([2]), (frozenset([1]),)),
        *(array, array[::-1], array.astype(np.float64), array.reshape(2, 3)),
        *(emitter(), emitter(blend=0.5), (emitter(),), (emitter(), emitter())),
        *(EmitterKind.SPHERE, EmitterKind.RECTANGLE),
    ]
    assert len({key(value) for value in values}) == len(values)


def test_what_is_asked_for_again_is_kept_longest():
    instances, made = Instances(), []

    def ask(number):
        return instances.memo(number, lambda: made.append(number))

    ask(-1)
    for number in range(2 * Instances.MOST_MEMOS):
        ask(number)
        ask(-1)
    assert made.count(-1) == 1
    ask(0)
    assert made.count(0) == 2


@pytest.fixture(scope="module")
def courtyard():
    open_blend(SAMPLES / "courtyard.blend")
    scene = choose().scene
    return scan(scene.view_layers[0].depsgraph, ScanOptions(size=(160, 90)))


def test_only_the_moved_lights_maps_are_placed_again(courtyard, monkeypatch):
    placed = []

    def light_views(light, *boxes):
        placed.append(light)
        return original(light, *boxes)

    run = import_module("strata.addon.effects.soft_shadow.run")  # its name is the effect's function too
    original = run.light_views
    monkeypatch.setattr(run, "light_views", light_views)
    options = Options(("soft_shadow",), composite=True, values=maps())
    before = plan_scene(courtyard.outline, courtyard.shot, options)
    assert len(placed) == len(courtyard.outline.lights)
    placed.clear()

    again = plan_scene(courtyard.outline, courtyard.shot, options)
    slid = plan_scene(courtyard.outline, courtyard.shot, replace(options, values=maps(refinements=3)))
    assert placed == []
    assert [node.key for node in again.nodes()] == [node.key for node in before.nodes()]
    assert {node.key for node in slid.nodes()} != {node.key for node in before.nodes()}

    light = next(each for each in courtyard.outline.lights if each.kind == "POINT")
    centre = (light.emitter.centre[0] + 0.01, *light.emitter.centre[1:])
    moved = replace(light, emitter=replace(light.emitter, centre=centre))
    lights = tuple(moved if each is light else each for each in courtyard.outline.lights)
    after = plan_scene(replace(courtyard.outline, lights=lights), courtyard.shot, options)
    assert placed == [moved.emitter]
    kept = {node.key for node in after.nodes()}
    changed = [node for node in before.nodes() if node.key not in kept]
    assert all(node.instance.startswith(light.name) for node in changed if node.instance)
    assert {node.step.name for node in changed if not node.instance} == {"composite"}


def test_maps_draw_only_what_they_may_show(courtyard):
    """The lanterns' do not draw the whole scene six times."""
    triangles = 0
    for node in plan_scene(courtyard.outline, courtyard.shot, Options(("soft_shadow",))).nodes():
        if node.step.name == "layered_depth" and node.instance.startswith("Lantern light"):
            drawn = node.params["casters"]
            triangles += sum(
                courtyard.outline.meshes[courtyard.outline.instances[i].mesh].triangles for i in drawn
            )
    assert triangles < 2.5 * courtyard.outline.triangles


@pytest.fixture
def low_panel():
    """A panel close above a field of blocks, which takes nested maps; the camera sees all of it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_plane_add(size=40.0)
    rng = np.random.default_rng(5)
    for x, y in rng.uniform(-12.0, 12.0, (60, 2)):
        bpy.ops.mesh.primitive_cube_add(size=rng.uniform(0.2, 1.5), location=(x, y, rng.uniform(0.5, 2.0)))
    bpy.ops.object.light_add(type="AREA", location=(0.0, 0.0, 3.0))
    bpy.context.object.data.size = 1.0
    bpy.ops.object.camera_add(location=(0.0, 0.0, 40.0))
    bpy.context.scene.camera = bpy.context.object
    return bpy.context.scene


def test_wide_maps_need_not_draw_what_a_finer_one_holds_whole(low_panel, monkeypatch):
    """Nested windows share the work: texels of the finer window are not read of the wider map."""
    options = Options(("soft_shadow",), "cpu", samples=1, probes=0, values=maps(resolution=256))
    *read, _ = read_scene(low_panel, low_panel.view_layers[0], options, size=(160, 160))

    def visibility() -> np.ndarray:
        return BakeJob(*read, options).result().layers.layers[0].pixels

    def drawn() -> list[int]:
        nodes = plan_scene(read[0], read[1].shot, options).nodes()
        return [len(node.params["casters"]) for node in nodes if node.step.name == "layered_depth"]

    less, few = visibility(), drawn()
    run = import_module("strata.addon.effects.soft_shadow.run")
    monkeypatch.setattr(run, "not_whole_in", lambda view, casters, instances: casters)
    more, many = visibility(), drawn()
    assert len(few) >= 3
    assert few[-1] < 0.6 * many[-1]
    assert np.array_equal(less, more)
    # The wider maps are read here: without them shadows are missing.
    monkeypatch.setattr(run, "not_whole_in", lambda view, casters, instances: frozenset())
    assert (np.abs(visibility() - more) > 0.1).mean() > 0.01


def test_all_effects_share_one_surface(courtyard):
    """Though much of the scene is out of the camera's sight."""
    fog = {"use_scene_medium": False, "scattering_per_m": (0.1, 0.1, 0.1)}
    options = Options(("soft_shadow", "volumetric_light", "toon"), values={"volumetric_light": fog})
    graph = plan_scene(courtyard.outline, courtyard.shot, options)
    assert [node for node in graph.nodes() if node.step.name == "surface"] == [graph.surface]


def test_a_shot_has_one_surface_of_its_own(courtyard):
    recorder = Recorder(courtyard.outline, courtyard.shot)
    own, other = (recorder.step(STEP, name=name) for name in ("own", "other"))
    recorder.surface(other, "depth")
    assert recorder.graph().surface is None
    recorder.own_surface(own, "depth")
    recorder.own_surface(own, "position")
    graph = recorder.graph()
    assert graph.surface is own
    assert graph.surfaces == {other: {"depth"}, own: {"depth", "position"}}
    with pytest.raises(ValueError, match="one surface of its own"):
        recorder.own_surface(other)
