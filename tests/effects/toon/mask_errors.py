"""How wrong an antialiased mask is at its edges, against many more samples of the same steps at every pixel.

The report's own figure is by rays, at some pixels: it knows wrong steps too, this one knows every edge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from strata.addon.core.execution import Execution
from strata.addon.core.executor import Executor
from strata.addon.core.metrics import WRONG
from strata.addon.core.sampling import Sampling
from strata.addon.devices.cpu import CpuDevice
from strata.addon.measure.mask import SUPERSAMPLES
from strata.tests.support.executing import drain


@dataclass(frozen=True)
class EdgeError:
    """`edges`: share of the pixels whose SUPERSAMPLES samples are not all the same. Of these, `wrong` is the
    share that is off by more than WRONG in any channel, `far_off` by more than twice that, `mean` the mean
    absolute error over channels; `elsewhere`, the largest error of any other pixel."""

    edges: float
    wrong: float
    far_off: float
    mean: float
    elsewhere: float


def edge_errors(read, samples: list[int]) -> dict[tuple[str, int], EdgeError]:
    """By layer and number of samples; `read` is read_scene's outline, graph and arrays."""
    exact = _execution(read, SUPERSAMPLES)
    found = {}
    for count in samples:
        images = _execution(read, count).images
        for name, truth in exact.images.items():
            channels = truth.shape[2] if truth.ndim == 3 else 1
            edges = (exact.deviation[name].reshape(-1, channels) > 1e-6).any(axis=1)
            errors = np.abs(images[name].astype(np.float64) - truth).reshape(-1, channels)
            largest = errors.max(axis=1)
            found[name, count] = EdgeError(
                float(edges.mean()),
                float((largest[edges] > WRONG).mean()),
                float((largest[edges] > 2.0 * WRONG).mean()),
                float(errors[edges].mean()),
                float(largest[~edges].max(initial=0.0)),
            )
    return found


class _Watched(Execution):
    """Keeps `deviation`, by layer: each pixel's mean squared deviation of its samples from their mean."""

    def add(self, take, chunk, tile, weight):
        super().add(replace(take, has_squares=True), chunk, tile, weight)

    def finish(self, take):
        squares = self.films[take.name].squares()
        super().finish(take)
        self.deviation[take.name] = squares - self.images[take.name] ** 2


def _execution(read, samples: int) -> Execution:
    outline, graph, arrays = read
    device = CpuDevice()
    device.set_scene(outline, arrays)
    executor = Executor(device, device)
    execution = _Watched()
    execution.deviation = {}
    sampling = Sampling(*graph.shot.computed_size, samples, graph.shot.pixel_filter)
    drain(executor.run(graph, sampling, execution=execution))
    return execution
