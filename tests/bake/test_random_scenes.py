"""Whatever is in a file, a bake writes all of it or says in one line why not.

The scenes drawn are the same in every run. To look further: STRATA_RANDOM_SCENES=5000 draws that many others.
"""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from strata.tests.bake.kept_scenes import KEPT
from strata.tests.bake.random_recipes import RECIPES
from strata.tests.bake.random_scene_check import problems_of
from strata.tests.support.gpu_scenes import gpu_device

COUNT = 300
MORE = int(os.environ.get("STRATA_RANDOM_SCENES", 0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    gpu_device()
    return tmp_path_factory.mktemp("random")


@settings(
    max_examples=MORE or COUNT,
    derandomize=not MORE,
    database=None,
    deadline=None,
    phases=[Phase.generate, Phase.shrink],
    suppress_health_check=list(HealthCheck),
)
@given(RECIPES)
def test_any_scene_bakes_whole_or_is_refused_in_one_line(folder, recipe):
    assert problems_of(recipe, folder) == []


@pytest.mark.parametrize("name", KEPT)
def test_scenes_that_once_failed(folder, name):
    assert problems_of(KEPT[name], folder) == []
