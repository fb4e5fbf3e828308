"""Who the rivals are, and how their shadows are read."""

from __future__ import annotations

import json

import numpy as np
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.report.rivals.embree import reversed_bits, scrambled, sobol
from strata.addon.report.rivals.registry import RIVALS, named
from strata.addon.report.rivals.rival import factor
from strata.ops.cli import main
from strata.tests.support.places import SAMPLES

LUMINANCE = np.array([0.2, 0.7, 0.1])


def test_a_shadow_is_light_over_light():
    bare = np.array([[[2.0, 1.0, 4.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]])
    shadowed = np.array([[[1.0, 0.5, 0.0], [0.0, 0.0, 0.0], [1.5, 1.5, 1.5]]])
    grey = factor(shadowed, bare, LUMINANCE, in_colour=False)
    assert grey == pytest.approx(np.array([[0.55 / 1.5, 1.0, 1.0]]))
    assert factor(shadowed, bare, LUMINANCE, in_colour=True)[0, 0] == pytest.approx([0.5, 0.5, 0.0])


def test_rivals_are_known_by_their_words():
    assert [rival.id for rival in named([rival.id for rival in RIVALS])] == [rival.id for rival in RIVALS]
    with pytest.raises(StrataError, match="no rival 'nobody'"):
        named(["nobody"])


def test_embrees_rays_give_the_same_picture(tmp_path):
    """In the same film, so that as many samples are as far off."""
    words = ["--size", "64x36", "--backend", "cpu", "--samples", "4,16", "--samples-only", "--repeats", "1"]
    words += ["--effects", "soft_shadow", "--rivals", "embree"]
    assert main(["report", str(SAMPLES / "stacked.blend"), "-o", str(tmp_path), *words]) == 0
    data = json.loads((tmp_path / "report.json").read_text())
    assert not data["warnings"]
    found = {(point["who"], point["samples"]): point for point in data["points"]}
    for samples in (4, 16):
        ours, its = (
            found[who, samples]["layers"]["Soft Shadow Panel"]["value"] for who in ("strata", "embree")
        )
        assert its == pytest.approx(ours, rel=0.1)  # other rays of the same kind
    assert 0.0 < found["embree", 4]["cpu_s"][1] < found["embree", 32]["cpu_s"][1]


def test_sobols_points_go_on_where_they_stopped():
    whole = sobol(0, 16)
    assert (np.concatenate([sobol(0, 4), sobol(4, 12)]) == whole).all()
    for first in range(0, 16, 4):  # a (0, 2)-sequence: one in each quarter, whichever way it is cut
        quarters = whole[first : first + 4] >> 30
        assert len(set(quarters[:, 0])) == len(set(quarters[:, 1])) == 4
        scrambles = np.arange(100, dtype=np.uint32)[:, None] * np.uint32(2654435761)
        each = reversed_bits(scrambled(reversed_bits(whole[first : first + 4, 0]), scrambles)) >> 30
        assert (np.sort(each, axis=1) == np.arange(4)).all()
