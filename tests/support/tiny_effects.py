"""Effects of a few lines, for what no effect that there is does. They are given to a bake by its registry."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from strata.addon.core.effect import Effect, LayerKind, Registry
from strata.addon.core.graph import Rate, Step
from strata.addon.core.params import Params
from strata.addon.core.roles import Of, Role, Subject
from strata.addon.core.shader import Shader
from strata.addon.effects.registry import EFFECTS
from strata.addon.effects.shared.steps import SURFACE, geometry, surface

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class NoParams(Params):
    """Nothing to set."""


def effect(id: str, layers: tuple[LayerKind, ...], run, **more) -> Effect:
    return Effect(id, NoParams, layers, lambda outline: None, run, "For tests.", "none", **more)


def registry(*effects: Effect) -> Registry:
    """All effects that there are, and these."""
    return Registry((*EFFECTS, *effects))


def points(recorder, outline):
    return surface(recorder, outline, "position")


def shader(name: str, *defines: str) -> Shader:
    """Of `position`, into an image `result`."""
    return Shader(
        str(FOLDER / name),
        defines=defines,
        samplers=(("position", "FLOAT_2D"),),
        images=(("result", "RGBA32F", "WRITE"),),
        params=("size", "value"),
    )


def dispatched(device, program: Shader, surface, value=(), channels: int = 4):
    shape = surface["position"].shape[:2]
    result = device.new_image((*shape, channels) if channels > 1 else shape)
    if channels == 1:
        program = Shader(**vars(program) | {"images": (("result", "R32F", "WRITE"),)})
    params = {"size": shape[::-1], "value": value}
    device.dispatch(program, shape[::-1], {"result": result}, {"position": surface["position"]}, params)
    return result


# A coloured gobo before every lamp: what of its light passes, by the place alone.


def _gobo(device, surface, colour):
    share = 0.5 + 0.5 * np.tanh(surface["position"][..., :1])
    return (np.float32(colour) * share).astype(np.float32)


def _gobo_gpu(device, surface, colour):
    return dispatched(device, shader("tiny.glsl", "GOBO"), surface, colour, channels=3)


GOBO_STEP = Step("tiny gobo", cpu=_gobo, gpu=_gobo_gpu)


def gobo(title: str, role: Role = Role.FILTER) -> Effect:
    kind = LayerKind(title, "RGB", of=Subject.LAMP, role=role)

    def run(recorder, outline, params):
        for index in recorder.lamps_for(kind):
            node = recorder.step(GOBO_STEP, points(recorder, outline), colour=(1.0, 0.25 + index, 0.125))
            recorder.layer(kind, node, Of.lamp(index))

    return effect(title.lower(), (kind,), run)


GOBO = gobo("Gobo")

# A second way to shadow a lamp: half of its light arrives, everywhere.

HALF_KIND = LayerKind("Half Shadow", "V", of=Subject.LAMP, role=Role.VISIBILITY)


def _half(device, surface):
    return np.full(surface["position"].shape[:2], 0.5, np.float32)


def _half_gpu(device, surface):
    return dispatched(device, shader("tiny.glsl", "HALF"), surface, channels=1)


HALF_STEP = Step("tiny half shadow", cpu=_half, gpu=_half_gpu)


def _half_visibility(recorder, outline, params, of):
    return recorder.step(HALF_STEP, points(recorder, outline)), frozenset()


def _run_half(recorder, outline, params):
    for index in recorder.lamps_for(HALF_KIND):
        node, casters = _half_visibility(recorder, outline, params, Of.lamp(index))
        recorder.layer(HALF_KIND, node, Of.lamp(index), casters)


HALF_SHADOW = effect("half_shadow", (HALF_KIND,), _run_half, offers={Role.VISIBILITY: _half_visibility})

# An effect that looks at one object through all others: at a surface that no other effect shares.

BEHIND_KIND = LayerKind("Behind", "V", role=Role.NONE)


def _run_behind(recorder, outline, params):
    visible = frozenset({0})
    recorder.reads_instances(visible)
    scene, view = geometry(recorder, outline), recorder.shot.view
    node = recorder.step(SURFACE, scene, instance="behind", view=view, visible=visible)
    recorder.layer(BEHIND_KIND, recorder.step(HALF_STEP, recorder.surface(node, "position")))


BEHIND = effect("behind", (BEHIND_KIND,), _run_behind)

# Two panes of coloured glass that cross: each is before the other on one side of the picture.

PANES = (
    (LayerKind("Red Pane", "RGBA", role=Role.OVER), (0.5, 0.1, 0.0, 0.75), 1.0),
    (LayerKind("Blue Pane", "RGBA", role=Role.OVER), (0.0, 0.1, 0.4, 0.5), -1.0),
)


def _pane(device, surface, colour):
    return np.broadcast_to(np.float32(colour), (*surface["position"].shape[:2], 4)).copy()


def _pane_gpu(device, surface, colour):
    return dispatched(device, shader("tiny.glsl", "PANE"), surface, colour)


def _slope(device, surface, slope):
    return np.ascontiguousarray(np.float32(5.0) + np.float32(slope) * np.tanh(surface["position"][..., 0]))


def _slope_gpu(device, surface, slope):
    return dispatched(device, shader("tiny.glsl", "SLOPE"), surface, (slope,), channels=1)


PANE_STEP = Step("tiny pane", cpu=_pane, gpu=_pane_gpu)
SLOPE_STEP = Step("tiny pane's depth", cpu=_slope, gpu=_slope_gpu)


def _run_panes(recorder, outline, params):
    for kind, colour, slope in PANES:
        node = recorder.step(PANE_STEP, points(recorder, outline), colour=colour)
        depth = recorder.step(SLOPE_STEP, points(recorder, outline), slope=slope)
        recorder.layer(kind, node, depth=depth)


CROSSED_PANES = effect("crossed_panes", tuple(kind for kind, _, _ in PANES), _run_panes)

# A lens that shows the picture upside down and half as bright.


def _flipped(device, picture):
    return np.ascontiguousarray(np.float32(0.5) * picture[::-1])


LENS_STEP = Step("tiny lens", cpu=_flipped, rate=Rate.PICTURE, hole="a test needs no second one")


def _look_through(recorder, outline, params, of, picture):
    return recorder.step(LENS_STEP, picture)


LENS = effect("lens", (), lambda recorder, outline, params: None, offers={Role.PICTURE: _look_through})
