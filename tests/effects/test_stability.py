"""The tables of docs/stability.md, measured again: every cell is within its bound or a refusal."""

from __future__ import annotations

from importlib import import_module

import pytest
from strata.addon.devices.cpu import CpuDevice
from strata.tests.support.gpu_scenes import gpu_device


@pytest.mark.parametrize("effect", ["soft_shadow", "toon"])
def test_every_extreme_is_within_its_bound(effect):
    """volumetric_light's, against forty digits, are in test_airlight.py."""
    count = 0
    for row in import_module(f"strata.tests.effects.{effect}.extremes").rows([CpuDevice(), gpu_device()]):
        assert row.refused or set(row.errors) == {"cpu", "gpu"}, row.extreme
        assert all(error <= row.bound for error in row.errors.values()), (row.extreme, row.errors)
        count += 1
    assert count > 15
