"""The courtyard, baked once, and an engine of known values."""

from __future__ import annotations

import pytest
from strata.tests.layers.compositor.scene import bake_courtyard, flat_engine, opened


@pytest.fixture(scope="session")
def courtyard(tmp_path_factory):
    with flat_engine():
        return bake_courtyard(tmp_path_factory.mktemp("courtyard"))


@pytest.fixture(scope="module", autouse=True)
def registered(courtyard):
    with flat_engine():
        yield


@pytest.fixture
def scene(courtyard):
    return opened(courtyard)
