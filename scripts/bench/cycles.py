"""Cycles as a judge and as a rival: one light's shadow as the ratio of a lit to an unshadowed render, or what
media scatter of its light.

Both renders use the same seed and so the same light samples: their ratio is Cycles' own estimate of
V = sum of visible * w / sum of w, and the pass that is divided (diffuse direct, without albedo) holds nothing
but that light. Divided by pi it is irradiance; Cycles lets no light bounce.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import OpenEXR

POINT_FILTER_WIDTH = 0.01  # pixels; the least that Cycles takes, so that all samples see one surface point


@dataclass(frozen=True)
class Render:
    """`image` (height, width, 3) float32, row 0 at the bottom; `seconds` of the whole render call, from the
    scene's synchronisation and BVH to the written file."""

    image: np.ndarray
    seconds: float


@contextmanager
def kept(*settings) -> Iterator[None]:
    """Sets attributes, (owner, name, value) each, and puts the old values back."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in settings]
    try:
        for owner, name, value in settings:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:  # in the same order: a colour depth belongs to its file format
            setattr(owner, name, value)


def lamps(scene) -> list:
    """The scene's light objects that a render sees."""
    return [item for item in scene.objects if item.type == "LIGHT" and not item.hide_render]


def _emission_off() -> list:
    """Settings that keep surfaces from shining."""
    off = []
    for material in bpy.data.materials:
        nodes = material.node_tree.nodes if material.node_tree else ()
        for node in nodes:
            name = {"BSDF_PRINCIPLED": "Emission Strength", "EMISSION": "Strength"}.get(node.type)
            if name and not node.inputs[name].is_linked:
                off.append((node.inputs[name], "default_value", 0.0))
    return off


def exact(scene, samples: int, seed: int, size: tuple[int, int], threads: int = 2) -> list:
    """Settings by which Cycles takes all samples asked for and changes none of them."""
    cycles, render = scene.cycles, scene.render
    settings = [
        (render, name, value)
        for name, value in (
            ("engine", "CYCLES"),
            ("resolution_x", size[0]),
            ("resolution_y", size[1]),
            ("resolution_percentage", 100),
            ("use_border", False),
            ("use_motion_blur", False),
            ("use_compositing", False),
            ("use_sequencer", False),
            ("use_persistent_data", False),
            ("threads_mode", "FIXED"),
            ("threads", threads),
        )
    ]
    settings += [
        (cycles, name, value)
        for name, value in (
            ("device", "CPU"),
            ("samples", samples),
            ("seed", seed),
            ("use_animated_seed", False),
            ("use_adaptive_sampling", False),
            ("use_denoising", False),
            ("light_sampling_threshold", 0.0),
            ("sample_clamp_direct", 0.0),
            ("transparent_max_bounces", 64),
            ("use_fast_gi", False),
        )
    ]
    return [*settings, (scene.view_layers[0], "use_pass_combined", True)]


def alone(scene, lamp, samples, seed, size, filter_width=None, threads=2) -> list:
    """Settings by which nothing but `lamp` shines, straight onto diffuse surfaces. `filter_width` in pixels,
    None for the scene's own filter."""
    cycles = scene.cycles
    settings = [(item, "hide_render", item != lamp) for item in lamps(scene)]
    settings += [(lamp, "visible_camera", False), (scene, "world", None)]
    settings += _emission_off()
    settings += exact(scene, samples, seed, size, threads)
    settings += [
        (scene.view_layers[0], "use_pass_diffuse_direct", True),
        (cycles, "use_light_tree", False),
        (cycles, "max_bounces", 0),
        (cycles, "min_light_bounces", 0),
    ]
    if filter_width is not None:
        # Cycles' box filter is a pixel wide whatever its width says; the others obey.
        settings += [(cycles, "pixel_filter_type", "GAUSSIAN"), (cycles, "filter_width", filter_width)]
    return settings


def render(
    scene,
    lamp,
    samples: int,
    *,
    shadow: bool = True,
    seed: int = 0,
    size: tuple[int, int],
    filter_width: float | None = POINT_FILTER_WIDTH,
    threads: int = 2,
) -> Render:
    """Diffuse light that comes straight from `lamp`, alone in the scene; with `shadow` off nothing blocks it.
    `filter_width` in pixels, None for the scene's own filter. Leaves the scene as it was."""
    settings = alone(scene, lamp, samples, seed, size, filter_width, threads)
    settings.append((lamp.data, "use_shadow", shadow))
    (image,), seconds = render_passes(scene, settings, ("Diffuse Direct", "DiffDir"))
    return Render(image, seconds)


def airlight(scene, lamp, samples: int, *, seed: int = 0, size: tuple[int, int], threads: int = 2) -> Render:
    """Radiance that media scatter once from `lamp`, alone in the scene, towards the camera, at pixel centres.
    A world's volume is left out, since the world is. Leaves the scene as it was."""
    settings = alone(scene, lamp, samples, seed, size, POINT_FILTER_WIDTH, threads)
    settings += [
        (scene.view_layers[0].cycles, "use_pass_volume_direct", True),
        (scene.cycles, "volume_bounces", 0),
    ]
    (image,), seconds = render_passes(scene, settings, ("Volume Direct", "VolumeDir"))
    return Render(image, seconds)


def render_passes(scene, settings: list, *passes: tuple[str, ...]) -> tuple[list[np.ndarray], float]:
    """Of the first view layer, (height, width, 3) float32 each, by whichever of its names a pass has; and the
    seconds of the whole render call. Leaves the scene as it was."""
    image = scene.render.image_settings
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "render.exr"
        written = [
            (scene.render, "filepath", str(path)),
            (scene.render, "use_file_extension", False),
            (image, "media_type", "MULTI_LAYER_IMAGE"),
            (image, "file_format", "OPEN_EXR_MULTILAYER"),
            (image, "color_depth", "32"),
            (image, "exr_codec", "NONE"),
        ]
        with kept(*settings, *written):
            started = time.perf_counter()
            bpy.ops.render.render(write_still=True, scene=scene.name)
            seconds = time.perf_counter() - started
        return [_read(path, scene.view_layers[0].name, names) for names in passes], seconds


def _read(path: Path, view_layer: str, passes: tuple[str, ...]) -> np.ndarray:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        for part in file.parts:
            for name in passes:
                names = [f"{view_layer}.{name}.{letter}" for letter in "RGB"]
                if names[0] in part.channels:
                    planes = [part.channels[channel].pixels for channel in names]
                    return np.ascontiguousarray(np.stack(planes, axis=2)[::-1], np.float32)
    raise RuntimeError(f"Cycles wrote no pass {passes[0]}")


@dataclass(frozen=True)
class Shadow:
    """`visibility` (height, width) float64, NaN where the light does not reach; `weight` what it brings
    unshadowed, in arbitrary units; `seconds` of the shadowed render only."""

    visibility: np.ndarray
    weight: np.ndarray
    seconds: float


def shadow(scene, lamp, samples: int, **settings) -> Shadow:
    """Lit over unlit; `settings` as `render` takes them."""
    lit = render(scene, lamp, samples, shadow=True, **settings)
    bare = render(scene, lamp, samples, shadow=False, **settings)
    weight = bare.image.sum(axis=2, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        visibility = np.where(weight > 0.0, lit.image.sum(axis=2, dtype=np.float64) / weight, np.nan)
    return Shadow(visibility, weight, lit.seconds)
