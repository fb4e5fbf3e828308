"""Bakes a recipe as a person would, from a saved file by the command line, and says what is wrong."""

from __future__ import annotations

import contextlib
import io
import os
import warnings
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from strata.ops.cli import main
from strata.tests.bake.random_scenes import build, words_of
from strata.tests.support.exr_layers import read_layers


def problems_of(recipe: dict[str, Any], folder: str | os.PathLike) -> list[str]:
    """Empty where the file is whole or the refusal is one line. `folder` is left empty."""
    build(recipe)
    scene, out = Path(folder, "scene.blend"), Path(folder, "out.exr")
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    told = io.StringIO()
    with contextlib.redirect_stderr(told), warnings.catch_warnings(record=True) as noted:
        warnings.simplefilter("always")
        code = main(["bake", str(scene), "-o", str(out), "--quiet", *words_of(recipe)])
    lines = told.getvalue().splitlines()
    found = [f"warning of Python's: {note.message} ({note.filename}:{note.lineno})" for note in noted]
    if code == 2:
        if len(lines) != 1 or "Strata failed" in lines[0]:
            found.append(f"exit 2 and {lines}")
    elif code != 0 or lines:
        found.append(f"exit {code} and {lines}")
    if out.exists():
        if code:
            found.append(f"exit {code} and a file")
        found += problems_of_file(out)
    for path in Path(folder).iterdir():
        if path not in (scene, out):
            found.append(f"left behind: {path.name}")
        path.unlink()
    return found


def problems_of_file(path: Path) -> list[str]:
    """Of layers: each finite, and those that the report names."""
    read = read_layers(path)
    found = []
    for layer in read.layers:
        if not np.isfinite(layer.pixels).all():
            bad = ~np.isfinite(layer.pixels)
            found.append(f"layer '{layer.name}' has {bad.sum()} values that are not finite")
    if [layer.name for layer in read.layers] != [layer["name"] for layer in read.report["layers"]]:
        found.append("layers are not those of the report")
    errors = {layer["name"]: layer.get("error") or {} for layer in read.report["layers"]}
    found += [f"'{n}': {e['not_measured']}" for n, e in errors.items() if "not_measured" in e]
    found += [f"report: {w}" for w in read.report["warnings"] if "failed on" in w]
    return found
