"""Which passes a render has of effects of other roles than those that there are."""

from __future__ import annotations

from types import SimpleNamespace

import bpy
import pytest
from strata.addon.engine import passes
from strata.addon.scene.open import choose, open_blend
from strata.ops.cli import _properties
from strata.tests.support.places import SAMPLES
from strata.tests.support.tiny_effects import GOBO, HALF_SHADOW, registry

ALL = registry(GOBO, HALF_SHADOW)


@pytest.fixture
def view_layer():
    with _properties():
        open_blend(SAMPLES / "courtyard.blend")
        yield choose().view_layer


def names_of(view_layer, *enabled: str) -> dict[str, passes.PassKind]:
    settings = {effect.id: SimpleNamespace(enabled=effect.id in enabled) for effect in ALL}
    scene = SimpleNamespace(strata=SimpleNamespace(rgb_layers=False, **settings))
    return {kind.name: kind for kind in passes.registered(scene, view_layer, registry=ALL)}


def test_a_filter_has_a_pass_of_lamps_without_shadows_too(view_layer):
    lamp = next(thing for thing in bpy.context.scene.objects if thing.type == "LIGHT")
    assert f"Soft Shadow {lamp.name}" in names_of(view_layer, "soft_shadow", "gobo")
    lamp.data.use_shadow = False
    found = names_of(view_layer, "soft_shadow", "gobo")
    assert f"Soft Shadow {lamp.name}" not in found
    gobo = found[f"Gobo {lamp.name}"]
    assert (gobo.channels, gobo.type, gobo.neutral) == ("RGB", "COLOR", 1.0)


def test_of_two_effects_that_shadow_lamps_the_first_has_passes(view_layer):
    both = names_of(view_layer, "soft_shadow", "half_shadow")
    assert both
    assert both == names_of(view_layer, "soft_shadow")
    alone = names_of(view_layer, "half_shadow")
    assert {name.replace("Half", "Soft") for name in alone} == set(both)
