"""Rays without maps: a pixel's samples share the light among them."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
import strata_kernels as kernels
from strata.addon.core.emitter import EmitterKind
from strata.addon.core.surface import Chunk
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.soft_shadow.params import Method, SoftShadowParams
from strata.addon.effects.soft_shadow.steps import RAYS_ALONE
from strata.addon.planning import Options, plan_scene
from strata.tests.effects.soft_shadow.scenes import GROUND, HIGH, LOW, UP, Stage, ground_points, lamp
from strata.tests.support import closed_forms
from strata.tests.support.cards import constant, scene_of, shot
from strata.tests.support.figures import weighted_bias, weighted_rmse

LAMPS = {
    "rectangle": lamp(),
    "ellipse": lamp(EmitterKind.ELLIPSE, half=(0.6, 0.4)),
    "sphere": lamp(EmitterKind.SPHERE),
    "facing disk": lamp(EmitterKind.FACING_DISK),
    "sun": lamp(EmitterKind.DISTANT_DISK, half=(0.15, 0.15)),
}
PLATES = (LOW, HIGH)
POINTS = ground_points()
SIDE = int(np.sqrt(len(POINTS)))


class Caster(CpuDevice):
    """Of a stage, all of which casts."""

    def __init__(self, stage: Stage):
        super().__init__()
        self.stage = stage

    def instance_mask(self, instances):
        return self.stage.everything()


def shadow(emitter, sample=0, samples=1, rays=4, rows=(0, SIDE), seed=5) -> np.ndarray:
    """V of rows of POINTS on the ground below two plates, as one of a pixel's samples has it."""
    stage = Stage([GROUND, *PLATES])
    accelerator = kernels.Accel(stage.geometry, stage.origin, stage.everything())
    position = POINTS.reshape(SIDE, SIDE, 3)[slice(*rows)].astype(np.float32)
    normal = np.broadcast_to(np.float32(UP), position.shape)
    surface = {"position": position, "geometric_normal": normal, "shading_normal": normal}
    chunk = Chunk(SIDE, SIDE, *rows, sample, (0.0, 0.0), samples)
    who = {"eye": (0.0, 0.0, 0.0), "emitter": emitter, "casters": frozenset({0, 1, 2})}
    return RAYS_ALONE.cpu(Caster(stage), surface, accelerator, **who, rays=rays, seed=seed, chunk=chunk)


def mean_shadow(emitter, samples: int, rays: int = 4) -> np.ndarray:
    """(N,) over a pixel's samples."""
    return np.mean([shadow(emitter, sample, samples, rays) for sample in range(samples)], axis=0).ravel()


def errors(emitter, samples: int, rays: int = 4) -> tuple[np.ndarray, np.ndarray]:
    truth, weight = closed_forms.visibility(emitter, POINTS, np.tile(UP, (len(POINTS), 1)), PLATES)
    return mean_shadow(emitter, samples, rays) - truth, weight


@pytest.mark.parametrize("emitter", LAMPS.values(), ids=LAMPS)
def test_lamps_of_every_type_are_as_the_closed_form(emitter):
    found, weight = errors(emitter, 32)
    # 128 rays of 0 or 1, in strata of the light: .003 to .007 were found.
    assert weighted_rmse(found, weight) < 0.008
    assert abs(weighted_bias(found, weight)) < 5e-4


@pytest.mark.parametrize("emitter", LAMPS.values(), ids=LAMPS)
def test_errors_fall_faster_with_the_samples_than_those_of_independent_rays(emitter):
    few, many = (weighted_rmse(*errors(emitter, samples)) for samples in (2, 32))
    # Sixteen times as many independent rays would take it to 1/4, strata of a 2D light to 1/8 at edges.
    assert many < few / 6.0


def test_a_pixels_samples_share_one_set_of_strata():
    """Of 4 samples of 4 rays each, as much is known as of one sample of 16; of rays in strata for each sample
    only, half again as much is wrong."""
    emitter = LAMPS["rectangle"]
    apart, together = (weighted_rmse(*errors(emitter, *how)) for how in ((4, 4), (1, 16)))
    assert apart == pytest.approx(together, rel=0.1)


def test_no_bit_depends_on_the_tile():
    whole = shadow(LAMPS["sphere"], 3, 8)
    parts = [shadow(LAMPS["sphere"], 3, 8, rows=rows) for rows in ((0, 7), (7, 30), (30, SIDE))]
    assert np.array_equal(np.concatenate(parts), whole)


def digest() -> str:
    found = [shadow(emitter, sample=2, samples=8) for emitter in LAMPS.values()]
    return hashlib.sha256(np.stack(found).tobytes()).hexdigest()


def test_the_same_bits_on_any_number_of_threads_and_any_processor():
    code = "from strata.tests.effects.soft_shadow.test_rays_alone import digest; print(digest())"
    digests = set()
    for environment in ({"RAYON_NUM_THREADS": "1"}, {"RAYON_NUM_THREADS": "3"}, {"STRATA_PORTABLE": "1"}):
        here = {**os.environ, **environment}
        run = [sys.executable, "-c", code]
        digests.add(subprocess.run(run, env=here, capture_output=True, text=True, check=True).stdout)
    assert len(digests) == 1


def test_no_map_is_made():
    outline, _ = scene_of([constant(0.5)], "area")
    options = Options(("soft_shadow",), values={"soft_shadow": {"method": "rays"}})
    steps = {node.step.name for node in plan_scene(outline, shot(), options).nodes()}
    assert {"ray_accelerator", "soft_shadow/rays_alone"} <= steps
    assert not any("depth" in name or "prepare" in name or "backproject" in name for name in steps)


def test_more_rays_are_advised_and_a_moving_preview_has_maps():
    params = SoftShadowParams(method=Method.RAYS)
    assert params.finer() == ("sample_rays",)
    lighter = params.lighter(0.5)
    assert (lighter.method, lighter.rays) == (Method.BITMASK, 0)
