"""The preview without a window: what runs after each kind of edit, and that it ends at the bake."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest
from strata.addon.bake import bake
from strata.addon.core.sampling import passes_up_to
from strata.addon.planning import Options
from strata.addon.preview import caption, session
from strata.addon.preview.budget import Budget
from strata.addon.preview.session import Session
from strata.addon.preview.viewport import Viewport
from strata.addon.scene.cameras import camera_of
from strata.addon.scene.exact import reading
from strata.addon.scene.exact.store import Store
from strata.addon.scene.nodes.pictures import Picture
from strata.addon.scene.open import choose, open_blend
from strata.addon.scene.viewport import Placement, hides_objects
from strata.tests.support.places import SAMPLES
from strata.tests.support.procedural import card, clear_by, floor_scene, noise
from strata.tests.support.settings import maps

SIZE = (160, 90)
SMALL_MAPS = maps(resolution=256)
BUDGET_MS = 1e9  # no frame of these tests is ever too slow, so that the scale stays


class Space:
    """A 3D View as far as visibility goes: it shows all."""

    local_view = None
    use_local_collections = False

    def __getattr__(self, name):
        assert name.startswith("show_object_viewport_")
        return True


class Watched:
    """A file in one viewport that looks through the scene's camera."""

    def __init__(self, path, backend: str, **options):
        open_blend(path)
        self.scene = choose().scene
        bpy.context.window.scene = self.scene
        self.view_layer = bpy.context.view_layer
        self.options = Options(
            ("soft_shadow",), backend, probes=0, composite=True, **{"samples": 1, **options}
        )
        self.session, self.viewport, self.layer = Session(backend), Viewport(), ""
        self.longest_s = 0.0
        self.depsgraph.update()

    @property
    def depsgraph(self):
        return bpy.context.evaluated_depsgraph_get()

    def placement(self) -> Placement:
        depsgraph = self.depsgraph
        camera = camera_of(self.scene.camera.evaluated_get(depsgraph))
        return Placement(camera, (0.0, 0.0, *map(float, SIZE)), (0, 0, *SIZE), is_camera_view=True)

    def draw(self) -> dict[str, int]:
        """What a redraw runs: how many times by step."""
        depsgraph = self.depsgraph
        assert not hides_objects(Space())
        self.session.read(depsgraph, Space(), self.placement(), self.options.seed, self.options.read)
        asked = self.placement(), self.options, self.layer, BUDGET_MS, self.longest_s
        if not self.viewport.show(self.session, *asked):
            return {}
        ran: dict[str, int] = {}
        for (step, _instance), (_ms, runs) in self.viewport.statistics.steps.items():
            ran[step] = ran.get(step, 0) + runs
        return ran

    def settle(self) -> None:
        while self.viewport.has_work:
            self.viewport.advance(60.0, self.session.version, BUDGET_MS)

    def edited(self, edit) -> dict[str, int]:
        """What a redraw runs after `edit()`, with Blender's own words about it."""

        def note(scene, depsgraph):
            self.session.changes.add(depsgraph)

        bpy.app.handlers.depsgraph_update_post.append(note)
        try:
            edit()
            bpy.context.view_layer.update()
        finally:
            bpy.app.handlers.depsgraph_update_post.remove(note)
        return self.draw()


def two_lights(backend: str, **options) -> Watched:
    """The panel of the file, and a spot beside it."""
    watched = Watched(SAMPLES / "stacked.blend", backend, values=SMALL_MAPS, **options)
    panel = lamp("Panel")
    spot = bpy.data.objects.new("Spot", bpy.data.lights.new("Spot", "SPOT"))
    spot.data.energy, spot.data.shadow_soft_size, spot.data.spot_size = 100.0, 0.3, 1.5
    spot.matrix_world = panel.matrix_world
    spot.location.x += 0.7
    watched.scene.collection.objects.link(spot)
    bpy.context.view_layer.update()
    return watched


def test_refining_stops_at_its_time_limit_after_a_whole_sample():
    watched = two_lights("cpu", samples=4)
    watched.longest_s = 1e-6
    watched.draw()
    watched.settle()
    told = watched.viewport.statistics
    assert (told.samples, told.of_samples, told.is_converged) == (1, 4, False)
    assert "at its time limit, 1 of 4" in caption.lines(told)[0]
    first = watched.viewport.picture.pixels.copy()
    watched.longest_s = 0.0
    watched.draw()
    watched.settle()
    assert watched.viewport.statistics.is_converged
    assert not watched.viewport.statistics.out_of
    assert np.abs(watched.viewport.picture.pixels - first).max() > 0.0


