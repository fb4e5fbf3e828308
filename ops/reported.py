"""Operators that report what goes wrong."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps

from ..addon.core.errors import one_line


def reported(execute: Callable) -> Callable:
    """An operator's `execute` that reports any error in one line, and is then cancelled."""

    @wraps(execute)
    def run(self, context):
        try:
            return execute(self, context)
        except BaseException as error:  # a panic of the kernels is no Exception
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}

    return run
