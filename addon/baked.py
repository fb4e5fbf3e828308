"""What a bake leaves behind, put together from what was made and measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .core.execution import Execution
from .core.graph import Graph, Node
from .core.layers import Layer, LayerSet
from .core.memory import MemoryEstimate
from .core.naming import error_name
from .core.outline import Outline
from .core.params import Params
from .core.sequence import SequenceLayer
from .devices.start import Devices
from .measure.error_image import ErrorImage
from .measure.report import LayerError, NotMeasured, Report, StepTime, report_of, rounded
from .measure.target import Chosen


@dataclass(frozen=True)
class Baked:
    """`lit`: unshadowed diffuse radiance by light index, `composite`: that of all lights with all layers
    joined, each (height, width, 4) float32, alpha is coverage and colour premultiplied, row 0 at the bottom;
    empty and None where they were not asked for, or nothing is in view."""

    layers: LayerSet
    report: Report
    lit: dict[int, np.ndarray]
    composite: np.ndarray | None = None


def put_together(
    *,
    outline: Outline,
    graph: Graph,
    devices: Devices,
    execution: Execution,
    chosen: dict[str, Params],
    seed: int,
    samples: int,
    chunks: int,
    errors: dict[str, LayerError | NotMeasured],
    seconds: float,
    coarse_picture_seconds: float,
    memory: MemoryEstimate | None,
    warnings: Sequence[str],
    sequence: tuple[SequenceLayer, ...],
    missing: tuple[SequenceLayer, ...],
    has_picture: bool,
    chosen_samples: Mapping[str, Chosen],
    target_error: float,
    time_budget_s: float,
    placement: str,
    watching_seconds: Mapping[str, float],
    error_images: dict[str, ErrorImage],
) -> Baked:
    """`chosen`: parameters by effect id; `samples` are those of a pixel where nothing was chosen; `chunks` is
    how often a surface was made, `errors` by layer, as `error_images` are; `seconds` are of the whole bake
    and `coarse_picture_seconds` of its coarse picture. `chosen_samples`: of layers that were made in passes,
    for a `target_error` or a `time_budget_s`; `watching_seconds`: what looking at them took. `missing`: what
    the graph lacks of `sequence`, for which neutral layers stand. `has_picture`: there is a composite, also
    of nothing."""
    below, shot = _nodes_by_layer(graph), graph.shot
    own = _own_nodes(below)
    layers, costs = [], {}
    for layer in (layer for layer in graph.layers if layer.effect):
        # Any layer needs the coarse picture; it is a layer's own where there is no other.
        own_coarse_picture_seconds = coarse_picture_seconds if len(own) == 1 else 0.0
        costs[layer.name] = (
            own_coarse_picture_seconds + execution.seconds(own[layer.name]),
            coarse_picture_seconds + execution.seconds(below[layer.name], chunks),
        )
        error = errors[layer.name].to_json() if layer.name in errors else {}
        layers.append(
            Layer(
                layer.name,
                layer.channels,
                # Nothing is known outside a render region: what changes nothing there stands for it.
                shot.source.framed(execution.images[layer.name], layer.role.neutral),
                layer.effect,
                layer.light,
                layer.of,
                costs[layer.name][0],
                error,
                layer.params.as_dict(),
                weight=layer.weighed_by,
                placement=placement,
                samples=chosen_samples[layer.name].samples if layer.name in chosen_samples else samples,
            )
        )
    settings = {effect_id: params.as_dict() for effect_id, params in chosen.items()}
    layers += (layer.neutral(shot.size, settings.get(layer.effect, {})) for layer in missing)
    if sequence:
        places = {layer.name: place for place, layer in enumerate(sequence)}
        layers.sort(key=lambda layer: places.get(layer.name, len(places)))
    steps = [
        StepTime(timing.node.step.name, timing.node.instance, timing.device, timing.seconds)
        for timing in execution.timings.values()
    ]
    names = {layer.name for layer in layers}
    error_names = {name: error_name(name, names) for name in error_images}
    fallback = devices.fallback.name
    steps += (StepTime("error_image", name, fallback, image.seconds) for name, image in error_images.items())
    steps += (StepTime("watching", name, fallback, seconds) for name, seconds in watching_seconds.items())
    steps.insert(0, StepTime("coarse_picture", "camera", fallback, coarse_picture_seconds))
    report = report_of(
        outline=outline,
        graph=graph,
        backend=devices.primary.name,
        backend_reason=devices.reason,
        seed=seed,
        seconds=seconds,
        compile_seconds=devices.primary.compile_seconds,
        steps=steps,
        images=execution.images,
        memory=memory,
        costs=costs,
        errors=errors,
        warnings=warnings,
        neutral=missing,
        order=[layer.name for layer in layers],
        error_images=error_names,
        samples=samples,
        chosen_samples=chosen_samples,
        target_error=target_error,
        time_budget_s=time_budget_s,
        placement=placement,
    )
    width, height = shot.size
    raster = shot.source
    aspect = raster.pixel_aspect[0] / raster.pixel_aspect[1]
    layer_set = LayerSet(
        tuple(layers),
        width,
        height,
        outline.view_layer_name,
        outline.working_space,
        report.to_json(),
        aspect,
        raster.region,
        raster.frame_size if raster.region and raster.crop else None,
        outline.stamp,
        tuple(
            _error_layer(
                error_names[layer.name],
                layer,
                error_images[layer.name],
                raster.framed(error_images[layer.name].pixels),
            )
            for layer in layers
            if layer.name in error_images
        ),
    )
    pictures = {
        layer.of.index if layer.of.is_lamp else None: shot.source.framed(execution.images[layer.name])
        for layer in graph.layers
        if not layer.effect
    }
    picture = pictures.pop(None, None)
    if picture is None and has_picture and sequence:
        picture = np.broadcast_to(np.float32(0.0), (height, width, 4))  # as other frames have one
    return Baked(layer_set, report, pictures, picture)


def _error_layer(name: str, layer: Layer, image: ErrorImage, pixels: np.ndarray) -> Layer:
    """As the file has it: `pixels` are the image's in the frame."""
    fewest, mean = image.rays
    told = {
        "strata:error_of": layer.name,
        "strata:metric": image.metric,
        "strata:noise": rounded(image.noise),
        "strata:fewest_rays": float(fewest),
        "strata:mean_rays": rounded(mean),
        "strata:seconds": rounded(image.seconds),
    }
    return Layer(name, "V", pixels, effect="", attributes=told)


def _nodes_by_layer(graph: Graph) -> dict[str, tuple[Node, ...]]:
    """What each layer of the file is made of, and what its samples weigh, but for what of that is other
    layers: they are there with or without it."""
    layers = [layer for layer in graph.layers if layer.effect]
    below = {layer.name: graph.nodes([layer.node]) for layer in layers}
    made = {node for nodes in below.values() for node in nodes}
    for layer in (layer for layer in layers if layer.weight is not None):
        below[layer.name] += tuple(node for node in graph.nodes([layer.weight]) if node not in made)
    return below


def _own_nodes(below: dict[str, tuple[Node, ...]]) -> dict[str, list[Node]]:
    """By layer, the nodes that no other layer of the file reads."""
    readers = Counter(node for nodes in below.values() for node in nodes)
    return {name: [node for node in nodes if readers[node] == 1] for name, nodes in below.items()}
