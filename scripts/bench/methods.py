"""What is raced: the soft shadow effect at its settings, and plain rays; all that each needs is counted."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
import strata_kernels
from strata.addon.core.executor import Executor
from strata.addon.core.sampling import Sampling
from strata.addon.effects.shared import terminator
from strata.tests.support.executing import drain

from .scenes import Case

COMMON_STEPS = ("geometry", "surface")
"""What every method needs alike: the scene's meshes on the device, and the points that the camera sees."""


@dataclass
class Effect:
    """The soft shadow effect through the executor that bakes use, caches empty, one sample a pixel centre."""

    case: Case
    values: dict
    visibility: np.ndarray = field(init=False)

    def __call__(self) -> dict[str, float]:
        """Seconds by step, a bake's coarse picture among them, and `total` of all but the common ones."""
        geometry = self.case.device.geometry()
        started = time.perf_counter()
        graph = self.case.planned_closely(geometry, self.values)
        seconds = {"coarse_picture": time.perf_counter() - started}
        executor = Executor(self.case.device, self.case.device)
        drain(executor.run(graph, Sampling(*graph.shot.size, 1, graph.shot.pixel_filter)))
        for timing in executor.execution.timings.values():
            name = timing.node.step.name.removeprefix("soft_shadow/")
            seconds[name] = seconds.get(name, 0.0) + timing.seconds
        executor.release()
        (self.visibility,) = executor.execution.images.values()
        return seconds | {"total": sum(s for name, s in seconds.items() if name not in COMMON_STEPS)}


@dataclass
class Surface:
    """The points of a frame's pixel centres, flat. `position` is relative to the case's eye; `lifts`: where
    rays begin (effects/shared/terminator.py), None: there."""

    position: np.ndarray
    geometric_normal: np.ndarray
    shading_normal: np.ndarray
    lifts: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, chosen) -> Surface:
        parts = (*self.points, *([] if self.lifts is None else [self.lifts]))
        return Surface(*(np.ascontiguousarray(part[chosen]) for part in parts))

    @property
    def points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.position, self.geometric_normal, self.shading_normal


def surface_of(case: Case) -> tuple[Surface, np.ndarray]:
    """What the camera sees at pixel centres, and where that is anything, (height, width) bool."""
    names = ["position", "geometric_normal", "shading_normal", "depth", *terminator.READ]
    width, height = case.graph.shot.size
    everything = np.ones(len(case.outline.instances), np.uint8)
    found = strata_kernels.raster_surface(
        case.device.geometry(), everything, case.graph.shot.view.packed(), width, height, attributes=names
    )
    offsets, lifts = terminator.offsets_of(case.outline), None
    if offsets is not None:
        lifts = terminator.lifts_of(found, offsets, np.arange(width * height))
    points = (found[name].reshape(-1, 3) for name in names[:3])
    return Surface(*points, lifts), np.isfinite(found["depth"])


@dataclass
class Rays:
    """Strata's own rays at every pixel: a hierarchy over the light's casters, then `samples` a point."""

    case: Case
    surface: Surface
    samples: int
    visibility: np.ndarray = field(init=False)
    weight: np.ndarray = field(init=False)

    def __call__(self) -> dict[str, float]:
        geometry = self.case.device.geometry()
        started = time.perf_counter()
        accelerator = accelerator_of(self.case, geometry)
        built = time.perf_counter()
        self.visibility, self.weight = traced(self.case, accelerator, self.surface, self.samples, seed=1)
        done = time.perf_counter()
        return {"build": built - started, "rays": done - built, "total": done - started}


def accelerator_of(case: Case, geometry=None) -> strata_kernels.Accel:
    """Over the casters of the case's only layer."""
    (layer,) = case.graph.layers
    geometry = case.device.geometry() if geometry is None else geometry
    return strata_kernels.Accel(geometry, case.eye, case.device.instance_mask(layer.casters))


def traced(
    case: Case, accelerator, surface: Surface, samples: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Visibility and unshadowed irradiance at radiance 1, (N,) float32, of the case's only layer."""
    (layer,) = case.graph.layers
    emitter = case.outline.lights[layer.of.index].emitter
    return strata_kernels.ray_visibility(
        accelerator, None, emitter.packed(), case.eye, *surface.points, samples, seed, lifts=surface.lifts
    )
