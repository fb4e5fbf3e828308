"""The report of a bake: what ran, how long it took, how wrong it is, and what was left out and why.

`Report.to_json` is what `--report` writes; report_text.py has the same for a person.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from ..core.graph import Graph, PlannedLayer
from ..core.memory import MemoryEstimate
from ..core.outline import Outline
from ..core.sequence import SequenceLayer
from ..core.version import VERSION
from . import target
from .target import Chosen, Target
from .verdict import Verdict, names_of, told, worded

SIGNIFICANT_DIGITS = 6


@dataclass(frozen=True)
class StepTime:
    """Seconds of one step, summed over its tiles and samples."""

    name: str
    instance: str
    device: str
    seconds: float

    def to_json(self) -> dict[str, Any]:
        return {**vars(self), "seconds": rounded(self.seconds)}


@dataclass(frozen=True)
class LayerError:
    """A layer's error (docs/accuracy.md); `seconds` is what measuring it took. Parts of `value`: `method`,
    what the effect gets wrong where it was evaluated, and `sampling`, the rest; `model`: what such a layer
    cannot hold; `display`: the same on a display. Only masks have `mean_absolute_error`. `probes_in_time`:
    for how many there was time, where nobody said how many; `unread`: what the upper end of `ci95` owes to
    surfaces whose opacity is not read. Where something of unknown extent is missing, `ci95` has no upper end,
    and `unknown` says what."""

    metric: str
    value: float
    ci95: tuple[float, float | None]
    bias: float
    p99: float
    max: float
    probes: int
    reference: str
    reference_noise: float
    seconds: float
    method: float | None = None
    sampling: float | None = None
    model: float | None = None
    display: float | None = None
    mean_absolute_error: float | None = None
    probes_in_time: int | None = None
    unread: float | None = None
    unknown: tuple[str, ...] = ()

    def __post_init__(self):
        """Raises ValueError where a figure is not finite."""
        self.to_json()

    def to_json(self) -> dict[str, Any]:
        numbers = {key: rounded(item) for key, item in vars(self).items() if isinstance(item, float)}
        plain = {**vars(self), **numbers, "unknown": list(self.unknown) or None}
        plain["ci95"] = [None if limit is None else rounded(limit) for limit in self.ci95]
        return {key: item for key, item in plain.items() if item is not None}


@dataclass(frozen=True)
class NotMeasured:
    """In place of a layer's error: `why` measuring it failed, one line. The layer itself is whole."""

    why: str

    def to_json(self) -> dict[str, Any]:
        return {"not_measured": self.why}


def error_of(entry: Mapping[str, Any] | None) -> LayerError | NotMeasured | None:
    """What `to_json` made of a layer's error, read back, of another version too, whose own figures are left
    out; None for a layer that nobody wanted measured."""
    if not entry:
        return None
    if "not_measured" in entry:
        return NotMeasured(entry["not_measured"])
    low, high = entry["ci95"]
    known = {key: item for key, item in entry.items() if key in LayerError.__dataclass_fields__}
    return LayerError(**{**known, "ci95": (low, high), "unknown": tuple(known.get("unknown", ()))})


