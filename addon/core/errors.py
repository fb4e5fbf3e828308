"""What can go wrong, told in one line."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from pathlib import Path

TRACEBACK_FILE = "STRATA_TRACEBACK"
"""The environment variable that names the file to which tracebacks are appended; none are written without."""

MOST_LETTERS = 300  # of what an unforeseen error says
_ROOT = Path(__file__).resolve().parents[2]
_OWN = (_ROOT / "addon", _ROOT / "ops")
_told: set[str] = set()


class StrataError(Exception):
    """Input, scene or output that cannot be used; the message is one line for a person."""


class Cancelled(Exception):
    """The user cancelled; nothing partial is left behind."""


class DeviceUnavailable(Exception):
    """A device does not start here; the message says why."""


class ShaderError(Exception):
    """A GPU program does not compile here. `log` is what the compiler said."""

    def __init__(self, name: str, log: str):
        first = next((line.strip(" |") for line in log.splitlines() if "rror:" in line), log[:200])
        super().__init__(f"shader '{name}' does not compile: {first}")
        self.log = log


def one_line(error: BaseException) -> str:
    """What every face tells a person: the message of an error that was foreseen; of any other that Strata
    failed, why, and in which line of its own, to be reported. Its traceback goes to `TRACEBACK_FILE`."""
    if isinstance(error, (StrataError, DeviceUnavailable)):
        return _joined(error)
    _write_traceback(error)
    if isinstance(error, MemoryError):
        return "not enough memory"
    what = _joined(error)[:MOST_LETTERS] or "no reason given"
    if type(error).__name__ not in ("RuntimeError", "PanicException"):  # those say all in words
        what = f"{type(error).__name__}: {what}"
    return f"Strata failed: {what} ({_place(error)})"


def sentence(line: str) -> str:
    """A line as an interface shows it, where it stands by itself: with a capital."""
    return line[:1].upper() + line[1:]


def told_once(function: Callable) -> Callable:
    """For what Blender calls after every edit and redraw: raises nothing and returns None instead, and tells
    each line on stderr once."""

    @wraps(function)
    def call(*arguments):
        try:
            return function(*arguments)
        except BaseException as error:
            line = one_line(error)
            if line not in _told:
                _told.add(line)
                print(f"strata: {line}", file=sys.stderr)
            return None

    return call


def _joined(error: BaseException) -> str:
    return " ".join(str(error).split())


def _place(error: BaseException) -> str:
    """`file:line` of the innermost line of Strata's that was at work, else of any."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if any(map(Path(frame.filename).is_relative_to, _OWN))]
    if not frames:
        return "unknown place"
    frame = (own or frames)[-1]
    path = Path(frame.filename)
    return f"{path.relative_to(_ROOT) if own else path.name}:{frame.lineno}"


def _write_traceback(error: BaseException) -> None:
    path = os.environ.get(TRACEBACK_FILE)
    if not path:
        return
    with suppress(OSError), open(path, "a", encoding="utf-8", errors="replace") as file:
        file.writelines([*traceback.format_exception(error), "\n"])
