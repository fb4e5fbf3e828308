"""Measures each layer of a graph once it is finished."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import replace

from ..core.errors import Cancelled, one_line
from ..core.random import hash_bits, text_bits
from ..core.slices import timed
from .budget import DEFAULT_PROBES, at_pace, within
from .error_image import ErrorImage
from .footprint import Probed
from .report import LayerError, NotMeasured
from .watch import Watch, probes_of

BESIDES, PROBE = 0.4, 7.0
"""Of the seconds that drawing watched pixels took, what measuring takes whatever the number of probes; and of
one such pixel's, what a probe takes: measured with shadows of five lamps."""


class Measurement:
    """Measures layers that have a score.

    `probes`: how many pixels of a layer get the slow reference, None for as many as there is time for;
    `cancelled`: what devices raise when they are cancelled. Whatever else goes wrong is told in place of the
    error: measuring never costs a layer.
    """

    def __init__(self, probes: int | None, seed: int, cancelled: tuple[type[Exception], ...] = ()):
        self.has_budget = probes is None
        self.probes, self.seed = DEFAULT_PROBES if probes is None else probes, seed
        # GeneratorExit: whoever ran it has gone. A panic of the kernels is a BaseException too.
        self._passes_through = (Cancelled, KeyboardInterrupt, SystemExit, GeneratorExit, *cancelled)

    def guarded[Result](
        self, work: Generator[None, None, Result]
    ) -> Generator[None, None, Result | NotMeasured]:
        """The same, which returns why where it fails."""
        try:
            return (yield from work)
        except self._passes_through:
            raise
        except BaseException as error:
            return NotMeasured(one_line(error))

    def measure(
        self,
        probed: Probed,
        allowed_seconds: float = math.inf,
        expect: Callable[[float], None] = lambda seconds: None,
    ) -> Generator[None, None, LayerError | NotMeasured]:
        """One finished layer's error; yields between slices of work. `allowed_seconds`: what there is time
        for, where the number of probes was left open, and `expect` is told how long it still takes."""
        layer = probed.layer
        seed = int(hash_bits(self.seed, text_bits(layer.name)))

        def measuring(probes: int):
            return layer.kind.score.measure(probed, probes, seed)

        if not self.has_budget:
            error, seconds = yield from timed(measuring(self.probes))
        else:
            work = within(measuring, allowed_seconds, expect=expect)
            if (watch := probed.watched) is not None and watch.seconds:
                pace = BESIDES * watch.seconds, PROBE * watch.seconds / max(len(watch.pixels), 1)
                work = at_pace(measuring, allowed_seconds, *pace, expect=expect)
            (error, probes), seconds = yield from timed(work)
            error = replace(error, probes_in_time=probes)
        return replace(error, seconds=seconds)

    def again(self, probed: Probed, error: LayerError) -> Generator[None, None, LayerError]:
        """The error of the same layer by as many probes, with other rays."""
        layer = probed.layer
        seed = int(hash_bits(self.seed, text_bits(layer.name), 2))
        probes = error.probes_in_time or self.probes
        found, seconds = yield from timed(layer.kind.score.measure(probed, probes, seed))
        return replace(found, seconds=error.seconds + seconds)

    def watch(self, probed: Probed, samples: int) -> Generator[None, None, Watch | float]:
        """Pixels of a layer that has so many samples and gets more, with rays of their own; of one whose
        score watches none, its error, root mean square. How many there are does not depend on the clock."""
        score = probed.layer.kind.score
        seed = int(hash_bits(self.seed, text_bits(probed.layer.name), 3))
        probes = probes_of(probed.image.shape[0] * probed.image.shape[1], score.probe_seconds)
        if hasattr(score, "watch"):
            return (yield from score.watch(probed, probes, samples, seed))
        error = yield from score.measure(probed, probes, seed)
        return score.rms(error.value)

    def error_image(self, probed: Probed, show: Callable[[int], None]) -> Generator[None, None, ErrorImage]:
        """How far one finished layer is off at each pixel; yields alike. `show` is told of pixels done."""
        layer = probed.layer
        seed = int(hash_bits(self.seed, text_bits(layer.name), 1))
        image, seconds = yield from timed(layer.kind.score.error_image(probed, seed, show))
        return replace(image, seconds=seconds)
