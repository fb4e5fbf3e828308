"""Cycles' images as truths: two renders each, of different seeds, kept in a folder so that another run costs
only bakes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from . import cycles
from .document import ROOT

FOLDER = ROOT / "out" / "cycles"
SEEDS = (1, 2)


def diffuse(
    scene, lamp, samples: int, size: tuple[int, int], *, shadow: bool, hidden: Iterable = ()
) -> np.ndarray:
    """(2, height, width, 3): what `lamp`, alone in the scene, makes of the picture by diffuse surfaces' light
    and colour, without bounces. `hidden`: objects that are not there."""

    def rendered(seed: int) -> dict[str, np.ndarray]:
        settings = cycles.alone(scene, lamp, samples, seed, size)
        settings += [
            (lamp.data, "use_shadow", shadow),
            (scene.view_layers[0], "use_pass_diffuse_color", True),
        ]
        settings += [(item, "hide_render", True) for item in hidden]
        passes = ("Diffuse Direct", "DiffDir"), ("Diffuse Color", "DiffCol")

        def render() -> dict[str, np.ndarray]:
            (light, colour), _ = cycles.render_passes(scene, settings, *passes)
            return {"image": light * colour}

        return _kept(settings, render)

    return np.stack([rendered(seed)["image"] for seed in SEEDS])


def picture(
    scene,
    lamps: list,
    samples: int,
    size: tuple[int, int],
    *,
    shadow: bool,
    bounces: int,
    hidden: Iterable = (),
) -> dict[str, np.ndarray]:
    """(2, height, width, 3) each: the whole picture as "image", and what is in it of each of `lamps` by its
    name; `shadow`: whether those cast their own; `hidden` as above."""

    def rendered(seed: int) -> dict[str, np.ndarray]:
        settings = [*cycles.exact(scene, samples, seed, size), (scene.cycles, "max_bounces", bounces)]
        settings += [(lamp.data, "use_shadow", shadow) for lamp in lamps]
        settings += [(lamp, "lightgroup", lamp.name) for lamp in lamps]
        settings += [(item, "hide_render", True) for item in hidden]
        passes = {"image": ("Combined",), **{lamp.name: (f"Combined_{lamp.name}",) for lamp in lamps}}

        def render() -> dict[str, np.ndarray]:
            with _groups(scene.view_layers[0], [lamp.name for lamp in lamps]):
                images, _ = cycles.render_passes(scene, settings, *passes.values())
            return dict(zip(passes, images, strict=True))

        return _kept(settings, render)

    halves = [rendered(seed) for seed in SEEDS]
    return {name: np.stack([half[name] for half in halves]) for name in halves[0]}


@contextmanager
def _groups(view_layer, names: list[str]) -> Iterator[None]:
    for name in names:
        view_layer.lightgroups.add(name=name)
    try:
        yield
    finally:
        for name in names:
            view_layer.lightgroups.remove(view_layer.lightgroups[name])


def _kept(settings: list, render: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """By what was asked for: the scene's file, the settings, the Blender."""
    digest = hashlib.sha256(Path(bpy.data.filepath).read_bytes())
    digest.update(repr((bpy.app.version_string, settings)).encode())
    path = FOLDER / f"{digest.hexdigest()[:24]}.npz"
    if not path.exists():
        images = render()
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, **images)
    with np.load(path) as found:
        return dict(found)
