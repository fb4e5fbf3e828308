"""What tests of sequences share."""

from __future__ import annotations

import bpy
import pytest
from strata.addon.ui import properties
from strata.tests.bake.sequence_scenes import still_scene


@pytest.fixture
def registered():
    """Strata's settings on scenes, taken away again where they were not there before."""
    had = hasattr(bpy.types.Scene, "strata")
    if not had:
        properties.register()
    yield
    if not had:
        properties.unregister()


@pytest.fixture
def scene(registered):
    """Where nothing moves."""
    return still_scene()
