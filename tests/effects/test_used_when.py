"""Where a parameter counts is declared; here, that plans read it there and nowhere else, and that its label
fits beside it in the sidebar."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import Any

import bpy
import pytest
from strata.addon.core.conditions import ALWAYS, OneOf, When, both
from strata.addon.core.params import Colour, ParamSpec
from strata.addon.core.ramp import Ramp
from strata.addon.effects.registry import EFFECTS
from strata.addon.layers.exr_params import ExrParams
from strata.addon.planning import Options, plan_scene
from strata.addon.scene.open import open_blend
from strata.addon.scene.own_settings import OWNERS, own_specs
from strata.addon.scene.render_depsgraph import with_render_depsgraph
from strata.addon.scene.scan import scan
from strata.tests.support.places import SAMPLES

LABEL_PIXELS = 76
"""Of a row's label, at interface scale 1 in a sidebar as wide as Blender makes it: its column, 0.4 of a
panel, less the margins. Measured in a window: "Gradient Scale", of 77, just fitted."""

BESIDE_A_BOX_PIXELS = 96  # of the label on the right of a box

BY_SCENE = {"rays"}
"""Where they may count, they may also not: with bitmask only for what stands close to a lamp."""


def other(spec: ParamSpec, value: Any) -> Any:
    """A value that is not `value`."""
    if spec.kind is bool:
        return not value
    if issubclass(spec.kind, Enum):
        return next(word for word in spec.kind if word != value)
    if issubclass(spec.kind, str):
        return value + "x"
    if spec.kind is Colour:
        return Colour(*(0.25 if channel != 0.25 else 0.5 for channel in value))
    if spec.kind is Ramp:
        return Ramp.parse("0:#000000,1:#123456;linear")
    low, high = spec.soft
    within = spec.kind(0.75 * low + 0.25 * high)
    return within if within != value else spec.kind(0.25 * low + 0.75 * high)


def conditions(condition) -> Iterator[When]:
    if isinstance(condition, When):
        yield condition
    else:
        for part in condition.parts:
            yield from conditions(part)


def situations(specs: dict[str, ParamSpec]) -> Iterator[dict[str, Any]]:
    """The defaults, and each way a condition can go; what it depends on itself is as that needs."""
    yield {}
    for spec in specs.values():
        for found in conditions(spec.used_when):
            asked = specs[found.name]
            if found.values:
                values = list(asked.kind) if issubclass(asked.kind, Enum) else [True, False]
            else:
                values = [asked.hard[1], 0.5 * sum(asked.soft)]
            yield from ({found.name: value} for value in values)


@pytest.fixture(scope="module")
def seen():
    open_blend(SAMPLES / "mist.blend")
    scene = bpy.context.scene
    return with_render_depsgraph(scene, scene.view_layers[0], scan)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.id)
def test_a_parameter_is_read_where_it_counts_and_nowhere_else(effect, seen):
    specs = {spec.name: spec for spec in effect.params.specs()}
    lamp, found = seen.outline.lights[0].name, set()

    def keys(values) -> tuple:
        graph = plan_scene(seen.outline, seen.shot, Options((effect.id,), "cpu", values={effect.id: values}))
        return tuple((layer.name, layer.node.key, layer.target_error) for layer in graph.layers)

    for situation in situations(specs):
        values = {name: spec.default for name, spec in specs.items()} | situation
        settled = {name: specs[name].settled(value, traces_rays=True) for name, value in values.items()}
        before = keys(values)
        for name in specs.keys() - situation.keys():
            changed = lamp if name == "key_light" else other(specs[name], values[name])
            is_read = keys(values | {name: changed}) != before
            if is_read:
                found.add(name)
            counts = specs[name].used_when.holds(settled.__getitem__)
            assert counts or not is_read, f"{name} is grey, and yet read, with {situation}"
            is_bound = specs[name].used_when != ALWAYS and name not in BY_SCENE
            assert is_read or not counts or not is_bound, f"{name} is not read: {situation}"
    assert found == set(specs)


def test_what_a_condition_asks_for_stands_beside_it():
    for owner in OWNERS:
        for specs in own_specs(owner).values():
            names = {spec.name for spec in specs}
            assert {each.name for spec in specs for each in conditions(spec.used_when)} <= names, owner


def test_conditions_say_what_they_ask():
    shown, hidden = When("dots", (True,)), When("size", above=0.0, below=2.0)
    either = OneOf((When("anchor", ("screen", "object")), When("grid", (False,))))
    told = both(shown, both(hidden, either))
    assert told.words() == (
        "dots is on and size is above 0 and below 2 and (anchor is screen or object or grid is off)"
    )
    values = {"dots": True, "size": 1.0, "anchor": "object", "grid": True}
    assert told.holds(values.__getitem__)
    for name, value in (("dots", False), ("size", 0.0), ("size", 2.0), ("anchor", "surface")):
        assert not told.holds((values | {name: value}).__getitem__), name
    assert both(shown) == shown
    assert ALWAYS.holds(values.__getitem__)
    assert ALWAYS.words() == ""


def all_specs() -> Iterator[ParamSpec]:
    yield from ExrParams.specs()
    for effect in EFFECTS:
        yield from effect.params.specs()
        yield from effect.object_params.specs() if effect.object_params else ()


def test_every_label_fits_beside_its_value():
    import blf  # part of bpy

    blf.size(0, bpy.context.preferences.ui_styles[0].widget.points)
    for spec in all_specs():
        if spec.name == spec.group.switch:
            continue  # a heading
        room = BESIDE_A_BOX_PIXELS if spec.kind is bool else LABEL_PIXELS
        assert blf.dimensions(0, spec.label)[0] <= room, spec.label
        for word in spec.words.values():
            assert blf.dimensions(0, word)[0] <= BESIDE_A_BOX_PIXELS, word


def test_labels_are_told_apart_and_have_their_units():
    for specs in ([*effect.params.specs()] for effect in EFFECTS):
        called = [(spec.group.title, spec.label, spec.unit) for spec in specs]
        assert len(set(called)) == len(called)
    labels = {spec.name: spec.label for spec in all_specs()}
    assert labels["scattering_per_m"] == "Scattering/m"
    assert labels["max_samples"] == "Max Texels"
