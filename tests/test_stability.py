"""The tables of docs/stability.md, measured again: every cell is within its bound or a refusal."""

from __future__ import annotations

import sys
from importlib import import_module

import pytest
from conftest import ROOT
from gpu_scenes import gpu_device
from strata.addon.devices.cpu import CpuDevice

sys.path.append(str(ROOT / "scripts"))


@pytest.mark.parametrize("effect", ["soft_shadow", "toon"])
def test_every_extreme_is_within_its_bound(effect):
    """volumetric_light's, against forty digits, are in test_airlight.py."""
    count = 0
    for row in import_module(f"extremes.{effect}").rows([CpuDevice(), gpu_device()]):
        assert row.refused or set(row.errors) == {"cpu", "gpu"}, row.extreme
        assert all(error <= row.bound for error in row.errors.values()), (row.extreme, row.errors)
        count += 1
    assert count > 15
