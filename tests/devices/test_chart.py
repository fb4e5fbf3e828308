"""An object laid out by its UVs, against where its points are known to be, and against a camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from strata.addon.bake import BakeJob
from strata.addon.core.effect import Need
from strata.addon.core.errors import StrataError
from strata.addon.core.shot import Camera, Chart, Raster, Shot
from strata.addon.core.surface import ATTRIBUTES, Chunk
from strata.addon.devices.cpu import CpuDevice
from strata.addon.planning import Options, plan_scene
from strata.tests.support.flat_scenes import DOWN, FLOOR, PLATE, lamp, scene_of
from strata.tests.support.gpu_scenes import gpu_device
from strata.tests.support.settings import maps
from strata.tests.support.tiny_effects import LENS, LENS_STEP, registry

SIZE = (60, 60)
SIDE = 6.0  # metres, of the floor
FAR = 1e5  # metres: the scene lies there


def charted(u=(0.0, 1.0)):
    """A floor under a plate; UVs take its rectangle to the unit square, or to this part of it across."""
    outline, arrays = scene_of([FLOOR, PLATE], [lamp()])
    floor = arrays.meshes[0]
    uvs = (floor.positions[:, :2] / SIDE + 0.5).astype(np.float32)
    uvs[:, 0] = u[0] + uvs[:, 0] * (u[1] - u[0])
    floor = replace(floor, corner_uvs=uvs[floor.corner_vertices])
    return outline, replace(arrays, meshes=(floor, *arrays.meshes[1:]))


def chart_of(outline, arrays, names=tuple(ATTRIBUTES), jitter=(0.0, 0.0)):
    device = CpuDevice()
    device.set_scene(outline, arrays)
    chart = Chart.of(outline, "Box 0", SIZE)
    chunk = Chunk(*SIZE, 0, SIZE[1], 0, jitter)
    flat = device.laid_out(device.geometry(), chart.instances)
    return device.chart(flat, chart.origin, chunk, frozenset(names)), chart


@pytest.mark.parametrize("jitter", [(0.0, 0.0), (0.4, -0.3)])
def test_texels_lie_where_their_uvs_say(jitter):
    outline, arrays = charted()
    matrices = arrays.matrices.copy()
    matrices[0, :3, 3] = FAR, -FAR, 5.0
    bounds = outline.instances[0].bounds
    moved = [tuple(np.array(corner) + matrices[0, :3, 3]) for corner in (bounds.low, bounds.high)]
    first = replace(outline.instances[0], bounds=replace(bounds, low=moved[0], high=moved[1]))
    outline = replace(outline, instances=(first, outline.instances[1]))
    surface, chart = chart_of(outline, replace(arrays, matrices=matrices), jitter=jitter)
    x, y = np.meshgrid(*((np.arange(side) + 0.5 + by) / side for side, by in zip(SIZE, jitter, strict=True)))
    expected = np.stack([(x - 0.5) * SIDE, (y - 0.5) * SIDE, np.zeros(SIZE[::-1])], axis=-1)
    inside = (x < 1.0) & (y > 0.0)
    assert chart.origin == (FAR, -FAR, 5.0)
    assert np.allclose(surface["position"][inside], expected[inside], atol=1e-5)  # float32 of metres
    assert np.allclose(surface["uv"][inside], np.stack([x, y], -1)[inside], atol=1e-6)
    assert (surface["geometric_normal"][inside] == (0.0, 0.0, 1.0)).all()
    assert (surface["instance"][inside] == 0).all()
    assert (surface["depth"][inside] == 0.0).all()


def test_beside_islands_nothing_is():
    surface, _ = chart_of(*charted((0.25, 0.5)))
    there = surface["instance"] >= 0
    assert there[:, 15:30].all()
    assert there.sum() == 15 * SIZE[1]
    assert np.isinf(surface["depth"][~there]).all()
    assert (surface["triangle"][~there] == -1).all()


def test_tiles_of_a_chart_are_parts_of_it():
    outline, arrays = charted()
    device = CpuDevice()
    device.set_scene(outline, arrays)
    chart = Chart.of(outline, "Box 0", SIZE)
    flat = device.laid_out(device.geometry(), chart.instances)
    whole = device.chart(flat, chart.origin, Chunk(*SIZE, 0, SIZE[1], 0, (0.1, 0.2)), frozenset(ATTRIBUTES))
    part = device.chart(flat, chart.origin, Chunk(*SIZE, 7, 20, 0, (0.1, 0.2)), frozenset(ATTRIBUTES))
    for name in ATTRIBUTES:
        assert np.array_equal(part[name], whole[name][7:20]), name


def seen_and_laid_out(backend, effects, **more):
    """Baked of the floor's points as a camera sees them, and as its UVs lay them out."""
    if backend == "gpu":
        gpu_device()  # skips where there is none
    outline, arrays = charted()
    camera = Camera("Camera", (0.0, 0.0, 10.0), **DOWN, orthographic=True, orthographic_scale=SIDE)
    shots = Shot("Camera", Raster(camera, SIZE)), Shot("Chart", Chart.of(outline, "Box 0", SIZE))
    options = Options(effects, backend, 1, 0, **{"values": maps(), **more})
    graphs = [plan_scene(outline, shot, options) for shot in shots]
    return BakeJob(outline, graphs, arrays, options).results()


