"""Scenes read with what Blender bakes of their materials, kept in memory alone."""

from __future__ import annotations

from dataclasses import replace

from strata.addon.bake import read_scene
from strata.addon.planning import Options
from strata.addon.scene.exact import reading
from strata.addon.scene.exact.store import Store

OPTIONS = Options(("soft_shadow",), "cpu", samples=1, probes=0, read="exact")


def with_own_store(monkeypatch) -> Store:
    """An empty one in place of the user's, until the test ends."""
    made = Store(None)
    monkeypatch.setattr(reading, "STORE", made)
    return made


def read(scene, **changed):
    return read_scene(scene, scene.view_layers[0], replace(OPTIONS, **changed), size=(32, 18))
