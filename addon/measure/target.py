"""What a layer's error was to come down to, and whether it did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..core.naming import some_frames
from .verdict import percent


@dataclass(frozen=True)
class Target:
    """`error`: what it was to be, root mean square; `seen`: what it is by the pixels that decided (watch.py);
    `is_stuck`: more samples no longer lowered it; `is_late`: there was no time for more of them. Where
    samples were chosen before, `seen` is the reported error, and `least` the low end of its interval."""

    error: float
    seen: float
    is_stuck: bool = False
    is_late: bool = False
    least: float | None = None

    @property
    def reached(self) -> bool:
        """As far as one can tell."""
        return (self.seen if self.least is None else self.least) <= self.error

    def to_json(self) -> dict[str, Any]:
        error, seen = (float(f"{each:.4g}") for each in (self.error, self.seen))
        return {"error": error, "seen": seen, "reached": self.reached}


@dataclass(frozen=True)
class Chosen:
    """Of one layer: the `samples` that each pixel got, and the target that they are for, if there was any."""

    samples: int
    target: Target | None = None


def told(chosen: Chosen, method: float | None, advice: str) -> str:
    """Why a target was not reached, in one line; empty where it was. `method`: the part of the error that the
    method makes, None where it is not known; `advice`: what lowers that."""
    target = chosen.target
    if target is None or target.reached:
        return ""
    aim = f"{100.0 * target.error:.2g}%"
    count = f"{chosen.samples} samples" if chosen.samples > 1 else "one sample"
    if target.least is not None:
        return f"off by {percent(target.seen)}, target {aim}: {count} as chosen before, and not enough"
    off = f"by the pixels that decide off by {percent(target.seen)}, target {aim}: "
    lower = f": {advice}" if advice else ""
    if target.is_stuck and method is not None and method > target.error:
        return f"{off}the method cannot go below {percent(min(method, target.seen))}{lower}"
    if target.is_stuck:
        return f"{off}more than {count} do not lower it{lower}"
    if target.is_late:
        return f"{off}there was no time for more than {count}"
    return f"{off}{count} at most, and not enough"


def missed_in(report: Mapping[str, Any]) -> list[str]:
    """Names of layers that a report says did not come down to their target."""
    return [each["name"] for each in report["layers"] if not each.get("target", {"reached": True})["reached"]]


def told_missed(missed: Mapping[int, Sequence[str]]) -> str:
    """Of a sequence, by frame, the layers that did not: one line, empty where all did."""
    frames = [frame for frame, names in missed.items() if names]
    names = dict.fromkeys(name for frame in frames for name in missed[frame])
    if not frames:
        return ""
    count = f"{len(frames)} frame{'s' * (len(frames) > 1)}"
    return f"the target error is not reached in {count} ({some_frames(frames)}): {', '.join(names)}"


def samples_in(report: Mapping[str, Any]) -> dict[str, int]:
    """By layer's name what a report of one view layer says was chosen; empty where nothing was."""
    return {each["name"]: int(each["samples"]) for each in report["layers"] if each.get("in_passes")}
