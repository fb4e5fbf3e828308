"""A homogeneous medium: what of light it turns aside and what it takes, per metre. A fact of the scene, as a
material is (materials, the world and instances have one); what is made of it is the effects' own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Coefficients = tuple[float, float, float]


@dataclass(frozen=True)
class Medium:
    """`scattering` and `absorption` per metre for red, green and blue, in the working space; `anisotropy` is
    the mean cosine of Henyey and Greenstein's phase function: above 0 light goes on mostly as it went. The
    kernels have a twin."""

    scattering: Coefficients
    absorption: Coefficients
    anisotropy: float = 0.0

    @property
    def extinction(self) -> Coefficients:
        return tuple(s + a for s, a in zip(self.scattering, self.absorption, strict=True))

    @property
    def is_empty(self) -> bool:
        return not any(self.extinction)

    def packed(self) -> np.ndarray:
        """(7,) float64: scattering, extinction, anisotropy."""
        return np.array([*self.scattering, *self.extinction, self.anisotropy], np.float64)
