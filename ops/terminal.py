"""What a command says, where: results on stdout, progress and trouble on stderr."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from typing import TextIO

from ..addon.core.errors import StrataError

QUIET_SECONDS = 2.0  # between progress lines where there is no terminal
REDRAW_SECONDS = 0.1


@contextmanager
def clean_stdout() -> Iterator[TextIO]:
    """The real stdout, while whatever Blender prints to file descriptor 1 goes nowhere: JSON stays JSON."""
    _open_streams()
    sys.stdout.flush()
    saved = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    out = _Stdout(os.fdopen(os.dup(saved), "wb"), encoding="utf-8", errors="replace")
    try:
        yield out
    finally:
        try:
            with suppress(BrokenPipeError), _written():  # the reader has gone, as `head` does: its business
                out.close()
        finally:
            sys.stdout.flush()
            os.dup2(saved, 1)
            os.close(saved)


class _Stdout(TextIOWrapper):
    """Says what is wrong where it cannot be written to: while it is, when it holds much, or at its end."""

    def write(self, text: str) -> int:
        with _written():
            return super().write(text)


@contextmanager
def _written() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise StrataError(f"cannot write to standard output: {error.strerror or error}") from None


def _open_streams() -> None:
    """Those that a shell has closed lead nowhere: otherwise the next file opened would be in their place."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free: this one
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115 (for as long as Python runs)
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115


class Interrupts:
    """Ctrl-C, and a farm's SIGTERM: remembered, and raised where `check` is called.

    Not raised on the spot, because most of what Blender calls back would swallow it and go on half done; and
    taken back from Blender, which keeps SIGINT for itself. A second one is raised at once.
    """

    def __init__(self):
        self._is_interrupted = False
        self._before: dict[int, object] = {}

    def __enter__(self) -> Interrupts:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._remember)
        return self

    def __exit__(self, *_) -> None:
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    def _remember(self, *_) -> None:
        if self._is_interrupted:
            raise KeyboardInterrupt
        self._is_interrupted = True

    def check(self) -> None:
        """Raises KeyboardInterrupt if there was one."""
        if self._is_interrupted:
            raise KeyboardInterrupt


class Progress:
    """A bar with the time left on a terminal, now and then a line elsewhere, nothing if `quiet`."""

    def __init__(self, stream: TextIO, title: str, quiet: bool = False):
        self._stream = stream
        self._title = title
        self._quiet = quiet
        self._live = stream.isatty()
        self._started = self._said = time.monotonic()
        self._line = ""

    def show(self, fraction: float, doing: str, seconds_left: float | None = None) -> None:
        now = time.monotonic()
        wait = REDRAW_SECONDS if self._live else max(QUIET_SECONDS, (now - self._started) / 10)
        if self._quiet or now - self._said < wait:
            return
        self._said = now
        left = time_left(seconds_left)
        if not self._live:
            print(f"{self._title}: {100 * fraction:3.0f}%{left and ', ' + left}, {doing}", file=self._stream)
            self._stream.flush()
            return
        columns = shutil.get_terminal_size().columns
        cells = max(min(columns - 60, 30), 8)
        done = round(cells * fraction)
        line = f"{self._title} [{'#' * done}{'.' * (cells - done)}] {100 * fraction:3.0f}% {left:<12} {doing}"
        self._line = line[: columns - 1]
        self._stream.write(f"\r\x1b[K{self._line}")
        self._stream.flush()

    def clear(self) -> None:
        """Takes the bar away, so that what comes next stands on a line of its own."""
        if self._line:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
            self._line = ""


def time_left(seconds: float | None) -> str:
    """`12 s left`; nothing where that is not known."""
    if seconds is None:
        return ""
    return f"{seconds:.0f} s left" if seconds < 100 else f"{seconds / 60:.0f} min left"
