"""What the arrays of a scene keep of those before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from strata.addon.core.arrays import Arrays, Opacities, OpacityArrays, reusing


def leaves(*pictures: np.ndarray) -> Arrays:
    """Each as an opacity."""
    textures = {index: texels.copy() for index, texels in enumerate(pictures)}
    opacities = tuple(Opacities.of(OpacityArrays(texels=texels)) for texels in textures.values())
    return Arrays((), np.empty((0, 4, 4)), opacities, textures)


def test_opacities_share_the_textures_that_are_kept():
    kept, before, after = np.full((2, 2), 0.25), np.full((2, 2), 0.5), np.full((2, 2), 0.75)
    old, new = leaves(kept, before), leaves(after, kept)
    reused = reusing(new, old, (), [(0, 1), (1, 0)])
    assert reused.textures[1] is old.textures[0]
    assert reused.opacities[1].seen[0] is old.opacities[0].seen[0]
    assert reused.opacities[1].casts[1] is old.opacities[0].casts[1]
    assert reused.textures[0] is new.textures[0]
    assert reused.opacities[0].seen[0].texels is new.textures[0]
    assert reused.opacities[0].seen[0] is reused.opacities[0].casts[1]


def test_the_same_texels_with_another_threshold_are_another_opacity():
    old, new = leaves(np.zeros((1, 1))), leaves(np.zeros((1, 1)))
    clip = OpacityArrays(texels=new.textures[0], threshold=0.5)
    (sides,) = reusing(replace(new, opacities=(Opacities.of(clip),)), old, (), [(0, 0)]).opacities
    assert sides.seen[0].texels is old.textures[0]
    assert sides.seen[0].threshold == 0.5
