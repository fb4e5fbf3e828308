"""A simple picture of a scene's light: what diffuse surfaces would send back if nothing cast a shadow."""

from __future__ import annotations

import numpy as np

from ...core.effect import LayerKind, Metric
from ...core.graph import Step
from ...core.outline import Light, Outline, emitter_measure
from ...core.recorder import Recorder

LIT = LayerKind(title="Lit", channels="RGB", metric=Metric.RELATIVE_L2, per_light=True)


def _lit(device, surface, eye, emitter, radiance, albedos, images):
    irradiance = device.kernels.irradiance(
        surface["position"],
        surface["shading_normal"],
        np.array(eye),
        emitter.packed(),
        cancel=device.cancel_flag,
    )
    colour = np.array([*albedos, (0.0, 0.0, 0.0)], np.float32)[surface["material"]]
    for material, image in images:
        texels = device.texture(image)
        if texels is not None:
            there = surface["material"] == material
            colour[there] = _nearest(texels, surface["uv"][there])
    return colour * irradiance[..., None] * np.array(radiance, np.float32) / np.float32(np.pi)


def _nearest(texels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N, 3) texels (height, width, 4) at uv (N, 2), repeated."""
    height, width = texels.shape[:2]
    column = np.floor(np.mod(uv[:, 0], 1.0) * width).astype(int) % width
    row = np.floor(np.mod(uv[:, 1], 1.0) * height).astype(int) % height
    return texels[row, column, :3]


# Diffuse radiance without shadows, for pictures only: never a baked layer.
STEP = Step("lit", cpu=_lit, hole="only pictures for people need it")


def _brightness(light: Light) -> tuple[float, float, float]:
    """What the kernel's irradiance is per unit of: radiance, or intensity for a light of no size."""
    return light.radiance if emitter_measure(light.emitter) > 0.0 else light.intensity


def record(recorder: Recorder, outline: Outline) -> None:
    """Adds the picture of every light that the graph already has a layer of."""
    planned = [layer for layer in recorder.layers if layer.light_index is not None]
    images = tuple(
        (index, material.base_color_image)
        for index, material in enumerate(outline.materials)
        if material.base_color_image is not None
    )
    albedos = tuple(material.base_color for material in outline.materials)
    for layer in planned:
        light = outline.lights[layer.light_index]
        recorder.wants("uv", "base_color")
        surface = recorder.surface_with("material", "uv")
        node = recorder.step(
            STEP,
            surface,
            instance=light.name,
            eye=outline.view.eye,
            emitter=light.emitter,
            radiance=_brightness(light),
            albedos=albedos,
            images=images,
        )
        recorder.layer(LIT, node, layer.light_index)
