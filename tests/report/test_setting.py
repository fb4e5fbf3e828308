"""What is swept follows from what effects declare."""

from __future__ import annotations

from strata.addon.effects.registry import EFFECTS
from strata.addon.report.setting import BASE_SAMPLES, OURS, sweep

SOFT = EFFECTS.named("soft_shadow")


def curves_of(**values) -> dict[str, list[float]]:
    params = SOFT.params.checked("soft_shadow", values)
    found: dict[str, list[float]] = {}
    for setting in sweep({SOFT: params}, (1, 4)):
        found.setdefault(setting.curve, []).append(setting.step)
    return found


def test_samples_then_choices_then_numbers_that_count():
    found = curves_of(method="bitmask")
    assert list(found)[:1] == ["as the scene has it"]
    assert found["as the scene has it"] == [1, 4]
    assert found["soft_shadow.method=rays"] == [1, 4]
    assert "soft_shadow.method=bitmask" not in found  # that is as the scene has it
    assert found["soft_shadow.resolution"] == [256, 512, 1024, 2048, 4096]
    assert "soft_shadow.sample_rays" not in found
    assert "soft_shadow.gradient_scale" not in found  # it trades no time for error


def test_numbers_of_another_method():
    found = curves_of(method="rays", sample_rays=2)
    assert found["soft_shadow.sample_rays"] == [1, 2, 4, 8]
    assert "soft_shadow.resolution" not in found


def test_every_setting_has_a_key_of_its_own():
    chosen = {effect: effect.params() for effect in EFFECTS}
    settings = sweep(chosen)
    assert len({setting.key for setting in settings}) == len(settings)
    for setting in settings:
        assert setting.who == OURS
        assert setting.counted == "samples" or setting.samples == BASE_SAMPLES
        for effect, values in setting.nested().items():
            EFFECTS.named(effect).params.checked(effect, values)