@dataclass(frozen=True)
class LayerReport:
    """One layer. `seconds` are its own steps', `seconds_alone` what baking only it would have cost;
    `neutral`: the frame does not need it, but others of the sequence do; `verdict`: how much of a measured
    error is to be seen (verdict.py), empty for others; `lowered_by`: settings that lower it, where it may be
    seen; `words`: what a person is told of it, if anything; `joins`: not so where the picture takes the same
    from another effect; `role`: what it is to the picture (core/roles.py), and `pass_name` that of the lamp
    that it is of, which the compositor's nodes are built from; `error_image`: the name of that
    beside it, empty where there is none; `samples`: of each pixel, chosen for this layer where it was made
    `in_passes`, and `target` what it was to reach, with `target_words` where it did not; `audit`: what Cycles
    says of it (audit/score.py), where it was asked."""

    name: str
    effect: str
    light: str
    seconds: float
    seconds_alone: float
    non_finite: int
    error: LayerError | NotMeasured | None
    neutral: bool = False
    verdict: str = ""
    lowered_by: tuple[str, ...] = ()
    words: str = ""
    joins: bool = True
    role: str = ""
    pass_name: str = ""
    error_image: str = ""
    audit: Any = None
    samples: int = 0
    in_passes: bool = False
    target: Target | None = None
    target_words: str = ""

    def to_json(self) -> dict[str, Any]:
        plain = {key: rounded(item) if isinstance(item, float) else item for key, item in vars(self).items()}
        if self.error is None:
            del plain["error"]
        else:
            plain["error"] = self.error.to_json()
        if not self.neutral:
            del plain["neutral"]
        if self.joins:
            del plain["joins"]
        if not self.error_image:
            del plain["error_image"]
        if not self.in_passes:
            del plain["in_passes"]
        if not self.target_words:
            del plain["target_words"]
        del plain["verdict"], plain["lowered_by"], plain["words"], plain["audit"], plain["target"]
        if self.target is not None:
            plain["target"] = self.target.to_json()
        if self.audit is not None:
            plain["audit"] = self.audit.to_json()
        if self.verdict:
            plain |= {"verdict": self.verdict, "lowered_by": list(self.lowered_by)}
        return plain


@dataclass(frozen=True)
class Report:
    """`left_out`: pairs of what and why. `peak_mb`: the process's largest resident memory so far, MiB;
    `memory`: what was told of it before (MemoryEstimate.to_json, core/memory.py), None where nothing was;
    `baked`: what of materials was read as Blender bakes it; `target_error`: what layers were to reach, 0:
    nothing."""

    strata: str
    blender: str
    scene: str
    frame: int
    size: tuple[int, int]
    seed: int
    backend: str
    backend_reason: str
    seconds: float
    compile_seconds: float
    peak_mb: int
    steps: tuple[StepTime, ...]
    layers: tuple[LayerReport, ...]
    left_out: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]
    memory: MemoryEstimate | None = None
    baked: tuple[str, ...] = ()
    target_error: float = 0.0
    time_budget_s: float = 0.0
    placement: str = ""

    def to_json(self) -> dict[str, Any]:
        """Plain dicts, lists, strings and finite numbers."""
        return {
            **vars(self),
            "size": list(self.size),
            "seconds": rounded(self.seconds),
            "compile_seconds": rounded(self.compile_seconds),
            "target_error": rounded(self.target_error),
            "time_budget_s": rounded(self.time_budget_s),
            "steps": [step.to_json() for step in self.steps],
            "layers": [layer.to_json() for layer in self.layers],
            "left_out": [{"what": what, "reason": reason} for what, reason in self.left_out],
            "warnings": list(self.warnings),
            "baked": list(self.baked),
            "memory": self.memory.to_json() if self.memory else None,
        }


def rounded(value: float) -> float:
    """Six significant digits; JSON knows no infinity, so that what is not finite is an error here."""
    if not np.isfinite(value):
        raise ValueError(f"{value} has no place in a report")
    return float(f"{value:.{SIGNIFICANT_DIGITS}g}")


