"""A run as a trace: what every node and stage took, when, and what bounds it (docs/trace.md).

The file is JSON in the trace event format that chrome://tracing and Perfetto read (complete events, "X").
"""

from __future__ import annotations

import os
import statistics
import threading
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..core.device import Device
from ..core.graph import Node, Rate
from ..core.observer import Observer, Span
from ..core.surface import Chunk
from .bandwidth import copy_bandwidth

COPIED_BYTES, COPIES = 64 << 20, 3
"""For the bandwidth: a tenth of a second. Large caches hold so much, which makes least times shorter."""

HALF = 0.5
ONE_CORE, FREE_SHARE = 1.25, 0.75
"""Work is called that of one core up to so many, where that is less than this share of the cores that others
leave it."""

STAGES = "stages"

BUDGETS_MS = 33.0, 16.6, 11.1  # 30, 60 and 90 frames a second
BUDGET = "budget_ms"
"""What a stage is told that is to take no longer."""
PYTHON = "between nodes"


@dataclass(frozen=True)
class Machine:
    """Copies' bytes/s read and written, the cores that it may use, and how many of those others had
    meanwhile on the mean (None: not known)."""

    bandwidth: float
    cores: int
    others_cores: float | None = None

    @property
    def free_cores(self) -> float:
        return max(self.cores - (self.others_cores or 0.0), HALF)


@dataclass
class Work:
    """Seconds that passed, of all cores of the process, of the thread that began it (None where another
    ended it), waiting for a GPU (None of what no GPU did) and compiling shaders; bytes read and made."""

    seconds: float = 0.0
    cpu_s: float = 0.0
    caller_s: float | None = 0.0
    wait_s: float | None = None
    compile_s: float = 0.0
    read_bytes: int = 0
    made_bytes: int = 0

    def add(self, other: Work, sign: int = 1) -> None:
        """Of bytes and what a GPU did nothing is taken away: they are no stage's."""
        self.seconds += sign * other.seconds
        self.cpu_s += sign * other.cpu_s
        both = self.caller_s is not None and other.caller_s is not None
        self.caller_s = self.caller_s + sign * other.caller_s if both else None
        if sign > 0:
            self.read_bytes += other.read_bytes
            self.made_bytes += other.made_bytes
            self.compile_s += other.compile_s
            if other.wait_s is not None:
                self.wait_s = (self.wait_s or 0.0) + other.wait_s

    @property
    def cores_busy(self) -> float:
        return self.cpu_s / self.seconds if self.seconds > 0.0 else 0.0

    def least_s(self, machine: Machine) -> float:
        """In which the machine could move its bytes."""
        return (self.read_bytes + self.made_bytes) / machine.bandwidth

    def bound(self, machine: Machine) -> str:
        """What it waits for most, by the rule of docs/trace.md."""
        if self.compile_s >= HALF * self.seconds > 0.0:
            return "compiling"
        if self.wait_s is not None:
            return "GPU wait" if self.wait_s >= HALF * self.seconds else "draw calls"
        if self.least_s(machine) >= HALF * self.seconds:
            return "bytes"
        if self.cores_busy < HALF * min(machine.free_cores, 1.0):
            return "waiting"
        if self.caller_s is not None and self.caller_s >= HALF * self.cpu_s:
            return "Python"
        is_one = self.cores_busy < min(ONE_CORE, FREE_SHARE * machine.free_cores)
        return "one core" if is_one else "operations"


@dataclass
class Event:
    """What was done on a track from a moment of time.perf_counter on."""

    name: str
    track: str
    started: float
    work: Work
    args: dict[str, Any] = field(default_factory=dict)

    @property
    def ends(self) -> float:
        return self.started + self.work.seconds


class _Clock:
    """The moment at which it was made."""

    def __init__(self):
        self._thread = threading.get_ident()
        self._cpu_s, self._caller_s = time.process_time(), time.thread_time()
        self.started = time.perf_counter()

    def until(self, end: _Clock) -> Work:
        """What passed up to another's moment."""
        caller_s = end._caller_s - self._caller_s if end._thread == self._thread else None
        return Work(end.started - self.started, end._cpu_s - self._cpu_s, caller_s)


