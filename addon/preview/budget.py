"""How much of the work a frame gets while something moves."""

from __future__ import annotations

from dataclasses import dataclass

SCALES = (1.0, 0.5, 0.25, 0.125)
"""Pixels of the picture to one of the viewport, across and up."""

SCENE_SHARE = 0.5
"""Pixels may cost this share of what the maps cost, where those alone are over the budget: a coarser picture
would then hardly be faster."""

ROOM = 0.7
"""A finer scale is taken where it is predicted to cost less than this share of what it may."""


@dataclass
class Budget:
    """Picks `scale`, that of pixels, and `map_share`, that of maps and their reading.

    A finer picture costs with its pixels; what maps cost does not depend on them. Changing `map_share` makes
    every map anew, so it only changes between two interactions (`settle`).
    """

    level: int = 2
    map_level: int = 3
    was_slow: bool = True

    @property
    def scale(self) -> float:
        return SCALES[self.level]

    @property
    def map_share(self) -> float:
        return SCALES[self.map_level]

    def coarser(self, budget_ms: float, scene_ms: float, surface_ms: float) -> bool:
        """After a frame: takes the next coarser scale where pixels cost more than they may. One slow frame
        among others does not count: something else may have had the processor."""
        is_slow = surface_ms > self._allowed(budget_ms, scene_ms)
        was_slow, self.was_slow = self.was_slow, is_slow
        if not (is_slow and was_slow) or self.level == len(SCALES) - 1:
            return False
        self.level += 1
        return True

    def settle(self, budget_ms: float, scene_ms: float, surface_ms: float) -> None:
        """After an interaction, by what its frames cost on average: takes a finer scale where there is room,
        and map sizes likewise."""
        if self.level and 4.0 * surface_ms <= ROOM * self._allowed(budget_ms, scene_ms):
            self.level -= 1
        if scene_ms > budget_ms and self.map_level < len(SCALES) - 1:
            self.map_level += 1
        elif self.map_level and 4.0 * scene_ms <= ROOM * budget_ms:
            self.map_level -= 1

    @staticmethod
    def _allowed(budget_ms: float, scene_ms: float) -> float:
        return max(budget_ms - scene_ms, SCENE_SHARE * scene_ms)
