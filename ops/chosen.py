"""How many samples layers get, where an earlier bake says so."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..addon.core.errors import StrataError
from ..addon.layers.settings_from import settings_in

ANSWERED = {"samples": "samples", "target_error": "target-error", "time_budget_s": "time-budget"}


def taken_again(arguments: argparse.Namespace, given: dict[str, Any]) -> dict[str, dict[str, int]]:
    """By view layer and layer what the file of --settings-from says, empty where there is none; `given` are
    the options that flags set, and get what all layers have. Raises StrataError where flags say something
    else."""
    if not arguments.settings_from:
        return {}
    for name, flag in ANSWERED.items():
        if given[name] is not None:
            raise StrataError(f"--{flag}: --settings-from says how many samples there are")
    if any("target_error" in values for values in given["values"].values()):
        raise StrataError("--set ….target_error: --settings-from says how many samples there are")
    chosen, samples = settings_in(Path(arguments.settings_from))
    given |= {"samples": samples, "target_error": 0.0, "time_budget_s": 0.0}
    return chosen