class Trace(Observer):
    """Listens from when it is made."""

    def __init__(self):
        self.events: list[Event] = []
        self._began = self._ended = time.perf_counter()
        self._before = time.process_time(), _all_cores_s()
        self._stage: tuple[str, _Clock, dict[str, Any]] | None = None

    def stage(self, name: str) -> None:
        self._stage = name, self._end_stage(), {}
        if not self.events:
            self._began = self._stage[1].started

    def tell(self, **args: Any) -> None:
        if self._stage is not None:
            self._stage[2].update(args)

    def end(self) -> None:
        """Of the last stage."""
        self._ended = self._end_stage().started
        self._stage = None

    def _end_stage(self) -> _Clock:
        """The moment at which the next begins: there is nothing between two."""
        now = _Clock()
        if self._stage is not None:
            name, began, args = self._stage
            self.events.append(Event(name, STAGES, began.started, began.until(now), args))
        return now

    def node(
        self, node: Node, device: Device, where: str, inputs: Sequence[Any] = (), chunk: Chunk | None = None
    ) -> Span:
        args = {"instance": node.instance} if node.instance else {}
        if chunk is not None and node.rate == Rate.SAMPLE:
            args |= {"tile": f"rows {chunk.y0} to {chunk.y1}", "sample": chunk.sample}
        event = Event(node.step.name, where, 0.0, Work(), args)
        return _Watched(self.events, event, device, inputs)

    @property
    def seconds(self) -> float:
        """From its beginning to the end of its last stage."""
        return self._ended - self._began

    def rows(self) -> list[tuple[str, str, int, Work]]:
        """Name, track, count and sum of each step and of each stage's own, without its nodes; those that took
        longest first. They add up to what was traced."""
        sums: dict[tuple[str, str], tuple[int, Work]] = {}
        for event in self.events:
            count, work = sums.setdefault((event.name, event.track), (0, Work()))
            work.add(event.work)
            sums[event.name, event.track] = count + 1, work
        for outer, inner in self.nested():
            sums[outer.name, outer.track][1].add(inner.work, -1)
        rows = [(*key, *each) for key, each in sums.items()]
        return sorted(rows, key=lambda row: -row[3].seconds)

    def _machine(self) -> Machine:
        """As it was from the beginning up to now."""
        cpu_s, all_s = self._before
        others = None
        if all_s is not None and (now_s := _all_cores_s()) is not None:
            passed = time.perf_counter() - self._began
            others = max(now_s - all_s - (time.process_time() - cpu_s), 0.0) / max(passed, 1e-9)
        return Machine(copy_bandwidth(COPIED_BYTES, COPIES), os.process_cpu_count() or 1, others)

    def nested(self) -> list[tuple[Event, Event]]:
        """Each event that lies in another, behind the innermost one that it lies in. One thing is done at a
        time, so tracks do not matter."""
        pairs, around = [], []
        for event in sorted(self.events, key=lambda event: (event.started, -event.ends)):
            while around and around[-1].ends < event.ends:
                around.pop()
            if around:
                pairs.append((around[-1], event))
            around.append(event)
        return pairs

    def to_json(self, **told: Any) -> dict[str, Any]:
        """The file's content; `told` of the run as a whole."""
        machine = self._machine()
        tracks = list(dict.fromkeys([STAGES, *(event.track for event in self.events)]))
        names = [{"name": "process_name", "ph": "M", "pid": 1, "args": {"name": "Strata"}}]
        names += [
            {"name": "thread_name", "ph": "M", "pid": 1, "tid": number, "args": {"name": track}}
            for number, track in enumerate(tracks)
        ]
        events = [
            {
                "name": event.name,
                "cat": "stage" if event.track == STAGES else "node",
                "ph": "X",
                "ts": 1e6 * (event.started - self._began),
                "dur": 1e6 * event.work.seconds,
                "pid": 1,
                "tid": tracks.index(event.track),
                "args": event.args | _told(event.work, machine),
            }
            for event in sorted(self.events, key=lambda event: event.started)
        ]
        summary = [
            {"name": name, "where": track, "count": count, "seconds": work.seconds}
            | {"share": work.seconds / self.seconds if self.seconds else 0.0}
            | _told(work, machine)
            for name, track, count, work in self.rows()
        ]
        other = {"seconds": self.seconds, "cores": machine.cores, "others_cores": machine.others_cores}
        other |= {"copied_bytes_per_s": machine.bandwidth, **told, "summary": summary}
        if frames := frames_of(self, machine):
            other["frames"] = frames
        return {"traceEvents": names + events, "displayTimeUnit": "ms", "otherData": other}


