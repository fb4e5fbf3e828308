"""How a layer's error is scored: an object that its kind brings (core/effect.py)."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, Any, Protocol

from .outline import Outline
from .params import Params
from .shot import Shot

if TYPE_CHECKING:
    from .graph import PlannedLayer


class Score(Protocol):
    """Which pixels of a layer are looked at, and what is made of them. addon/measure has those of a lamp's
    visibility (VisibilityScore), of light (LightScore) and of masks (MaskScore).

    `metric`: what its figure is called in reports; `probe_seconds`: what a probe takes on an ordinary
    machine, for the time left.
    """

    metric: str
    probe_seconds: float

    def watch(self, layer: PlannedLayer, outline: Outline, shot: Shot, attributes: tuple[str, ...]) -> Any:
        """What draws the layer's pixels (Watched in measure/probes.py); `attributes` are those that the
        graph's surface has."""

    def measure(self, probed: Any, probes: int, seed: int) -> Generator[None, None, Any]:
        """A LayerError (measure/report.py), from about `probes` of the pixels that were drawn (`Probed` in
        measure/probes.py). Yields between slices of some hundredths of a second."""

    def rms(self, value: float) -> float:
        """What an error of `value` amounts to as a root mean square difference, a share of the brightness."""

    def lowered_by(self, params: Params | None) -> tuple[str, ...]:
        """Settings that lower the error, most useful first, as `--set` and `--samples` know them: a name, or
        `name=value` for a choice. `params`: the layer's own, None where it has none."""
