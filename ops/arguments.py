"""The command line's words, and what may be wrong with them."""

from __future__ import annotations

import argparse
import os
import re
from pathlib import Path
from typing import Any, NoReturn

from ..addon.core.errors import StrataError
from ..addon.core.params import ParamSpec
from ..addon.core.placement import Placement
from ..addon.core.read import MOST_TEXELS, Read
from ..addon.core.sampling import MOST_SAMPLES
from ..addon.core.weight import Weight
from ..addon.layers.exr_params import ExrParams
from ..addon.layers.numbered import Placeholder
from ..addon.layers.paths import NEVER_SAVED, exr_path, resolved, safe_name

MOST_FRAMES = 100_000
LARGEST_SIDE = 32_768


class Parser(argparse.ArgumentParser):
    """Complains in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        raise StrataError(message)


def frames(text: str) -> tuple[int, ...]:
    """`5`, `1-10`, `1-100x2` (every second), `1,4,8-12`; in order, each once."""
    found: dict[int, None] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*(-?\d{1,7})(?:-(-?\d{1,7})(?:x(\d{1,7}))?)?\s*", part)
        if not match:
            raise argparse.ArgumentTypeError(f"'{text}' is not frames like 1-10, 1-100x2 or 1,4,8-12")
        first, last, step = int(match[1]), int(match[2] or match[1]), int(match[3] or 1)
        if step < 1:
            raise argparse.ArgumentTypeError(f"frames '{part.strip()}' have no step")
        if last < first:
            raise argparse.ArgumentTypeError(f"frames '{part.strip()}' run backwards")
        if len(found) + (last - first) // step >= MOST_FRAMES:
            raise argparse.ArgumentTypeError(f"'{text}' is more than {MOST_FRAMES} frames")
        found.update(dict.fromkeys(range(first, last + 1, step)))
    return tuple(found)


def size(text: str) -> tuple[int, int]:
    """`960x540`, pixels."""
    match = re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", text)
    if not match or not all(1 <= int(side) <= LARGEST_SIDE for side in match.groups()):
        raise argparse.ArgumentTypeError(f"'{text}' is not a size like 960x540 (1 to {LARGEST_SIDE} pixels)")
    return int(match[1]), int(match[2])


def whole_number(low: int, high: int):
    """The type of a flag that takes a whole number in [low, high]."""

    def parse(text: str) -> int:
        if not re.fullmatch(r"[+-]?\d{1,18}", text) or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from {low} to {high}")
        return int(text)

    return parse


def numbers(low: int, high: int):
    """The type of a flag that takes whole numbers in [low, high], `1,2,4`: ascending, each once."""
    one = whole_number(low, high)

    def parse(text: str) -> tuple[int, ...]:
        return tuple(sorted({one(part.strip()) for part in text.split(",")}))

    return parse


def share(text: str) -> float:
    """`.02`: from 0 to less than 1."""
    match = re.fullmatch(r"0?\.\d{1,9}|0", text.strip())
    if not match:
        raise argparse.ArgumentTypeError(f"'{text}' is no error like .02")
    return float(text)


def seconds(text: str) -> float:
    """`10`, `1.5`."""
    if not re.fullmatch(r"\d{1,6}(\.\d{1,6})?", text.strip()):
        raise argparse.ArgumentTypeError(f"'{text}' is no time in seconds like 10")
    return float(text)


def memory(text: str) -> int:
    """`4G`, `512M`, `1.5G` in bytes; `0` for automatic."""
    match = re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?)([KMGT])B?|0", text.strip(), re.IGNORECASE)
    if not match:
        raise argparse.ArgumentTypeError(f"'{text}' is no memory like 4G or 512M")
    return round(float(match[1]) * 1000 ** " KMGT".index(match[2].upper())) if match[1] else 0


def names(text: str) -> tuple[str, ...]:
    """`a,b`; in order, each once."""
    found = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not found:
        raise argparse.ArgumentTypeError("no name given")
    return found


def setting(text: str) -> tuple[str, str, str]:
    """`effect.parameter=value`, in three; what they mean is the effect's to say."""
    match = re.fullmatch(r"\s*(\w+)\.(\w+)\s*=(.*)", text, re.DOTALL)
    if not match:
        raise argparse.ArgumentTypeError(f"'{text}' is not effect.parameter=value")
    return match[1], match[2], match[3].strip()


def nested(settings: list[tuple[str, str, str]]) -> dict[str, dict[str, Any]]:
    """Values by effect and parameter; the last one counts."""
    values: dict[str, dict[str, Any]] = {}
    for effect, parameter, value in settings:
        values.setdefault(effect, {})[parameter] = value
    return values


def exr_values(arguments: argparse.Namespace) -> dict[str, Any]:
    """Of ExrParams by name, None where no flag says."""
    return {spec.name: getattr(arguments, f"exr_{spec.name}") for spec in ExrParams.specs()}


