"""Which layers a sequence has: those that any frame of the scene's range needs, whichever frames are baked,
so that all its files have the same, also where several machines make them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from .core.effect import Effect, LayerKind, Registry
from .core.emitter import EmitterKind
from .core.errors import StrataError
from .core.naming import layer_name
from .core.outline import Light, Outline, emitter_measure
from .core.roles import Subject
from .core.sequence import SequenceLayer
from .planning import Options, plan_scene

STAGE = "Looking which layers the sequence needs"


def sequence_layers(
    scene,
    view_layer,
    options_of: Callable[[Any], Options],
    frames: Sequence[int],
    camera=None,
    size=None,
    show: Callable[[float, str], None] | None = None,
) -> tuple[SequenceLayer, ...] | None:
    """In the order of the file; None where no frame can differ from another, so that each has by itself what
    it needs. `frames` are those to bake, the rest as in `read_job`; `show` is told the share done, and may
    raise to stop. Boxes decide, as in a plan. Only on the main thread; the scene stays at its frame.
    """
    from .scene.changing import may_change
    from .scene.render_depsgraph import with_render_frames
    from .scene.scan import ScanOptions, scan

    first, last = scene.frame_start, max(scene.frame_start, scene.frame_end)
    if set(frames) == {first} == {last} or not may_change(scene):
        return None
    order = list(coarse_to_fine(first, last, frames[0]))

    def read(depsgraph, go_to) -> tuple[SequenceLayer, ...]:
        found: dict[str, SequenceLayer] = {}
        candidates = None
        for number, frame in enumerate(order):
            if show:
                show(number / len(order), STAGE)
            go_to(frame)
            options = replace(options_of(depsgraph.scene_eval), lit=False, composite=False)
            # Told by the scene itself: a marker may have switched it after the evaluation.
            which = camera or depsgraph.scene.camera
            try:
                scanned = scan(depsgraph, ScanOptions(size, which.name if which else None))
            except StrataError:
                continue  # told by the bake of that frame
            if candidates is None:
                candidates = _Candidates.of(depsgraph, options)
            candidates.rule_out(scanned.outline, options)
            graph = plan_scene(scanned.outline, scanned.shot, candidates.narrowed(options))
            for layer in graph.layers:
                found.setdefault(layer.name, SequenceLayer.of(layer))
            if candidates.are_all_in(found):
                break
        return tuple(sorted(found.values(), key=lambda layer: _place(layer, options.registry)))

    return with_render_frames(scene, view_layer, read, order[0], camera)


def coarse_to_fine(first: int, last: int, start: int) -> Iterator[int]:
    """Every frame of a range once: `start` where it is in it, both ends, then ever finer steps between."""
    given = set()
    strides = [2**power for power in reversed(range((last - first + 1).bit_length()))]
    for frame in (start, first, last, *(n for stride in strides for n in range(first, last + 1, stride))):
        if first <= frame <= last and frame not in given:
            given.add(frame)
            yield frame


def _place(layer: SequenceLayer, registry: Registry) -> tuple[int, int, str]:
    """Where it stands in the file: by effect, kind and name."""
    effect = registry.named(layer.effect)
    titles = [kind.title for kind in effect.layers]
    return registry.index(effect), titles.index(layer.kind.title), layer.name


@dataclass(eq=False)
class _Candidates:
    """What some frame might need and none has so far: once all of them are found, no more frames have to be
    looked at. `waiting`: by layer's name, its effect, kind and lamp's pass name. `complete`: whether there
    may be no others."""

    waiting: dict[str, tuple[Effect, LayerKind, str]]
    still_lamps: frozenset[str]
    has_media: bool
    complete: bool

    @classmethod
    def of(cls, depsgraph, options: Options) -> _Candidates:
        from .scene import changing
        from .scene.lamp_names import LampNames

        scene, view_layer = depsgraph.scene, depsgraph.view_layer
        lamps = [
            named
            for named in LampNames().standing(view_layer)
            if options.wants(named.name, named.pass_name) and not changing.is_surely_hidden(named.path)
        ]
        waiting = {
            layer_name(kind.title, lamp): (effect, kind, lamp)
            for effect in options.chosen()
            for kind in effect.layers
            if kind.of is Subject.LAMP or options.lights is None
            for lamp in ([named.pass_name for named in lamps] if kind.of is Subject.LAMP else [""])
        }
        still = frozenset(n.pass_name for n in lamps if not changing.is_animated(n.lamp.data))
        complete = not (changing.settings_may_change(scene) or changing.may_make_lamps())
        return cls(waiting, still, changing.may_have_media(), complete)

    def rule_out(self, outline: Outline, options: Options) -> None:
        """Those that no frame can need, as far as this one shows."""
        if not self.complete:
            return
        params = {effect.id: params for effect, params in options.chosen().items()}
        lights = {light.pass_name: light for light in outline.lights if light.pass_name in self.still_lamps}
        for name, (effect, kind, lamp) in list(self.waiting.items()):
            light = lights.get(lamp)
            light = None if light is None or _has_no_size(light) else light
            if effect.ruled_out(kind, light, params[effect.id], self.has_media):
                del self.waiting[name]

    def narrowed(self, options: Options) -> Options:
        """Without effects that have no candidate left."""
        if not self.complete:
            return options
        waiting = {effect.id for effect, _, _ in self.waiting.values()}
        return replace(options, effects=tuple(e.id for e in options.chosen() if e.id in waiting))

    def are_all_in(self, found: dict[str, SequenceLayer]) -> bool:
        for name in found:
            self.waiting.pop(name, None)
        return self.complete and not self.waiting


def _has_no_size(light: Light) -> bool:
    """Dark as long as it is: an object's scale may change."""
    is_area = light.emitter.kind in (EmitterKind.RECTANGLE, EmitterKind.ELLIPSE)
    return is_area and emitter_measure(light.emitter) == 0.0
