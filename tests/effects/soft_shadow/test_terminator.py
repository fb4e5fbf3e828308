"""Where maps are asked near the terminator of smooth surfaces: above the triangles, on both devices."""

from __future__ import annotations

import math

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import Emitter, EmitterKind
from strata.addon.core.surface import Chunk
from strata.addon.core.view import View
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.shared.steps import SURFACE
from strata.addon.effects.soft_shadow.steps import RAISED
from strata.tests.support.gpu_scenes import on_both, scene_of, sheets_over_ground

NAMES = ("position", "geometric_normal", "shading_normal", "terminator_lift", "instance")
SIZE = (120, 68)
CAMERA = View(
    (0, -6, 5.0), (1, 0, 0), (0, 0.64, 0.7683749), (0, 0.7683749, -0.64), (-0.5, 0.5, -0.28, 0.28), 0.1, 99.0
)
C70, S70 = math.cos(math.radians(70.0)), math.sin(math.radians(70.0))
GRAZING = (0.0, 1.0, 0.0), (-C70, 0.0, S70), (S70, 0.0, -C70)
DOWN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)
LIGHTS = {
    "sun": Emitter(EmitterKind.DISTANT_DISK, (0.0, 0.0, 0.0), *GRAZING, 0.05, 0.05),
    "hard sun": Emitter(EmitterKind.DISTANT_DISK, (0.0, 0.0, 0.0), *GRAZING, 0.0, 0.0),
    "point": Emitter(EmitterKind.SPHERE, (-4.0, -0.2, 1.9), *DOWN, 0.2, 0.2),
    "rectangle": Emitter(EmitterKind.RECTANGLE, (-4.0, -0.5, 2.0), *GRAZING, 0.6, 0.4),
}


class Sheets:
    """Bumpy sheets over a flat ground, whose offsets differ; the last has none."""

    def __init__(self):
        meshes, instances = sheets_over_ground(7, (0,))
        self.outline, self.arrays = scene_of(meshes, instances)
        self.cpu = CpuDevice()
        self.cpu.set_scene(self.outline, self.arrays)
        chunk = Chunk(*SIZE, 0, SIZE[1], 0, (0.0, 0.0))
        everything = frozenset(range(len(instances)))
        self.surface = SURFACE.cpu(self.cpu, self.cpu.geometry(), CAMERA, everything, chunk, frozenset(NAMES))
        self.offsets = np.array([0.1, 0.1, 0.3, 0.5, 0.2, 0.05, 0.1, 0.0, 0.0], np.float32)
        self.offset = self.offsets[self.surface["instance"]]

    def raised(self, emitter: Emitter) -> dict[str, np.ndarray]:
        return RAISED.cpu(self.cpu, self.surface, eye=CAMERA.eye, emitter=emitter, offsets=self.offsets)


@pytest.fixture(scope="module")
def sheets():
    return Sheets()


def test_all_of_the_lift_where_a_triangle_turns_away_and_none_well_above(sheets):
    emitter, surface = LIGHTS["hard sun"], sheets.surface
    raised, towards = sheets.raised(emitter), -np.array(emitter.forward)
    above, lit = (surface[name] @ towards for name in NAMES[1:3])
    there = (sheets.offset > 0.0) & (surface["terminator_lift"] != 0.0).any(axis=-1)
    away, clear = there & (above < 0.0), there & (above > 2.0 * sheets.offset)
    between = there & (lit > sheets.offset) & (above > 0.1 * sheets.offset) & (above < 0.9 * sheets.offset)
    assert min(away.sum(), clear.sum(), between.sum()) > 5
    lift = surface["terminator_lift"]
    moved = raised["position"] - surface["position"]
    assert np.allclose(moved[away], lift[away], atol=1e-6)
    share = 1.0 - above / sheets.offset.clip(1e-9)
    assert np.allclose(moved[between], (share[..., None] * lift)[between], atol=1e-6)
    assert (raised["geometric_normal"][away | between] == surface["shading_normal"][away | between]).all()
    same = clear | ~there
    for name in NAMES[:2]:
        assert (raised[name][same] == surface[name][same]).all()
    assert raised["shading_normal"] is surface["shading_normal"]


@pytest.mark.parametrize("light", ["sun", "point", "rectangle"])
def test_the_lowest_part_of_a_wide_light_decides(sheets, light):
    """Whatever part of the light a triangle turns away from: all of the lift."""
    emitter, surface = LIGHTS[light], sheets.surface
    moved = sheets.raised(emitter)["position"] - surface["position"]
    rng = np.random.default_rng(1)
    across = rng.uniform(-1.0, 1.0, (200, 2))
    if emitter.kind != EmitterKind.RECTANGLE:
        across = across[(across**2).sum(axis=1) < 1.0]
    across = across @ np.array([emitter.right, emitter.up]) * emitter.half_width * (1.0, 1.0, 1.0)
    if emitter.kind == EmitterKind.DISTANT_DISK:
        ways = np.broadcast_to(
            -np.array(emitter.forward) + across[:, None, None], (len(across), *moved.shape)
        )
    else:
        places = np.array(emitter.centre) - np.array(CAMERA.eye) + across
        ways = places[:, None, None] - surface["position"]
    heights = np.einsum("shwi,hwi->shw", ways, surface["geometric_normal"])
    away = (sheets.offset > 0.0) & (heights < 0.0).any(axis=0)
    assert away.sum() > 20
    assert np.allclose(moved[away], surface["terminator_lift"][away], atol=1e-6)


@pytest.mark.parametrize("light", LIGHTS)
def test_both_devices_raise_points_alike(light):
    sheets, emitter = Sheets(), LIGHTS[light]
    _, (gpu, _) = on_both(sheets.outline, sheets.arrays)
    settings = {"eye": CAMERA.eye, "emitter": emitter, "offsets": sheets.offsets}
    ours = sheets.raised(emitter)
    theirs = gpu.to_host(RAISED.gpu(gpu, gpu.from_host(sheets.surface), **settings))
    assert ours.keys() == theirs.keys()
    moved = np.linalg.norm(ours["position"] - sheets.surface["position"], axis=-1)
    assert (moved > 1e-4).sum() > 50
    assert (moved == 0.0).sum() > 50
    # Cosines are rounded by some 1e-7, over offsets of .05 at least, times lifts of some hundredths.
    assert np.abs(ours["position"] - theirs["position"]).max() < 1e-6
    other = (ours["geometric_normal"] != theirs["geometric_normal"]).any(axis=-1)
    assert other.sum() <= 2  # where the share is about 0
    assert (ours["shading_normal"] == theirs["shading_normal"]).all()


def test_what_does_not_fit_is_refused(sheets):
    points = [sheets.surface[name] for name in NAMES]
    rest = sheets.offsets, CAMERA.eye, LIGHTS["sun"].packed()
    with pytest.raises(ValueError, match="images of three numbers"):
        kernels.soft_shadow_raised(*points[:3], points[3][1:], points[4], *rest)
    # An instance without an offset stays where it is.
    position, _ = kernels.soft_shadow_raised(*points, sheets.offsets[:0], *rest[1:])
    assert (position == points[0]).all()
