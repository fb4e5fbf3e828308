"""Who is told of what a run does while it does it; measure/trace.py makes a trace of that."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .device import Device
from .graph import Node
from .surface import Chunk


class Span:
    """Work on one node; this one is told of nobody."""

    def issued(self) -> None:
        """All commands are given; what follows is waiting for the device."""

    def ended(self, value: Any = None) -> None:
        """With the value that came out, None where it is told elsewhere. Work that fails does not end."""


class Observer:
    """This one looks away, at the cost of calls that do nothing."""

    _nobody = Span()

    def stage(self, name: str) -> None:
        """What follows belongs to it, until the next."""

    def tell(self, **args: Any) -> None:
        """Of the stage under way."""

    def node(
        self, node: Node, device: Device, where: str, inputs: Sequence[Any] = (), chunk: Chunk | None = None
    ) -> Span:
        """Begins work on a node: `where` is the device's name, or the way between two; `inputs` are values of
        `device`."""
        return self._nobody


NOBODY = Observer()
