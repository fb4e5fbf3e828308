"""What the camera sees between and beside pixel centres, by rays and in float64: the surface that
supersampled references are asked at, made without the rasteriser."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.shot import Shot
from ..core.surface import with_holes
from ..core.view_rays import ViewRays, lines_of_sight, view_rays


@dataclass(frozen=True, eq=False)
class CameraRays:
    """Traces view rays against the instances `visible` (instances,) uint8 and fills the surface `attributes`,
    with the conventions of core/surface.py. `seed`: of the surface's draws of what is partly opaque;
    `holdouts`: those of the instances that leave a hole."""

    shot: Shot
    visible: np.ndarray
    attributes: frozenset[str]
    seed: int = 0
    holdouts: frozenset[int] = frozenset()

    def look(
        self,
        kernels: Any,
        accel: Any,
        cancel_flag: Any,
        pixels: np.ndarray,
        jitter: np.ndarray,
        samples: np.ndarray | None = None,
    ) -> ViewRays:
        """Rays through `pixels` (N, 2), `jitter` (N, 2) pixels beside their centres, traced in `accel`. What
        is partly opaque is there as for the `samples` (N,) of the surface, or for each ray by chance."""
        view = self.shot.view
        lines = lines_of_sight(view, self.shot.computed_size, pixels, jitter)
        origins, directions = (np.ascontiguousarray(each) for each in lines)
        surface = kernels.rays_surface(
            accel,
            self.visible,
            origins,
            directions,
            (view.near, view.far),
            view.forward,
            sorted({*self.attributes, "instance"} if self.holdouts else self.attributes),
            draws=None if samples is None else self._draws(pixels, samples),
            cancel=cancel_flag,
        )
        surface = with_holes(surface, self.holdouts, self.attributes)
        return view_rays(self.shot, pixels, jitter, surface)

    def _draws(self, pixels: np.ndarray, samples: np.ndarray) -> np.ndarray:
        """(N, 4) uint32: seed, sample, column and row."""
        draws = np.empty((len(pixels), 4), np.uint32)
        draws[:, 0], draws[:, 1], draws[:, 2:] = self.seed, samples, pixels
        return draws