def bare_floor():
    """Where the plate does not hide the floor from the camera."""
    x, y = np.meshgrid(*((np.arange(side) + 0.5) / side * SIDE - 0.5 * SIDE for side in SIZE))
    return (np.abs(x) > 0.5) | (np.abs(y) > 0.5)


BARE = bare_floor()
BACKENDS = pytest.mark.parametrize("backend", ["cpu", "gpu"])


@BACKENDS
def test_shadows_on_a_chart_are_those_that_a_camera_sees(backend):
    both = seen_and_laid_out(backend, ("soft_shadow",))
    seen, laid_out = (baked.layers.layers[0].pixels for baked in both)
    assert laid_out.min() < 0.05  # the middle of the plate's shadow, which the camera does not see
    assert (seen[BARE] < 0.9).sum() > 20
    # Each shot's maps are fitted to what it shows, so texels differ; a light sample is 1/256.
    assert np.abs(seen - laid_out)[BARE].mean() < 1e-3
    assert np.abs(seen - laid_out)[BARE].max() < 0.05


def test_samples_of_a_chart_weigh_the_irradiance_only():
    outline, arrays = charted()
    shot, layers = Shot("Chart", Chart.of(outline, "Box 0", SIZE)), []
    black = tuple(replace(each, base_color=(0.0, 0.0, 0.0)) for each in outline.materials)
    for materials in (outline.materials, black):
        options = Options(("soft_shadow",), "cpu", 4, 0)
        changed = replace(outline, materials=materials)
        graph = plan_scene(changed, shot, options)
        assert [layer.weighed_by for layer in graph.layers] == ["irradiance"]
        layers.append(BakeJob(changed, graph, arrays, options).result().layers.layers[0])
    assert layers[0].weight == "irradiance"
    assert np.array_equal(layers[0].pixels, layers[1].pixels)
    plain = replace(options, weight="none")
    (plain,) = BakeJob(outline, plan_scene(outline, shot, plain), arrays, plain).result().layers.layers
    assert 1e-5 < np.abs(plain.pixels - layers[0].pixels).max() < 0.05


@BACKENDS
@pytest.mark.parametrize(
    "values",
    [
        {},
        {"shadow_edge": "soft"},
        {"light": "brightness", "exposure": 75.0},
        {"normals": "flat", "mix": "soft_light"},
    ],
    ids=["facing", "soft", "brightness", "flat"],
)
def test_toon_light_on_a_chart_is_that_which_a_camera_sees(backend, values):
    steps = {"ramp": "0:#000000,0.5:#444444,0.9:#ffffff;constant", **values}
    both = seen_and_laid_out(backend, ("toon",), values={"toon": steps})
    seen, laid_out = (baked.layers.layers[0].pixels for baked in both)
    for image in (seen, laid_out):
        assert len(np.unique(image[BARE], axis=0)) == 3  # shade and both steps of light
    # Where the plate hides the floor from the camera it hides it from the lamp too.
    assert (laid_out[~BARE] == laid_out[~BARE][0]).all()
    # Only where rounding decides between two steps may a point have another colour.
    flipped = np.abs(seen - laid_out)[BARE].max(axis=-1) > 1e-6
    assert flipped.mean() < 0.002


# Light by the same kernel from points that are rounded relative to another origin; shadows as above.
@BACKENDS
@pytest.mark.parametrize(("effects", "tolerance"), [((), 1e-5), (("soft_shadow",), 0.05)])
def test_the_composite_on_a_chart_is_that_which_a_camera_sees(backend, effects, tolerance):
    both = seen_and_laid_out(backend, effects, composite=True)
    seen, laid_out = (baked.composite for baked in both)
    brightest = seen[BARE][:, :3].max()
    assert brightest > 2.0 * seen[BARE][:, :3].min() > 0.0
    assert np.abs(seen - laid_out)[BARE].max() < tolerance * brightest
    assert (laid_out[..., 3] == 1.0).all()


def test_what_needs_an_eye_is_left_out():
    outline, _ = charted()
    shot = Shot("Chart", Chart.of(outline, "Box 0", SIZE))
    values = {"toon": {"rim": 0.5}}
    options = Options(("soft_shadow", "volumetric_light", "toon"), "cpu", values=values)
    graph = plan_scene(outline, shot, options)
    assert [layer.name for layer in graph.layers] == ["Soft Shadow Lamp", "Toon"]
    reasons = {each.what: each.reason for each in graph.left_out}
    for what in ("Volumetric Light", "Toon Halftone", "Toon Outline", "Toon rim"):
        assert reasons[what] == "a UV chart has no eye", what


def test_what_needs_an_eye_makes_no_picture_of_a_chart():
    outline, _ = charted()
    lens = replace(LENS, needs=frozenset({Need.EYE}))
    options = Options(("lens",), "cpu", composite=True, registry=registry(lens))
    camera = Camera("Camera", (0.0, 0.0, 10.0), **DOWN)
    for source, is_made in ((Raster(camera, SIZE), True), (Chart.of(outline, "Box 0", SIZE), False)):
        graph = plan_scene(outline, Shot("Shot", source), options)
        assert (graph.layers[0].node.step is LENS_STEP) == is_made
        told = [each.reason for each in graph.left_out if each.what == "Lens"]
        assert told == ([] if is_made else ["a UV chart has no eye"])


def test_an_object_has_to_be_there():
    outline, _ = charted()
    with pytest.raises(StrataError, match="no object 'Nobody'"):
        Chart.of(outline, "Nobody", SIZE)
