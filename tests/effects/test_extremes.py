"""The tables of docs/stability.md, measured again: every cell is within its bound or a refusal."""

from __future__ import annotations

import pytest
from strata.addon.devices.cpu import CpuDevice
from strata.addon.effects.registry import EFFECTS
from strata.tests.effects.extremes import rows_of
from strata.tests.support.gpu_scenes import gpu_device


@pytest.mark.parametrize("effect", [*(effect.id for effect in EFFECTS), "shared"])
def test_every_extreme_is_within_its_bound(effect):
    rows = rows_of(effect, [CpuDevice(), gpu_device()])
    for row in rows:
        assert row.refused or set(row.errors) == {"cpu", "gpu"}, row.extreme
        assert all(error <= row.bound for error in row.errors.values()), (row.extreme, row.errors)
    assert len(rows) > 15
