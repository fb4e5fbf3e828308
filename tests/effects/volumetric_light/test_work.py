"""How much a lamp's fog has to do, from which the time left is told."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from strata.addon.core.graph import Node
from strata.addon.core.view import View
from strata.addon.effects.volumetric_light import steps
from strata.addon.effects.volumetric_light.sources import Source, SourceKind, share_in_cone


@pytest.mark.parametrize("orthographic", [False, True])
def test_rays_that_come_into_a_cone_are_counted(orthographic):
    """Against points along each ray, which find almost all of them."""
    random = np.random.default_rng(5)
    for _ in range(20):
        axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
        eye, place = random.normal(0.0, 4.0, (2, 3))
        aim = random.normal(size=3)
        cosine = float(random.uniform(0.2, 0.95))
        source = Source(SourceKind.SPOT, tuple(place), tuple(aim / np.linalg.norm(aim)), 1.0, cos_cone=cosine)
        window = (-2.0, 2.0, -1.0, 1.5)
        view = View(tuple(eye), *map(tuple, axes), window, 0.1, 100.0, orthographic)
        across, upwards = np.meshgrid(np.linspace(-2.0, 2.0, 81)[1::2], np.linspace(-1.0, 1.5, 81)[1::2])
        aside = (across[..., None] * axes[0] + upwards[..., None] * axes[1]).reshape(-1, 1, 3)
        along = np.geomspace(1e-3, 1e4, 2000)[:, None]
        points = eye + (aside + along * axes[2] if orthographic else along * (aside + axes[2])) - place
        cosines = points @ np.array(source.axis) / np.linalg.norm(points, axis=2)
        counted = (cosines.max(axis=1) >= cosine).mean()
        assert share_in_cone(source, view, 40, 40) == pytest.approx(counted, abs=0.005)


def test_beside_a_spots_cone_there_is_little_to_do():
    ahead = View((0, 0, 0), (1, 0, 0), (0, 0, 1), (0, 1, 0), (-0.5, 0.5, -0.5, 0.5), 0.1, 100.0)
    spot = Source(SourceKind.SPOT, (0.0, 5.0, 3.0), (0.0, 0.0, -1.0), 1.0, cos_cone=math.cos(0.4))
    node = Node(steps.AIRLIGHT, "", (), {"counts": (1, 1), "source": spot, "view": ahead})
    turned = replace(spot, axis=(0.0, 0.0, 1.0))
    whole, beside = (
        steps.AIRLIGHT.work_of(Node(steps.AIRLIGHT, "", (), node.params | {"source": source}), None)
        for source in (replace(spot, kind=SourceKind.UNIFORM), turned)
    )
    assert whole == 2.0
    assert beside < steps.AIRLIGHT.work_of(node, None) < whole