def test_refining_ends_with_the_time_budget_of_a_bake():
    watched = two_lights("cpu", time_budget_s=1e-6)
    watched.longest_s = 1e6
    watched.draw()
    watched.settle()
    told = watched.viewport.statistics
    assert (told.samples, told.of_samples, told.out_of) == (1, 64, "time_budget")
    assert caption.lines(told)[0] == "Strata: at its time budget, 1 of 64 samples"


def test_refining_ends_once_the_noise_is_at_the_target():
    """After a pass, and with fewer samples where more noise will do."""
    counts = []
    for target in (0.2, 0.01):
        watched = two_lights("cpu", most_samples=64, target_error=target)
        watched.draw()
        watched.settle()
        told = watched.viewport.statistics
        assert told.is_converged
        assert told.noise <= target or told.samples == 64
        counts.append(told.samples)
    assert counts[0] < counts[1]
    assert set(counts) <= set(passes_up_to(64)) | {1, 2}


@pytest.fixture
def still(backend):
    """Drawn, refined, and warm for what comes next."""
    watched = two_lights(backend)
    watched.draw()
    watched.settle()
    watched.edited(lambda: None)
    watched.viewport.budget.settle = lambda *_: None  # no other scale from here on
    return watched


def lamp(name: str) -> bpy.types.Object:
    return bpy.data.objects[name]


MAPS = {"layered_depth", "soft_shadow/prepare"}


def test_nothing_runs_where_nothing_changed(still):
    assert still.draw() == {}
    assert still.edited(lambda: None) == {}


def test_a_moved_light_runs_its_own_maps_only(still):
    def move():
        lamp("Panel").location.x += 0.05

    assert still.edited(move) == {
        "layered_depth": 1,
        "soft_shadow/prepare": 1,
        "soft_shadow/raised": 1,
        "soft_shadow/backproject": 1,
        "soft_shadow/visibility": 1,
        "irradiance": 1,
        "composite": 1,
    }


def test_a_brighter_light_runs_the_composite_only(still):
    def brighten():
        lamp("Panel").data.energy *= 2.0

    assert still.edited(brighten) == {"composite": 1}


def test_a_moved_camera_runs_no_map(still):
    def move():
        still.scene.camera.location.z += 0.1

    ran = still.edited(move)
    assert MAPS.isdisjoint(ran)
    assert "geometry" not in ran
    assert ran["surface"] == 1
    assert ran["soft_shadow/backproject"] == 2


def test_a_slider_runs_only_what_reads_it(still):
    still.options = Options(
        effects=("soft_shadow",),
        backend=still.options.backend,
        probes=0,
        samples=1,
        composite=True,
        values={"soft_shadow": {**SMALL_MAPS["soft_shadow"], "refinements": 2}},
    )
    compiled = still.session.devices.primary.compile_seconds
    assert still.draw() == {"soft_shadow/backproject": 2, "soft_shadow/visibility": 2, "composite": 1}
    assert still.session.devices.primary.compile_seconds == compiled


def test_a_moved_mesh_uploads_no_mesh(still):
    def move():
        next(o for o in still.scene.objects if o.type == "MESH").location.x += 0.1

    before = still.session._arrays
    ran = still.edited(move)
    after = still.session._arrays
    assert ran["geometry"] == 1
    assert after is not before
    assert all(new is old for new, old in zip(after.meshes, before.meshes, strict=True))


def test_an_edited_mesh_alone_is_taken_again(still):
    thing = next(o for o in still.scene.objects if o.type == "MESH" and o.data.users == 1)

    def edit():
        thing.data.vertices[0].co.x += 0.1
        thing.data.update()

    before = still.session._arrays
    ran = still.edited(edit)
    after = still.session._arrays
    assert ran["geometry"] == 1
    assert sum(new is not old for new, old in zip(after.meshes, before.meshes, strict=True)) == 1