def _add_exr_flag(command: argparse.ArgumentParser, spec: ParamSpec) -> None:
    name = f"exr_{spec.name}"
    if spec.kind is bool:
        command.add_argument(f"--{spec.name}", dest=name, action="store_true", default=None, help=spec.doc)
    else:
        flag = f"--exr-{spec.name}"
        command.add_argument(flag, dest=name, choices=spec.choices, help=f"{spec.doc} (default: the scene's)")


def build_parser(needs_scene: bool) -> Parser:
    """`needs_scene`: inside `blender -b SCENE.blend --command strata`, the scene is already open."""
    parser = Parser(prog="strata", description="Light and style effects, baked into layers with their error.")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="bake|report|compare|effects|plan|stability"
    )
    scene, sampling = _scene_flags(needs_scene), _sampling_flags()

    bake = commands.add_parser(
        "bake", parents=[scene, sampling], help="bake the layers of a scene into an EXR"
    )
    bake.add_argument("-o", "--output", required=True, metavar="OUT.exr",
                      help="where to, a folder too; #### is the frame number")  # fmt: skip
    bake.add_argument("--backend", choices=("auto", "cpu", "gpu"), help="default: the scene's, or auto")
    bake.add_argument("--settings-from", metavar="FILE",
                      help="as many samples for each layer as this EXR or report says")  # fmt: skip
    bake.add_argument("--weight", choices=[each.value for each in Weight],
                      help="of samples, where layers multiply (default: the scene's)")  # fmt: skip
    bake.add_argument("--placement", choices=[each.value for each in Placement],
                      help="of samples: as all pixels have them, or each its own (default: "
                      "the scene's)")  # fmt: skip
    bake.add_argument("--probes", type=whole_number(0, 1 << 20), metavar="N",
                      help="to measure the error at (default: the scene's, or 15%% of the time)")  # fmt: skip
    bake.add_argument("--error-images", action="store_true", default=None,
                      help="beside each measured layer how far it is off at each pixel; slow")  # fmt: skip
    bake.add_argument("--audit", action="store_true",
                      help="hold lamps' layers against Cycles at some thousand pixels")  # fmt: skip
    bake.add_argument(
        "--seed", type=whole_number(0, 0xFFFFFFFF), default=0, metavar="N", help="of the random numbers"
    )
    bake.add_argument("--report", metavar="OUT.json", help="times and errors as JSON")
    bake.add_argument("--trace", metavar="TRACE.json",
                      help="what every step took, when, and what bounds it, for Perfetto")  # fmt: skip
    for spec in ExrParams.specs():
        _add_exr_flag(bake, spec)
    bake.add_argument("-q", "--quiet", action="store_true", help="say nothing but what went wrong")

    report = commands.add_parser("report", parents=[scene], help="error against time, as a page with plots")
    report.add_argument("-o", "--output", required=True, metavar="FOLDER",
                        help="where to; what is there of the same report is gone on with")  # fmt: skip
    report.add_argument("--rivals", type=names, metavar="a,b",
                        help="who else makes the same layers: cycles, eevee, embree")  # fmt: skip
    report.add_argument("--samples", type=numbers(1, MOST_SAMPLES), metavar="1,2,4",
                        help="how many surfaces per pixel to try (default: 1 to 64)")  # fmt: skip
    report.add_argument("--samples-only", action="store_true",
                        help="leave parameters as the scene has them")  # fmt: skip
    report.add_argument("--repeats", type=whole_number(1, 100), default=3, metavar="N",
                        help="how often each setting is timed (default: 3)")  # fmt: skip
    report.add_argument("--backend", choices=("auto", "cpu", "gpu"), help="default: the scene's, or auto")
    report.add_argument(
        "--seed", type=whole_number(0, 0xFFFFFFFF), default=0, metavar="N", help="of the random numbers"
    )
    report.add_argument("-q", "--quiet", action="store_true", help="say nothing but what went wrong")

    compare = commands.add_parser("compare", help="layers of two files beside each other")
    compare.add_argument("first", metavar="A.exr")
    compare.add_argument("second", metavar="B.exr", help="what it should be")
    compare.add_argument("--layers", type=names, metavar="A,B", help="only these passes (default: all of B)")
    compare.add_argument("--limit", type=share, metavar=".02",
                         help="exit code 1 where a layer differs by more, root mean square")  # fmt: skip
    compare.add_argument("-o", "--output", metavar="FOLDER", help="for pictures of the differences")
    compare.add_argument("--json", action="store_true")
    compare.add_argument("-q", "--quiet", action="store_true", help="say nothing but what went wrong")

    effects = commands.add_parser("effects", help="what there is, with parameters and ranges")
    effects.add_argument("--json", action="store_true")

    stability = commands.add_parser(
        "stability", help="extreme inputs and how wrong the results are, where Strata's tests are"
    )
    stability.add_argument("--effects", type=names, metavar="a,b",
                           help="print these, in place of writing docs/stability.md")  # fmt: skip

    plan = commands.add_parser(
        "plan", parents=[scene, sampling], help="what would run, what is left out and why"
    )
    plan.add_argument("--json", action="store_true")
    return parser


