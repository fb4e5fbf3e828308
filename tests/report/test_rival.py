"""How a rival's shadow is read from its light."""

from __future__ import annotations

import numpy as np
import pytest
from strata.addon.core.errors import StrataError
from strata.addon.report.rivals.registry import RIVALS, named
from strata.addon.report.rivals.rival import factor

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
