"""How many probes there is time for."""

import pytest
from strata.addon.core.slices import finished
from strata.addon.measure import budget
from strata.addon.measure.budget import DEFAULT_PROBES, SHARE, allowed_seconds, at_pace, within


class Clock:
    """Measuring whose seconds are known; `once` are those of what the first run makes for all."""

    def __init__(self, monkeypatch, per_probe: float, once: float = 0.0):
        self.per_probe, self.once, self.runs = per_probe, once, []
        monkeypatch.setattr(budget, "timed", self.timed)

    def work(self, probes: int):
        self.runs.append(probes)
        return probes
        yield

    def timed(self, work):
        probes = yield from work
        return probes, probes * self.per_probe + (self.once if len(self.runs) == 1 else 0.0)

    @property
    def seconds(self) -> float:
        return self.once + self.per_probe * sum(self.runs)


def test_measuring_is_a_share_of_the_whole():
    assert allowed_seconds(8.5) == pytest.approx(SHARE * 10.0)
    assert allowed_seconds(0.01) == pytest.approx(SHARE * 2.0)


@pytest.mark.parametrize("per_probe", [1e-5, 1e-4, 5e-4, 2e-3, 5e-3])
@pytest.mark.parametrize("once", [0.0, 0.3])
def test_as_many_probes_as_fit_are_taken(monkeypatch, per_probe, once):
    clock = Clock(monkeypatch, per_probe, once)
    told = []  # when, and how long it would still take
    result, probes = finished(
        within(clock.work, 1.0, expect=lambda seconds: told.append((clock.seconds, seconds)))
    )
    assert result == probes == clock.runs[-1]
    assert len(told) == (probes >= 128) + (probes > 128)
    # The first pilots cannot tell what is done once from what each probe takes.
    known = told[1:] if once else told
    assert all(when + left == pytest.approx(clock.seconds) for when, left in known)
    assert clock.seconds <= 1.0
    more = clock.seconds + per_probe * 2 * probes
    assert probes == DEFAULT_PROBES or more > 1.0 or probes < 128
    if per_probe == 1e-5:
        assert probes == DEFAULT_PROBES


def test_some_probes_are_taken_whatever_they_cost(monkeypatch):
    clock = Clock(monkeypatch, 1.0, once=5.0)
    assert finished(within(clock.work, 0.1)) == (32, 32)
    assert clock.runs == [8, 32]
    clock.runs.clear()
    assert finished(within(clock.work, -3.0)) == (32, 32)
    assert clock.runs == [32]  # none to find out what more would take


@pytest.mark.parametrize(
    ("seconds", "each", "probes"),
    [(1.0, 1e-3, 512), (1.0, 1e-6, DEFAULT_PROBES), (0.1, 1.0, 32), (-1.0, 1e-3, 32)],
)
def test_where_the_pace_is_known_there_are_no_pilots(monkeypatch, seconds, each, probes):
    clock, told = Clock(monkeypatch, each), []
    found = finished(at_pace(clock.work, seconds, 0.2, each, expect=told.append))
    assert found == (probes, probes)
    assert clock.runs == [probes]
    assert told == [pytest.approx(0.2 + probes * each)]