def _sampling_flags() -> argparse.ArgumentParser:
    flags = argparse.ArgumentParser(add_help=False)
    flags.add_argument("--samples", type=whole_number(1, MOST_SAMPLES), metavar="N",
                      help="surfaces per pixel; with a target error or a time budget at most so many "
                      "(default: the scene's)")  # fmt: skip
    flags.add_argument("--target-error", type=share, metavar=".02",
                      help="each layer gets as many samples as bring its error down to that, at most "
                      "--samples (default: the scene's, or .02; 0: none)")  # fmt: skip
    flags.add_argument("--time-budget", type=seconds, dest="time_budget_s", metavar="10",
                      help="as many samples as there is time for, in seconds a frame, at most --samples "
                      "(default: the scene's; 0: any)")  # fmt: skip
    return flags


def _scene_flags(needs_scene: bool) -> argparse.ArgumentParser:
    flags = argparse.ArgumentParser(add_help=False)
    flags.add_argument("scene_file", nargs=None if needs_scene else "?", metavar="SCENE.blend")
    flags.add_argument(
        "--effects", type=names, metavar="a,b", help="default: those the scene has switched on"
    )
    flags.add_argument(
        "--frames",
        type=frames,
        metavar="1-10",
        help="or 1-100x2, 1,4,8-12 (default: the scene's current frame)",
    )
    flags.add_argument("--scene", metavar="S", help="default: the file's active scene")
    flags.add_argument("--view-layer", metavar="V", help="or all (default: the scene's first that renders)")
    flags.add_argument("--lights", type=names, metavar="A,B", help="only these lamps' layers")
    flags.add_argument("--camera", metavar="C", help="default: the scene's camera")
    flags.add_argument("--size", type=size, metavar="960x540", help="default: the scene's")
    flags.add_argument("--trust-scripts", action="store_true",
                       help="run the file's scripts and its drivers in Python")  # fmt: skip
    flags.add_argument("--read", choices=[each.value for each in Read],
                       help="materials by their nodes alone, or what is not read of them as Blender bakes it "
                       "(default: the scene's)")  # fmt: skip
    flags.add_argument("--read-texels", type=whole_number(1, MOST_TEXELS), metavar="N",
                       help="most a side of what Blender bakes (default: the scene's, or 1024)")  # fmt: skip
    flags.add_argument("--rgb-layers", action="store_true", default=None,
                       help="shadows in colour, channel by channel (default: the scene's)")  # fmt: skip
    flags.add_argument("--memory", type=memory, metavar="4G",
                       help="what a bake may take beside Blender itself (default: the scene's)")  # fmt: skip
    flags.add_argument("--set", type=setting, action="append", default=[], metavar="EFFECT.PARAMETER=VALUE",
                       help="may be given several times; goes over what the scene has set")  # fmt: skip
    return flags


def read_outputs(arguments: argparse.Namespace, frame_list: tuple[int, ...], blend: Path | None) -> None:
    """Makes placeholders of `output`, `report` and `trace`; `blend` is the .blend's path. Raises StrataError
    where outputs would overwrite one another, or the scene."""
    folder = blend and blend.parent
    # Names of folders get a number themselves where there are several frames.
    name = (safe_name(blend.stem) if blend else NEVER_SAVED) + ("_####" if len(frame_list) > 1 else "")
    arguments.output = Placeholder(exr_path(resolved(arguments.output, folder), name))
    arguments.report = arguments.report and Placeholder(resolved(arguments.report, folder))
    arguments.trace = arguments.trace and Placeholder(resolved(arguments.trace, folder))
    flags = {"-o": arguments.output, "--report": arguments.report, "--trace": arguments.trace}
    taken = {_same_file(blend)} if blend else set()
    for flag, target in flags.items():
        if target and len(frame_list) > 1 and not target.is_numbered:
            raise StrataError(f"{flag}: several frames need #### in '{target.text}' for the frame number")
    for flag, target in flags.items():
        paths = {_same_file(target.path(frame)) for frame in frame_list} if target else set()
        if paths & taken:
            raise StrataError(f"{flag}: '{target.text}' is already the name of another file of this bake")
        taken |= paths


def _same_file(path: Path) -> str:
    """Equal where writing to the one writes to the other."""
    return os.path.normcase(os.path.realpath(path))
