"""How a layer's error is scored: an object that its kind brings (core/effect.py)."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, Protocol

from .params import Params


class Score(Protocol):
    """What is made of a finished layer. addon/measure has those of what multiplies (InUseScore), of light
    that is added (LightScore) and of masks (MaskScore).

    `metric`: what its figure is called in reports; `probe_seconds`: what a probe takes on an ordinary
    machine, for the time left, and `pixel_seconds` a pixel of an error image.
    """

    metric: str
    probe_seconds: float
    pixel_seconds: float

    def measure(self, probed: Any, probes: int, seed: int) -> Generator[None, None, Any]:
        """A LayerError (measure/report.py), from about `probes` pixels of a layer (`Probed` in
        measure/footprint.py). Yields between slices of some hundredths of a second."""

    # A score may also have `watch(probed, probes, samples, seed)`, a generator of a Watch (measure/watch.py)
    # of about `probes` pixels; without one a bake with a target measures anew whenever samples have doubled.

    def error_image(self, probed: Any, seed: int, show: Callable[[int], None]) -> Generator[None, None, Any]:
        """An ErrorImage (measure/error_image.py); `show` is told of pixels as they are done. Yields alike."""

    def rms(self, value: float) -> float:
        """What an error of `value` amounts to as a root mean square difference, a share of the brightness."""

    def lowered_by(self, params: Params | None, error: Any) -> tuple[str, ...]:
        """Settings that lower the error, most useful first, as `--set` and `--samples` know them: a name, or
        `name=value` for a choice. `params`: the layer's own, None where it has none; `error`: its
        LayerError."""
