"""The command line: `python -m strata ...`, and `blender -b SCENE.blend --command strata ...`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TextIO

from ..addon.core.errors import Cancelled, StrataError, one_line
from ..addon.core.naming import some_frames
from ..addon.measure.target import missed_in, samples_in, told_missed
from .arguments import build_parser, exr_values, nested, read_outputs
from .terminal import Interrupts, Progress, clean_stdout
from .tracing import Tracing

OK, BAD_INPUT, INTERRUPTED = 0, 2, 130


def main(words: Sequence[str] | None = None, in_blender: bool = False) -> int:
    """Runs one command; the exit code. `in_blender`: a file may be open already."""
    try:
        with clean_stdout() as out, Interrupts() as interrupts:
            arguments = _parse(words, in_blender, out)
            return OK if arguments is None else _COMMANDS[arguments.command](arguments, out, interrupts)
    except BrokenPipeError:
        return OK
    except (KeyboardInterrupt, Cancelled):
        print("strata: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BaseException as error:  # a panic of the kernels is no Exception
        print(f"strata: {one_line(error)}", file=sys.stderr)
        return BAD_INPUT


def blender_command(words: list[str]) -> int:
    """What `blender --command strata` calls."""
    return main(words, in_blender=True)


def _parse(words: Sequence[str] | None, in_blender: bool, out: TextIO) -> argparse.Namespace | None:
    """None after `--help`, which argparse prints to sys.stdout."""
    stdout, sys.stdout = sys.stdout, out
    try:
        return build_parser(needs_scene=not in_blender).parse_args(words)
    except SystemExit:
        return None
    finally:
        sys.stdout = stdout


# Commands that open a scene


@contextmanager
def _properties() -> Iterator[None]:
    """`scene.strata`, also where the extension is not enabled (the pip-installed Blender)."""
    try:
        import bpy
    except ImportError:
        raise StrataError("Blender's Python module is missing: pip install bpy") from None
    from ..addon.ui import properties

    if hasattr(bpy.types.Scene, "strata"):
        yield
        return
    properties.register()
    try:
        yield
    finally:
        properties.unregister()


def _open(arguments: argparse.Namespace, interrupts: Interrupts):
    """Opens the file and chooses what of it to bake; and what Blender says on opening it."""
    import bpy

    from ..addon.scene.open import choose, open_blend

    path, said = arguments.scene_file, ()
    if not path and not bpy.data.filepath:
        raise StrataError("no scene: give SCENE.blend")
    if not path and arguments.trust_scripts and bpy.app.autoexec_fail:
        path = bpy.data.filepath  # opened without them, before this command was asked
    if path:
        said = open_blend(path, arguments.trust_scripts)
    interrupts.check()
    frames = getattr(arguments, "frames", None)
    return choose(arguments.scene, arguments.view_layer, arguments.camera, frames), said


def _lights(arguments: argparse.Namespace, chosen) -> tuple[str, ...] | None:
    from ..addon.scene.lamp_names import LampNames

    if arguments.lights is None:
        return None
    return LampNames().chosen(arguments.lights, chosen.scene, chosen.view_layers)


def _camera(chosen):
    import bpy

    return bpy.data.objects[chosen.camera] if chosen.camera else None


def _plan(arguments: argparse.Namespace, out: TextIO, interrupts: Interrupts) -> int:
    from ..addon.planning import Options
    from ..addon.ui.properties import options_of
    from .planning import described_plan, plan_lines, read_plan, uncounted

    given = {"effects": arguments.effects, "values": nested(arguments.set)}
    Options(**given).chosen()  # wrong words are found before a large file is opened
    plain = ("samples", "target_error", "time_budget_s", "rgb_layers", "read", "read_texels")
    given |= {name: getattr(arguments, name) for name in plain}
    given |= {"memory_bytes": arguments.memory}
    with _properties():
        chosen, said = _open(arguments, interrupts)
        given["lights"] = _lights(arguments, chosen)
        asked, camera = partial(options_of, **given), _camera(chosen)
        sequences = _sequences(arguments, chosen, asked, interrupts)
        plans = []
        for frame in chosen.frames:
            warnings = [*said, *filter(None, [chosen.outside([frame])])]
            for view_layer in chosen.view_layers:
                interrupts.check()
                read = read_plan(chosen.scene, view_layer, asked, frame, camera, arguments.size)
                idle = uncounted(read[1], given["values"])
                plans.append(described_plan(*read, sequences[view_layer.name], [*warnings, *idle]))
    several = arguments.frames or len(plans) > 1
    if arguments.json:
        print(json.dumps(plans if several else plans[0], indent=1, ensure_ascii=False), file=out)
        return OK
    for plan in plans:
        if several:
            print(f"frame {plan['frame']}, view layer {plan['view_layer']}", file=out)
        for line in plan_lines(plan):
            print(line, file=out)
    return OK


def _sequences(arguments: argparse.Namespace, chosen, options_of, interrupts: Interrupts) -> dict:
    """The layers that every file has, by view layer's name; none where each frame's own do. And how many
    samples they have, where that is chosen for all frames."""
    from ..addon.sequence import sequence_layers
    from ..addon.sequence_samples import sequence_samples

    progress = Progress(sys.stderr, f"scene {chosen.scene.name}", getattr(arguments, "quiet", False))

    started = time.monotonic()

    def show(share: float, stage: str) -> None:
        interrupts.check()
        left = (time.monotonic() - started) * (1.0 - share) / share if share > 0.02 else None
        progress.show(share, stage, left)

    def warn(words: str) -> None:
        if not arguments.quiet:
            print(f"strata: {words}", file=sys.stderr, flush=True)

    where = options_of, chosen.frames, _camera(chosen), arguments.size, show
    try:
        layers = {
            view_layer.name: sequence_layers(chosen.scene, view_layer, *where) or ()
            for view_layer in chosen.view_layers
        }
        if arguments.command == "bake" and not arguments.chosen:
            for view_layer in chosen.view_layers:
                if found := sequence_samples(chosen.scene, view_layer, *where, warn):
                    arguments.chosen[view_layer.name] = found
        return layers
    finally:
        progress.clear()


def _bake(arguments: argparse.Namespace, out: TextIO, interrupts: Interrupts) -> int:
    from ..addon.layers.exr import check_codec
    from ..addon.planning import Options
    from ..addon.ui.properties import exr_of, options_of
    from .chosen import taken_again

    plain = (
        "effects", "backend", "samples", "target_error", "time_budget_s", "weight", "placement", "rgb_layers",
        "read", "read_texels", "probes", "error_images", "seed",
    )  # fmt: skip
    given = {name: getattr(arguments, name) for name in plain}
    given |= {"values": nested(arguments.set), "memory_bytes": arguments.memory}
    arguments.chosen = taken_again(arguments, given)
    # What can be wrong is found before a large file is opened, and long before the work is done.
    Options(**{name: value for name, value in given.items() if value is not None}).chosen()
    frames = arguments.frames or (0,)
    read_outputs(arguments, frames, _scene_path(arguments))
    _check_targets(arguments, frames)
    arguments.tracing = Tracing(arguments.trace)
    arguments.tracing.observer.stage("Opening")
    with _properties():
        chosen, arguments.said = _open(arguments, interrupts)
        arguments.exr = exr_of(chosen.scene, **exr_values(arguments))
        check_codec(arguments.exr)
        given["lights"] = _lights(arguments, chosen)
        if arguments.lights and arguments.exr.composite:
            raise StrataError("--lights: the composite needs every lamp")
        given["composite"] = arguments.exr.composite or None
        asked = partial(options_of, **given)
        if (outside := chosen.outside(chosen.frames)) and not arguments.quiet:
            print(f"strata: {outside}", file=sys.stderr, flush=True)
        arguments.tracing.observer.stage("Looking through frames")
        sequences = _sequences(arguments, chosen, asked, interrupts)
        failed, arguments.missed, arguments.idle = [], {}, set()
        for frame in chosen.frames:
            try:
                _bake_frame(arguments, chosen, frame, asked, sequences, out, interrupts)
            except (KeyboardInterrupt, Cancelled, BrokenPipeError):
                raise
            except BaseException as error:
                if len(chosen.frames) == 1:
                    raise
                print(f"strata: frame {frame}: {one_line(error)}", file=sys.stderr, flush=True)
                failed.append(frame)
                arguments.tracing.forget()
    if (words := told_missed(arguments.missed)) and len(chosen.frames) > 1 and not arguments.quiet:
        print(f"strata: {words}", file=sys.stderr, flush=True)
    if failed:
        raise StrataError(f"{len(failed)} of {len(chosen.frames)} frames failed: {some_frames(failed)}")
    return OK


def _scene_path(arguments: argparse.Namespace) -> Path | None:
    """None where what is open was never saved."""
    if arguments.scene_file:
        return Path(arguments.scene_file).absolute()
    import bpy

    return Path(bpy.data.filepath) if bpy.data.filepath else None


def _check_targets(arguments: argparse.Namespace, frames: tuple[int, ...]) -> None:
    from ..addon.layers.files import check_writable

    for frame in frames:
        for target in (arguments.output, arguments.report, arguments.trace):
            if target:
                check_writable(target.path(frame))


def _bake_frame(
    arguments: argparse.Namespace,
    chosen,
    frame: int,
    options_of,
    sequences: dict,
    out: TextIO,
    interrupts: Interrupts,
) -> None:
    from ..addon.measure.report_text import format_table

    bakes = []
    for view_layer in chosen.view_layers:
        title = f"frame {frame}" + (f", {view_layer.name}" if len(chosen.view_layers) > 1 else "")
        baked = _bake_view_layer(
            arguments, chosen, view_layer, frame, title, options_of, sequences[view_layer.name], interrupts
        )
        if baked is not None:
            bakes.append(baked)
    if not bakes:
        arguments.tracing.forget()
        return
    arguments.tracing.observer.stage("Writing")
    _write(arguments, frame, bakes)
    if not arguments.quiet:
        for baked in bakes:
            if len(chosen.view_layers) > 1:
                print(f"view layer {baked.layers.view_layer}", file=out)
            print(format_table(baked.report), file=out)
        print(f"wrote {arguments.output.path(frame)}", file=out)
        out.flush()
    arguments.tracing.write(frame, None if arguments.quiet else out)


def _bake_view_layer(arguments, chosen, view_layer, frame, title, options_of, sequence, interrupts):
    """What is baked of it, None where there is nothing, which is said."""
    from ..addon.bake import read_job
    from ..addon.job import run_to_end
    from .auditing import held_against_cycles
    from .planning import nothing_to_bake, room_warning, uncounted

    # What the first frame chose holds for all, or their noise would flicker.
    known = arguments.chosen.get(view_layer.name) or arguments.chosen.get("")
    options_of = partial(options_of, samples_of=known)
    where = chosen.scene, view_layer, options_of, frame, _camera(chosen), arguments.size
    warnings = [*arguments.said, *filter(None, [chosen.outside([frame])])]
    progress = Progress(sys.stderr, title, arguments.quiet)

    def show_materials(share: float) -> None:
        interrupts.check()
        progress.show(share, "Baking materials", None)

    try:
        observed = {"observer": arguments.tracing.observer}
        job = read_job(*where, show=show_materials, sequence=sequence, warnings=warnings, **observed)
    finally:
        progress.clear()
    baked, reason = None, nothing_to_bake(job.graph, sequence)
    for line in uncounted(job.graph, nested(arguments.set)):
        if line not in arguments.idle and not arguments.quiet:
            print(f"strata: {line}", file=sys.stderr, flush=True)
        arguments.idle.add(line)
    if reason is None:
        path = arguments.output.path(frame)
        if (warning := room_warning(path, job, arguments.exr)) and not arguments.quiet:
            print(f"strata: {title}: {warning}", file=sys.stderr, flush=True)

        def show(share: float, stage: str, seconds_left: float | None) -> None:
            interrupts.check()
            progress.show(share, stage, seconds_left)

        try:
            interrupts.check()
            baked = run_to_end(job, show=show)
            if arguments.audit:
                job.stage = "Auditing"
                baked = held_against_cycles(
                    baked, job, arguments, chosen.scene, view_layer, interrupts, progress
                )
        finally:
            progress.clear()
        reason = nothing_to_bake(job.graph, sequence)  # a closer look may leave out what boxes could not
    interrupts.check()
    if reason is None:
        missed = arguments.missed.setdefault(frame, [])
        missed += [name for name in missed_in(baked.layers.report) if name not in missed]
        if len(chosen.frames) > 1 and (found := samples_in(baked.layers.report)):
            arguments.chosen.setdefault(view_layer.name, found)
        return baked
    if not arguments.quiet:
        print(f"strata: {title}: {reason}", file=sys.stderr)
    return None


def _write(arguments: argparse.Namespace, frame: int, bakes: list) -> None:
    from ..addon.layers.exr import write_layers
    from ..addon.layers.files import replaced
    from .view_layers import joined

    layers, composite = bakes[0].layers, bakes[0].composite
    if len(bakes) > 1:
        layers, composite = joined(bakes), None
    warnings = write_layers(arguments.output.path(frame), layers, arguments.exr, composite)
    for warning in warnings:
        print(f"strata: frame {frame}: {warning}", file=sys.stderr)
    if arguments.report:
        report = {**layers.report, "warnings": [*layers.report["warnings"], *warnings]}
        text = json.dumps(report, indent=1, ensure_ascii=False, allow_nan=False)
        with replaced(arguments.report.path(frame)) as stream:
            stream.write(text.encode() + b"\n")


def _report(arguments: argparse.Namespace, out: TextIO, interrupts: Interrupts) -> int:
    from ..addon.planning import Options
    from ..addon.report.rivals.registry import named
    from ..addon.ui.properties import options_of
    from .report import folder_of, made, options_given

    given = options_given(arguments)
    Options(**{name: value for name, value in given.items() if value is not None}).chosen()
    named(arguments.rivals or ())
    folder = folder_of(arguments)
    with _properties():
        chosen, _ = _open(arguments, interrupts)
        given["lights"] = _lights(arguments, chosen)
        made(arguments, chosen, folder, partial(options_of, **given), out, interrupts)
    return OK


def _compare(arguments: argparse.Namespace, out: TextIO, interrupts: Interrupts) -> int:
    from .compare import compare

    return compare(arguments, out)


def _effects(arguments: argparse.Namespace, out: TextIO, interrupts: Interrupts) -> int:
    from .effects import effects

    effects(arguments, out)
    return OK


def _stability(arguments: argparse.Namespace, out: TextIO, interrupts: Interrupts) -> int:
    from .stability import stability

    return stability(arguments, out, interrupts)


_COMMANDS = {
    "bake": _bake,
    "effects": _effects,
    "plan": _plan,
    "report": _report,
    "compare": _compare,
    "stability": _stability,
}
