"""Strata registered, as Blender does."""

from __future__ import annotations

import bpy
import pytest
import strata
from strata.addon.scene.open import open_blend
from strata.tests.support.places import SAMPLES


@pytest.fixture(scope="module", autouse=True)
def registered():
    strata.register()
    yield
    strata.unregister()


@pytest.fixture
def scene():
    open_blend(SAMPLES / "plain.blend")
    return bpy.context.scene