def report_of(
    *,
    outline: Outline,
    graph: Graph,
    backend: str,
    backend_reason: str,
    seed: int,
    seconds: float,
    compile_seconds: float,
    steps: Iterable[StepTime],
    images: Mapping[str, np.ndarray],
    costs: Mapping[str, tuple[float, float]],
    errors: Mapping[str, LayerError | NotMeasured],
    warnings: Sequence[str],
    memory: MemoryEstimate | None = None,
    neutral: Iterable[SequenceLayer] = (),
    order: Sequence[str] = (),
    error_images: Mapping[str, str] = MappingProxyType({}),
    samples: int = 0,
    chosen_samples: Mapping[str, Chosen] = MappingProxyType({}),
    target_error: float = 0.0,
    time_budget_s: float = 0.0,
    placement: str = "",
) -> Report:
    """Puts a bake's figures together. By layer name: `images`, `costs` (seconds, seconds alone), `errors` of
    the layers that were to be measured. `neutral` are layers
    that the sequence has and the graph does not make; `order` are the names of all as the file has them,
    which need not be the graph's; `error_images` are names of those, by layer, and `chosen_samples` what was
    chosen for a `target_error`; others have `samples`."""
    layers = [
        LayerReport(
            layer.name,
            layer.effect,
            layer.light,
            *costs[layer.name],
            _non_finite(images[layer.name]),
            errors.get(layer.name),
            joins=layer.joins,
            role=layer.role.value,
            pass_name=layer.pass_name,
            error_image=error_images.get(layer.name, ""),
            **_judged(layer, errors.get(layer.name)),
            **_sampled(layer, errors.get(layer.name), samples, chosen_samples.get(layer.name)),
        )
        for layer in graph.layers
        if layer.effect
    ]
    layers += (
        LayerReport(
            *(n.name, n.effect, n.light, 0.0, 0.0, 0, None),
            neutral=True,
            role=n.kind.role.value,
            pass_name=n.pass_name,
        )
        for n in neutral
    )
    places = {name: place for place, name in enumerate(order)}
    layers.sort(key=lambda layer: places.get(layer.name, len(places)))
    bpy = sys.modules.get("bpy")  # the Blender that this runs in, if it does; nothing here needs one
    return Report(
        strata=VERSION,
        blender=bpy.app.version_string if bpy else "",
        scene=outline.scene_name,
        frame=outline.frame,
        size=graph.shot.size,
        seed=seed,
        backend=backend,
        backend_reason=backend_reason,
        seconds=seconds,
        compile_seconds=compile_seconds,
        peak_mb=peak_mb(),
        steps=tuple(steps),
        layers=tuple(layers),
        left_out=tuple((left.what, left.reason) for left in graph.left_out),
        warnings=tuple(dict.fromkeys(warnings)),
        memory=memory,
        baked=outline.baked,
        target_error=target_error,
        time_budget_s=time_budget_s,
        placement=placement,
    )


def _judged(layer: PlannedLayer, error: LayerError | NotMeasured | None) -> dict[str, Any]:
    """What LayerReport says of an error: the verdict, and what lowers it if anything is to be seen."""
    if not isinstance(error, LayerError):
        return {}
    score, params = layer.kind.score, layer.params
    high = error.ci95[1]
    words = worded(score.rms(error.value), None if high is None else score.rms(high))
    if words == Verdict.INVISIBLE.value:
        return {"verdict": words}
    settings = score.lowered_by(params, error)
    sentence = told(error, layer.light, settings, type(params) if params is not None else None)
    return {"verdict": words, "lowered_by": settings, "words": sentence}


def _sampled(
    layer: PlannedLayer,
    error: LayerError | NotMeasured | None,
    samples: int,
    chosen: Chosen | None,
) -> dict[str, Any]:
    """What LayerReport says of a layer's samples."""
    if chosen is None:
        return {"samples": samples}
    params = layer.params
    advice = names_of(params.finer(), type(params)) if params is not None else ""
    words = target.told(chosen, error.method if isinstance(error, LayerError) else None, advice)
    return {"samples": chosen.samples, "in_passes": True, "target": chosen.target, "target_words": words}


def _non_finite(image: np.ndarray) -> int:
    """How many numbers are not finite. Where their sum is, all are, and a sum is quicker than a count."""
    with np.errstate(over="ignore", invalid="ignore"):
        whole = np.isfinite(np.add.reduce(image, axis=None))
    return 0 if whole else int(np.count_nonzero(~np.isfinite(image)))


def peak_mb() -> int:
    """The process's largest resident memory so far, MiB; 0 where the system does not say (Windows)."""
    try:
        # Not getrusage's figure: on Linux that survives exec, so a child starts with its parent's.
        with open("/proc/self/status", encoding="ascii", errors="replace") as status:
            kilobytes = next(line.split()[1] for line in status if line.startswith("VmHWM:"))
        return round(int(kilobytes) / 1024)
    except (OSError, StopIteration):
        pass
    try:
        import resource
    except ImportError:
        return 0
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)  # bytes on macOS