def frames_of(trace: Trace, machine: Machine) -> dict[str, Any]:
    """Of stages that were told a budget (a preview's frames): how many, how many took longer than each of
    BUDGETS_MS, and of those that missed their own, by what took most of them: how many, and its milliseconds
    on the mean. Empty where there were none."""
    frames = [event for event in trace.events if BUDGET in event.args]
    if not frames:
        return {}
    parts = {id(frame): {PYTHON: replace(frame.work)} for frame in frames}
    for outer, inner in trace.nested():
        if (own := parts.get(id(outer))) is not None:
            own.setdefault(inner.name, Work()).add(inner.work)
            own[PYTHON].add(inner.work, -1)
    ms = [1e3 * frame.work.seconds for frame in frames]
    late = [frame for frame, each in zip(frames, ms, strict=True) if each > frame.args[BUDGET]]
    why: dict[str, Work] = {}
    counts: Counter[str] = Counter()
    for frame in late:
        name, work = max(parts[id(frame)].items(), key=lambda part: part[1].seconds)
        why.setdefault(name, Work()).add(work)
        counts[name] += 1
    return {
        "count": len(frames),
        "median_ms": statistics.median(ms),
        "longer": {f"{budget:g} ms": sum(each > budget for each in ms) for budget in BUDGETS_MS},
        "late": len(late),
        "why": [
            {"what": name, "frames": count, "ms": 1e3 * why[name].seconds / count, "bound": bound}
            for name, count in counts.most_common()
            for bound in [why[name].bound(machine)]
        ],
    }


def _all_cores_s() -> float | None:
    """What all programs have had of this machine's cores so far; None where nobody tells, or where that is of
    more cores than this process may use."""
    try:
        lines = Path("/proc/stat").read_text().splitlines()
    except OSError:
        return None
    cores = sum(line.startswith("cpu") for line in lines) - 1  # the first line is their sum
    if cores != os.process_cpu_count():
        return None
    user, nice, system, _idle, _waiting, *rest = map(int, lines[0].split()[1:9])
    return (user + nice + system + sum(rest)) / os.sysconf("SC_CLK_TCK")


def _told(work: Work, machine: Machine) -> dict[str, Any]:
    """What was measured, and what follows from it."""
    told = {"cores_busy": round(work.cores_busy, 2), "cpu_s": work.cpu_s, "bound": work.bound(machine)}
    if work.caller_s is not None:
        told["caller_cpu_s"] = work.caller_s
    if work.wait_s is not None:
        told["gpu_wait_s"] = work.wait_s
    if work.compile_s:
        told["compile_s"] = work.compile_s
    if work.read_bytes + work.made_bytes:
        told |= {
            "read_bytes": work.read_bytes,
            "made_bytes": work.made_bytes,
            "least_s": work.least_s(machine),
        }
    return told


class _Watched(Span):
    """One node's."""

    def __init__(self, events: list[Event], event: Event, device: Device, inputs: Sequence[Any]):
        self._events, self._event, self._device = events, event, device
        event.work.read_bytes = sum(map(device.size_of, inputs))
        self._issued_at: float | None = None
        self._compiled_s = device.compile_seconds
        self._clock = _Clock()

    def issued(self) -> None:
        if "gpu" in self._event.track:
            self._issued_at = time.perf_counter()

    def ended(self, value: Any = None) -> None:
        event, work = self._event, self._clock.until(_Clock())
        event.started = self._clock.started
        work.compile_s = self._device.compile_seconds - self._compiled_s
        work.read_bytes, work.made_bytes = event.work.read_bytes, self._device.size_of(value)
        if self._issued_at is not None:
            work.wait_s = event.started + work.seconds - self._issued_at
        event.work = work
        self._events.append(event)
