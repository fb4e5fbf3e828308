"""The preview's figures, written into a corner of the viewport."""

from __future__ import annotations

import blf

from ..measure.verdict import Verdict, advice, percent, verdict
from .viewport import Statistics

FONT, SIZE, LINE, MARGIN = 0, 11, 16, 12
COLOUR, SHADOW = (1.0, 1.0, 1.0, 0.9), (0.0, 0.0, 0.0, 0.8)


def lines(statistics: Statistics) -> list[str]:
    """What is on screen, what it cost, how noisy it is."""
    if statistics.message:
        return [f"Strata: {statistics.message}"]
    if statistics.samples:
        state = "converged" if statistics.is_converged else "refining"
        first = f"{state}, {statistics.samples} of {statistics.of_samples} samples"
    else:
        first = f"{statistics.frame_ms:.0f} ms, 1/{round(1.0 / statistics.scale)} resolution"
    found = [f"Strata: {first}"]
    if statistics.noise is not None:
        found.append(_told_noise(statistics))
    return found


def _told_noise(statistics: Statistics) -> str:
    """How much, how much of it is to be seen, and what takes it away. A picture that is still being refined
    gets better by itself."""
    found = verdict(statistics.noise)
    words = f"noise {percent(statistics.noise)}, {found.value}"
    if statistics.is_converged and found is not Verdict.INVISIBLE:
        words += f": {advice(('samples',))}"
    return words


def draw(statistics: Statistics, height: int, scale: float, left: int) -> None:
    """Below the top left corner of a region, `left` pixels in; `scale` is the interface's."""
    blf.size(FONT, SIZE * scale)
    blf.enable(FONT, blf.SHADOW)
    blf.shadow(FONT, 3, *SHADOW)
    blf.color(FONT, *COLOUR)
    y = height - 2.0 * (MARGIN + LINE) * scale
    for text in lines(statistics):
        y -= LINE * scale
        blf.position(FONT, left + MARGIN * scale, y, 0.0)
        blf.draw(FONT, text)
    blf.disable(FONT, blf.SHADOW)