def test_what_blender_tells_of_without_a_flag_is_read(still):
    thing = next(o for o in still.scene.objects if o.type == "MESH" and len(o.data.polygons))
    thing.data.shade_smooth()

    def edit():
        thing.shadow_terminator_geometry_offset, thing.name = 0.75, "Renamed"

    still.edited(lambda: None)
    still.edited(edit)
    (instance,) = (each for each in still.session.outline.instances if each.name == "Renamed")
    assert instance.terminator_offset == pytest.approx(0.75)
    version = still.session.version
    still.edited(lambda: thing.select_set(not thing.select_get()))
    assert still.session.version == version  # reading nothing again


def test_a_picture_is_evaluated_again_once_its_image_is_painted(still, monkeypatch):
    """And not where a mesh is edited, though then the whole scene is read again."""
    thing = next(o for o in still.scene.objects if o.type == "MESH" and o.data.users == 1)
    image = bpy.data.images.new("Leaf", 8, 8)
    material = bpy.data.materials.new("Leaf")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture, half = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeMath")
    texture.image, half.operation, half.inputs[1].default_value = image, "MULTIPLY", 0.5
    links.new(texture.outputs["Color"], half.inputs[0])
    links.new(half.outputs[0], nodes["Principled BSDF"].inputs["Alpha"])
    evaluated, texels = [], Picture.texels
    monkeypatch.setattr(Picture, "texels", lambda *asked: evaluated.append(asked) or texels(*asked))

    def assign():
        thing.data.materials.clear()
        thing.data.materials.append(material)

    def edit():
        thing.data.vertices[0].co.x += 0.1
        thing.data.update()

    def paint():
        image.pixels[0] = 1.0
        image.update_tag()

    def opacity() -> np.ndarray:
        sides = next(each for each in still.session._arrays.opacities if each.seen[0].texels is not None)
        return sides.seen[0].texels

    still.edited(assign)
    assert len(evaluated) == 1
    before, version = opacity(), still.session.version
    still.edited(edit)
    assert still.session.version != version
    assert len(evaluated) == 1
    assert opacity() is before
    still.edited(paint)
    assert len(evaluated) == 2
    assert opacity()[0, 0] > before[0, 0]


def test_a_hidden_object_is_gone(still):
    thing = next(o for o in still.scene.objects if o.type == "MESH")
    count = len(still.session.outline.instances)

    def hide():
        thing.hide_viewport = True

    still.edited(hide)
    assert len(still.session.outline.instances) < count


def test_the_still_picture_is_the_bake_bit_for_bit(backend):
    watched = two_lights(backend, samples=2)
    watched.draw()
    watched.settle()
    expected = bake(watched.scene, watched.view_layer, watched.options, size=SIZE)
    assert watched.viewport.statistics.is_converged
    assert np.array_equal(watched.viewport.picture.pixels, expected.composite)
    layer = expected.layers.layers[0]
    watched.layer = layer.name
    watched.draw()
    watched.settle()
    assert np.array_equal(watched.viewport.picture.pixels, layer.pixels)


def test_a_shadow_in_colour_is_shown_as_numbers(backend):
    watched = two_lights(backend, samples=2)
    watched.options = replace(watched.options, rgb_layers=True)
    expected = bake(watched.scene, watched.view_layer, watched.options, size=SIZE).layers.layers[0]
    watched.layer = expected.name
    watched.draw()
    assert not watched.viewport.picture.is_colour
    watched.settle()
    assert not watched.viewport.picture.is_colour
    assert expected.pixels.shape[2] == 3
    assert np.array_equal(watched.viewport.picture.pixels, expected.pixels)


def test_the_picture_is_the_bake_again_after_edits(backend):
    """Whatever is kept from before, it has no part in what comes out."""
    watched = two_lights(backend, samples=2)
    light = lamp("Panel")
    mesh = next(o for o in watched.scene.objects if o.type == "MESH")

    def edit():
        light.location.x += 0.3
        mesh.location.z += 0.1
        watched.scene.camera.location.x += 0.1

    watched.draw()
    watched.settle()
    watched.edited(edit)
    watched.settle()
    expected = bake(watched.scene, watched.view_layer, watched.options, size=SIZE)
    assert np.array_equal(watched.viewport.picture.pixels, expected.composite)


