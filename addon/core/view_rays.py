"""View rays: where a pixel's sample looks, and what it sees there. References are asked along them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .shot import Shot
from .view import View


@dataclass(frozen=True)
class ViewRays:
    """N rays from the camera of `shot`.

    `pixels` (N, 2) int32: column and row in the computed image, row 0 at the bottom; `jitter` (N, 2) float64:
    from that pixel's centre, in pixels. `origins` (N, 3) float64, world space, metres: the eye, or for an
    orthographic view a point of its plane; `directions` (N, 3) float64, unit. `distances` (N,) float64,
    metres along them to the first surface, infinite where there is none. `surface`: the graph's surface
    attributes there (core/surface.py), (N,) or (N, channels) each; positions are relative to the eye.
    """

    pixels: np.ndarray
    jitter: np.ndarray
    origins: np.ndarray
    directions: np.ndarray
    distances: np.ndarray
    surface: dict[str, np.ndarray]
    shot: Shot

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def hits(self) -> np.ndarray:
        """(N,) bool: which see a surface. A holdout is none, though no ray goes on behind it."""
        hit = np.isfinite(self.distances)
        ids = next((self.surface[name] for name in ("material", "instance") if name in self.surface), None)
        return hit if ids is None else hit & (ids >= 0)


def lines_of_sight(
    view: View, size: tuple[int, int], pixels: np.ndarray, jitter: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (N, 3) float64 in world axes, origins relative to the eye; a direction has
    length 1 along the view's forward axis, so that its parameter is the depth. `size`: width and height of
    the image that `pixels` (N, 2) and `jitter` (N, 2) are of."""
    left, right, bottom, top = view.window
    steps = (right - left) / size[0], (top - bottom) / size[1]
    at = np.array([left, bottom]) + (np.asarray(pixels, np.float64) + 0.5 + jitter) * steps
    across = at[:, :1] * np.array(view.right) + at[:, 1:] * np.array(view.up)
    forward = np.broadcast_to(np.array(view.forward, np.float64), across.shape)
    if view.orthographic:
        return across, forward
    return np.zeros_like(across), across + forward


def view_rays(shot: Shot, pixels: np.ndarray, jitter: np.ndarray, surface: dict[str, np.ndarray]) -> ViewRays:
    """The shot's view rays that see `surface`, which has "depth" or "position"."""
    view = shot.view
    jitter = np.broadcast_to(np.asarray(jitter, np.float64), (len(pixels), 2))
    origins, directions = lines_of_sight(view, shot.computed_size, pixels, jitter)
    if "depth" in surface:
        depth = surface["depth"].astype(np.float64)
    else:
        position = surface["position"].astype(np.float64)
        depth = position @ np.array(view.forward)
        depth[~position.any(axis=1)] = np.inf
    lengths = np.linalg.norm(directions, axis=1)
    return ViewRays(
        np.asarray(pixels, np.int32),
        jitter,
        origins + np.array(view.eye),
        directions / lengths[:, None],
        depth * lengths,
        surface,
        shot,
    )
