"""How many samples the layers of a sequence have where they have a target error: the same in all of its
frames, or their noise would flicker."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from .bake import BakeJob, read_job
from .core.errors import Cancelled, one_line
from .job import run_to_end
from .measure.target import missed_in, samples_in, told_missed
from .planning import Options

STAGE = "Choosing samples"


def looked_at(first: int, last: int) -> list[int]:
    """Frames of a range that samples are chosen by: its ends and its middle."""
    return sorted({first, (first + last) // 2, last})


def sequence_samples(
    scene,
    view_layer,
    options_of: Callable[[Any], Options],
    frames: Sequence[int],
    camera=None,
    size=None,
    show: Callable[[float, str], None] | None = None,
    warn: Callable[[str], None] = lambda _: None,
) -> dict[str, int]:
    """By layer's name the most samples that some frames of the scene's range need: the same ones whichever
    `frames` are baked, so that machines that make other chunks choose alike. Empty where the first frame that
    is baked may choose for all: of a scene that cannot change, or where a time is set, which is a frame's;
    and where a single one is baked, since others would cost more than it. What else there is is as in
    `read_job`; `show` is told the share done, and may raise to stop; `warn` is told of a frame that no
    samples could be chosen by, and of layers that miss their targets there where nothing is measured
    afterwards. Only on the main thread.
    """
    from .scene.changing import may_change

    first, last = scene.frame_start, max(scene.frame_start, scene.frame_end)
    if len(set(frames)) < 2 or first == last or not may_change(scene):
        return {}

    def asked(scene) -> Options:
        return replace(options_of(scene), probes=0, lit=False, composite=False, error_images=False)

    options = options_of(scene)
    if options.time_budget_s or (options.own_targets == {} and not options.aim):
        return {}  # told without reading anything
    found: dict[str, int] = {}
    missed: dict[int, list[str]] = {}
    looked = looked_at(first, last)
    for number, frame in enumerate(looked):

        def show_all(share: float, stage: str = "", left: float | None = None, number=number) -> None:
            if show:
                show((number + share) / len(looked), STAGE)

        show_all(0.0)
        try:
            job = read_job(scene, view_layer, asked, frame, camera, size, show_all)
            if job.options.time_budget_s:
                return {}
            if not _is_aimed(job):
                continue
            report = run_to_end(job, show=show_all).layers.report
        except Cancelled:
            raise
        except Exception as error:  # its own bake may yet succeed
            warn(f"no samples are chosen by frame {frame}: {one_line(error)}")
            continue
        missed[frame] = missed_in(report)
        for name, samples in samples_in(report).items():
            found[name] = max(found.get(name, 0), samples)
    if options.probes == 0 and (words := told_missed(missed)):  # else the frames' own bakes tell
        warn(words)
    return found


def _is_aimed(job: BakeJob) -> bool:
    return any(map(job.options.target_of, job.graph.layers))
