"""`strata report`: error against time of a scene."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, TextIO

from ..addon.core.errors import StrataError
from ..addon.layers.paths import resolved
from .arguments import nested
from .terminal import Interrupts, Progress

GIVEN = ("effects", "backend", "seed", "rgb_layers", "read", "read_texels")


def made(
    arguments: argparse.Namespace, chosen, folder: Path, options_of, out: TextIO, interrupts: Interrupts
) -> None:
    """Of what was opened and chosen. Raises StrataError and KeyboardInterrupt; what has been found by then is
    written all the same."""
    from ..addon.report.report import PAGE, report
    from ..addon.report.setting import SAMPLES
    from ..addon.report.sweep import Asked

    if len(chosen.frames) > 1 or len(chosen.view_layers) > 1:
        raise StrataError("a report is of one frame and one view layer")
    camera = _camera(chosen)
    scripts = arguments.trust_scripts or (False if arguments.scene_file else None)
    asked = Asked(
        chosen.scene,
        chosen.view_layer,
        options_of,
        chosen.frames[0],
        camera,
        arguments.size,
        arguments.rivals or (),
        arguments.samples or SAMPLES,
        arguments.repeats,
        not arguments.samples_only,
        bool(arguments.scene_file),
        scripts,
    )
    progress = Progress(sys.stderr, "report", arguments.quiet)

    def show(share: float, doing: str, seconds_left: float | None) -> None:
        interrupts.check()
        progress.show(share, doing, seconds_left)

    try:
        result = report(asked, folder, show)
    finally:
        progress.clear()
    if not arguments.quiet:
        for warning in result.warnings:
            print(f"strata: {warning}", file=sys.stderr)
        print(f"wrote {folder / PAGE}", file=out)


def _camera(chosen):
    import bpy

    return bpy.data.objects[chosen.camera] if chosen.camera else None


def options_given(arguments: argparse.Namespace) -> dict[str, Any]:
    """What flags say, for `options_of`."""
    given = {name: getattr(arguments, name) for name in GIVEN}
    return given | {"values": nested(arguments.set), "memory_bytes": arguments.memory}


def folder_of(arguments: argparse.Namespace) -> Path:
    """Absolute; `//` is the .blend's own. Raises StrataError."""
    import bpy

    path = arguments.scene_file or bpy.data.filepath
    blend = Path(path).absolute().parent if path else None
    return Path(resolved(arguments.output, blend)).absolute()
