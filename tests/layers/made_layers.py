"""Layers of random values, and what reads or hinders their files."""

from __future__ import annotations

import resource
import signal
from contextlib import contextmanager

import bpy
import numpy as np
from strata.addon.core.layers import Layer, LayerSet
from strata.addon.core.roles import Of
from strata.addon.measure.report import LayerError

WIDTH, HEIGHT = 7, 5

ERROR = LayerError(
    "in use", 0.011, (0.01, 0.012), 0.0, 0.1, 0.2, 64, "rays", 1e-3, 0.1, method=0.005, sampling=0.01
).to_json()


def pixels(channels: str, seed: int = 0) -> np.ndarray:
    """Values that a half float or an 8-bit image would spoil, with the extremes among them."""
    shape = (HEIGHT, WIDTH) if len(channels) == 1 else (HEIGHT, WIDTH, len(channels))
    values = np.random.default_rng(seed).normal(size=shape).astype(np.float32)
    values.flat[:4] = (0.0, 1.0, 1e30, 1e-30)
    return values


def layer(name: str, channels: str = "V", light: str = "", seed: int = 0) -> Layer:
    return Layer(
        name, channels, pixels(channels, seed), "soft_shadow", light, Of.lamp(0), 0.25, ERROR, {"layers": 3}
    )


def layer_set(*layers: Layer, view_layer: str = "ViewLayer", space: str = "Linear Rec.709") -> LayerSet:
    return LayerSet(tuple(layers), WIDTH, HEIGHT, view_layer, space, {"strata": "0.1.0", "frame": 3}, 2.0)


def compositor_passes(path) -> set[str]:
    """The pass names that Blender's Image node offers."""
    tree = bpy.data.node_groups.new("passes", "CompositorNodeTree")
    node = tree.nodes.new("CompositorNodeImage")
    image = bpy.data.images.load(str(path))
    node.image = image
    assert image.type == "MULTILAYER"
    names = {output.name for output in node.outputs}
    bpy.data.node_groups.remove(tree)
    bpy.data.images.remove(image)
    return names


@contextmanager
def largest_file(size: int):
    """A disk that fills up: the system refuses to let any file grow past `size` bytes."""
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