@pytest.mark.parametrize("method", ["hybrid", "rays"])
def test_rays_are_the_bakes_whatever_the_tiles(backend, method, monkeypatch):
    """The bake has one tile here."""
    monkeypatch.setattr("strata.addon.preview.viewport.TILE_PIXELS", 48 * SIZE[0])
    watched = two_lights(backend, samples=2)
    values = {"method": method, "rays": 4, "resolution": 128}
    watched.options = replace(watched.options, values={"soft_shadow": values})
    watched.draw()
    watched.settle()
    expected = bake(watched.scene, watched.view_layer, watched.options, size=SIZE)
    # A GPU rounds edges differently in another window (.0014 found); other rays would differ by a quarter.
    allowed = 0.0 if backend == "cpu" else 0.005
    assert np.abs(watched.viewport.picture.pixels - expected.composite).max() <= allowed


def brightness_share(picture, truth) -> float:
    """RMS difference, each as a share of the brightness there, or of the mean where it is darker."""
    weights = np.array([0.2126, 0.7152, 0.0722])
    bright = truth @ weights
    return np.sqrt(((picture - truth) ** 2 @ weights / np.maximum(bright, bright.mean()) ** 2).mean())


def test_noise_is_told_within_a_factor(backend):
    """Against a picture of many samples. Off by less than 3 still tells noise from a picture; of all samples
    0.95 and 0.93 of the true one were found."""
    truth = two_lights(backend, samples=64)
    truth.draw()
    truth.settle()
    truth = truth.viewport.picture.pixels[..., :3]
    watched = two_lights(backend, samples=16)
    watched.draw()
    found = []
    while not watched.viewport.statistics.is_converged:
        if watched.viewport.advance(0.0, watched.session.version, BUDGET_MS):
            found.append((watched.viewport.statistics, watched.viewport.picture.pixels[..., :3]))
    shown = [statistics.samples for statistics, _ in found]
    assert shown == sorted(shown)
    assert {1, 2, 4, 8, 16} <= set(shown)  # others where a sample takes longer than a second
    for statistics, pixels in found:
        true = brightness_share(pixels, truth)
        factor = 1.5 if statistics.is_converged else 3.0
        assert true / factor < statistics.noise < factor * true, (statistics.samples, statistics.noise, true)


def test_one_slow_frame_among_others_makes_no_picture_coarser():
    budget = Budget(level=0)
    fast, slow = (33.0, 10.0, 20.0), (33.0, 10.0, 24.0)
    assert budget.coarser(*slow)  # the very first, nothing else being known
    assert not budget.coarser(*fast)
    assert not budget.coarser(*slow)
    assert not budget.coarser(*fast)
    assert not budget.coarser(*slow)
    assert budget.coarser(*slow)
    assert budget.coarser(*slow)  # at the next scale too: no frame is waited for
    assert budget.scale == 0.125
    assert not budget.coarser(*slow)


def test_a_lights_own_settings_count_and_are_lightened_too(backend):
    watched = two_lights(backend, samples=1)
    own = (("soft_shadow", "resolution", 1024),)
    watched.draw()
    session = watched.session
    lights = tuple(replace(light, own_settings=own) for light in session.outline.lights)
    session.outline = replace(session.outline, lights=lights)

    def sides(graph):
        return {node.params["width"] for node in graph.nodes() if node.step.name == "layered_depth"}

    placement, options = watched.placement(), watched.options
    assert sides(session.still_plan(placement, options)) == {1024}
    assert sides(session.moving_plan(placement, 0.5, options, 0.25)) == {256}


def test_a_preview_shows_what_a_bake_has_kept(tmp_path, monkeypatch):
    known = Store(None)
    monkeypatch.setattr(reading, "STORE", known)
    monkeypatch.setattr(session, "STORE", known)
    floor_scene()
    card(clear_by("Card", noise))
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    watched = Watched(path, "cpu", read="exact")
    watched.draw()
    assert any("(not baked yet on this mesh)" in warning for warning in watched.session.outline.warnings)
    assert any(material.unread_opacity for material in watched.session.outline.materials)
    # A picture of another size has other texels, which do as well.
    bake(watched.scene, watched.view_layer, replace(watched.options, composite=False), size=(960, 540))
    watched.draw()
    assert not watched.session.outline.warnings
    shown = {index for instance in watched.session.outline.instances for index in instance.materials}
    assert any(watched.session.outline.materials[index].opacity_images for index in shown)
