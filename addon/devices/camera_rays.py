"""What the camera sees between and beside pixel centres, by rays and in float64: the surface that
supersampled references are asked at, made without the rasteriser."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.shot import Shot
from ..core.view_rays import ViewRays, lines_of_sight, view_rays


@dataclass(frozen=True, eq=False)
class CameraRays:
    """Traces view rays against the instances `visible` (instances,) uint8 and fills the surface `attributes`,
    with the conventions of core/surface.py."""

    shot: Shot
    visible: np.ndarray
    attributes: frozenset[str]

    def look(
        self, kernels: Any, accel: Any, cancel_flag: Any, pixels: np.ndarray, jitter: np.ndarray
    ) -> ViewRays:
        """Rays through `pixels` (N, 2), `jitter` (N, 2) pixels beside their centres, traced in `accel`."""
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
            sorted(self.attributes),
            cancel=cancel_flag,
        )
        return view_rays(self.shot, pixels, jitter, surface)
