"""Presets: what effects bring, what a person keeps, and what older ones hold."""

from __future__ import annotations

import bpy
import pytest
from strata.addon.effects.registry import EFFECTS
from strata.addon.ui.properties import options_of
from strata.scripts.build import effect_presets


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.id)
def test_presets_are_taken_by_blender(scene, effect, tmp_path):
    effect_presets.write(tmp_path)
    getattr(scene.strata, effect.id).enabled = True
    for name, values in effect.presets.items():
        path = tmp_path / "strata" / effect.id / f"{name}.py"
        assert bpy.ops.strata.take_preset(filepath=str(path)) == {"FINISHED"}
        expected = effect.params.checked(effect.id, values).as_dict()
        taken = options_of(scene).chosen()[effect].as_dict()
        assert taken.keys() == expected.keys()
        for name, value in expected.items():  # properties are float32
            close = isinstance(value, (float, list))
            assert taken[name] == (pytest.approx(value, rel=1e-6) if close else value), name


def test_a_preset_can_be_added_and_removed(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(bpy.utils, "user_resource", lambda *_, **__: str(tmp_path))
    scene.strata.soft_shadow.layers = 7
    bpy.ops.strata.soft_shadow_preset_add(name="Mine")
    assert "settings.layers = 7" in (tmp_path / "Mine.py").read_text()


def test_an_older_presets_settings_are_taken_but_those_that_are_gone(scene, tmp_path):
    name = next(thing.name for thing in scene.objects if thing.type == "LIGHT")
    (tmp_path / "toon").mkdir()
    path = tmp_path / "toon" / "Mine.py"
    toon = scene.strata.toon
    for key, found in (("", None), (name, name), ("Nobody", name)):
        path.write_text(
            "import bpy\n\nsettings = bpy.context.scene.strata.toon\n\nsettings.exposure = 1.5\n"
            f"settings.key_light = {key!r}\nsettings.gone = 3\nsettings.light = 'no such'\n"
            f"settings.rim_color = [0.0, 0.5, 1.0]\nsettings.outline_width_px = {len(key)}.5\n"
        )
        assert bpy.ops.strata.take_preset(filepath=str(path)) == {"FINISHED"}
        assert (toon.key_light.name if toon.key_light else None) == found
        assert (toon.exposure, *toon.rim_color, toon.outline_width_px) == (1.5, 0.0, 0.5, 1.0, len(key) + 0.5)
    path.write_text("settings.exposure = ")
    with pytest.raises(RuntimeError, match="cannot be read"):
        bpy.ops.strata.take_preset(filepath=str(path))


def test_a_lists_presets_are_taken_by_stratas_operator():
    for effect in EFFECTS:
        assert getattr(bpy.types, f"STRATA_PT_{effect.id}_presets").preset_operator == "strata.take_preset"
