"""Which effect provides what, and which layers join the picture."""

from __future__ import annotations

from dataclasses import replace

import pytest
from strata.addon.core.effect import Effect, LayerKind
from strata.addon.core.roles import Of, Role, Subject
from strata.addon.planning import Options, plan_scene
from strata.addon.scene.open import choose, open_blend
from strata.addon.scene.scan import scan
from strata.tests.support.places import SAMPLES
from strata.tests.support.settings import maps
from strata.tests.support.tiny_effects import HALF_KIND, HALF_SHADOW, LENS, LENS_STEP, NoParams, registry

BOTH = registry(HALF_SHADOW)
NAMED = ("soft_shadow", "half_shadow")
TITLES = ("Soft Shadow", "Half Shadow")


@pytest.fixture(scope="module")
def scanned():
    open_blend(SAMPLES / "courtyard.blend")
    chosen = choose()
    return scan(chosen.view_layer.depsgraph)


def planned(scanned, outline=None, **options):
    graph = plan_scene(outline or scanned.outline, scanned.shot, Options(registry=BOTH, **options))
    return {layer.name: layer.joins for layer in graph.layers}, graph


def shadows(title: str, scanned) -> set[str]:
    """Of all lamps; each of them shadows something in view."""
    assert len(scanned.outline.lights) > 1
    return {f"{title} {light.pass_name}" for light in scanned.outline.lights}


def test_one_effect_provides_a_lamps_visibility_and_the_other_is_left_out(scanned):
    joins, graph = planned(scanned, effects=NAMED)
    assert joins == dict.fromkeys(shadows("Soft Shadow", scanned), True)
    told = {(entry.what, entry.reason) for entry in graph.left_out if entry.effect == "half_shadow"}
    assert told == {(name, "Soft Shadow is its visibility") for name in shadows("Half Shadow", scanned)}


def test_the_scene_or_a_lamp_chooses_the_provider(scanned):
    joins, _ = planned(scanned, effects=NAMED, providers={Role.VISIBILITY: "half_shadow"})
    assert joins == dict.fromkeys(shadows("Half Shadow", scanned), True)
    first, *others = scanned.outline.lights
    first = replace(first, providers=((Role.VISIBILITY, "half_shadow"),))
    joins, _ = planned(scanned, replace(scanned.outline, lights=(first, *others)), effects=NAMED)
    expected = {f"Half Shadow {first.pass_name}", *(f"Soft Shadow {light.pass_name}" for light in others)}
    assert joins == dict.fromkeys(expected, True)


def test_a_named_effect_is_baked_and_does_not_join(scanned):
    joins, graph = planned(scanned, effects=NAMED, keeps_unused=True)
    used, unused = (dict.fromkeys(shadows(t, scanned), t == "Soft Shadow") for t in TITLES)
    assert joins == used | unused
    assert not [entry for entry in graph.left_out if entry.effect == "half_shadow"]


def test_the_only_chosen_effect_is_the_provider(scanned):
    joins, _ = planned(scanned, effects=("half_shadow",))
    assert joins == dict.fromkeys(shadows("Half Shadow", scanned), True)


def test_others_build_on_what_the_provider_offers(scanned):
    values = {"toon": {"shadow_edge": "soft"}, **maps()}
    _, graph = planned(scanned, effects=("toon",), values=values)
    assert "soft_shadow/backproject" in {node.step.name for node in graph.nodes()}
    _, graph = planned(scanned, effects=("toon", "half_shadow"), values=values)
    names = {node.step.name for node in graph.nodes()}
    assert "tiny half shadow" in names
    assert "soft_shadow/backproject" not in names
    # Of effects that are there only to build on, the scene's choice.
    _, graph = planned(scanned, effects=("toon",), values=values, providers={Role.VISIBILITY: "half_shadow"})
    assert "tiny half shadow" in {node.step.name for node in graph.nodes()}


def test_what_the_scene_does_not_need_provides_nothing(scanned):
    needless = [replace(effect, needed=lambda outline: "no use here") for effect in (HALF_SHADOW, LENS)]
    graph = plan_scene(
        scanned.outline,
        scanned.shot,
        Options(
            effects=("soft_shadow", "half_shadow", "lens"),
            providers={Role.VISIBILITY: "half_shadow"},
            composite=True,
            registry=registry(*needless),
        ),
    )
    assert shadows("Soft Shadow", scanned) < {layer.name for layer in graph.layers if layer.joins}
    assert LENS_STEP not in {node.step for node in graph.nodes()}
    told = [(entry.what, entry.reason) for entry in graph.left_out]
    assert {("Half Shadow", "no use here"), ("Lens", "no use here")} < set(told)


def test_wrong_declarations_are_refused():
    with pytest.raises(ValueError, match="of no lamp"):
        LayerKind("Gobo", "RGB", role=Role.FILTER)
    with pytest.raises(ValueError, match="alpha"):
        LayerKind("Pane", "RGB", role=Role.OVER)
    with pytest.raises(ValueError, match="does not offer"):
        Effect("half", NoParams, (HALF_KIND,), None, None, "", "")
    assert Of.lamp(0) != Of(Subject.EYE) != Of()


def test_neutral_values_are_those_of_roles():
    ones = {role for role in Role if role.neutral == 1.0}
    assert ones == {Role.VISIBILITY, Role.FILTER, Role.AMBIENT, Role.TRANSMITTANCE}
