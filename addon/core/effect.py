"""An effect's whole declaration."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

from .errors import StrataError
from .params import Params, in_words, with_target
from .roles import Role, Subject
from .score import Score
from .shader import Shader


class Reduce(Enum):
    """How a pixel's samples become its value (core/film.py). MEAN: weighted where samples weigh
    (`PlannedLayer.weight`); FIRST: of what has no mean, such as ids."""

    MEAN = "mean"
    FIRST = "first"


class Need(Enum):
    """What an effect or a layer cannot do without."""

    EYE = "an eye"  # that looks along rays


def no_shaders() -> Iterable[Shader]:
    """Of an effect that runs on the CPU only."""
    return ()


@dataclass(frozen=True)
class LayerKind:
    """The layers an effect makes: one for each that they are `of`. `title` is the pass name's first part,
    `channels` one letter each, "V" or "RGB"; `role` is what they are to the picture.

    `reduce` is how a pixel's samples become its value. `score` tells how wrong they are (core/score.py);
    None: nobody measures them. `needs`: what a shot must have for them, beside what the effect needs; the
    effect asks for it (`Recorder.shot_has`). `is_weighed`: its samples weigh what they multiply, where it
    multiplies (effects/shared/weights.py); not so of what is drawn on the picture, such as dots of ink, whose
    plain mean is what they cover. `is_spread`: its samples are one number for all channels (`in_colour`).
    """

    title: str
    channels: str
    score: Score | None = None
    of: Subject = Subject.NOTHING
    role: Role = Role.NONE
    reduce: Reduce = Reduce.MEAN
    doc: str = ""
    needs: frozenset[Need] = frozenset()
    is_weighed: bool = True
    is_spread: bool = False

    def __post_init__(self):
        if self.role.needs_lamp and self.of is not Subject.LAMP:
            raise ValueError(f"'{self.title}' is {self.role.value}, and of no lamp")
        if self.role is Role.OVER and self.channels != "RGBA":
            raise ValueError(f"'{self.title}' lies over the picture by its alpha, and has none")

    def in_colour(self) -> LayerKind:
        """Of a lamp's shadow, one whose samples weigh channel by channel; other layers stay as they are."""
        is_grey_shadow = self.role is Role.VISIBILITY and len(self.channels) == 1
        return replace(self, channels="RGB", is_spread=True) if is_grey_shadow else self


def not_ruled_out(kind: LayerKind, light: Any, params: Any, has_media: bool) -> bool:
    """Of an effect whose layers any frame may need."""
    return False


@dataclass(frozen=True)
class Effect:
    """`id` is the folder's name. `run(recorder, outline, params)` records steps; `needed(outline)` gives the
    reason why the scene does not need the effect, or None; `offers`: by role, what the picture and other
    effects may build on (`Recorder.ask`), recorded by `record(recorder, outline, params, of, *inputs)`;
    `shaders()` yields every GPU program that its steps may compile; `presets` are values by name, over the
    defaults; `object_params` are what an object or a material may have of its own. `params` get a target
    error where layers are measured. Not `on_by_default`: a style, which would cover the picture of a scene
    that never asked for it. `needs`: what a shot must have for any of it.

    `ruled_out(kind, light, params, has_media)`: whether no frame can need a layer of that kind as long as the
    lamp and the parameters are these, whatever moves; either is None where it may change, and a light's place
    and size do not count. `has_media`: some material or the world has a volume.
    """

    id: str
    params: type[Params]
    layers: tuple[LayerKind, ...]
    needed: Callable
    run: Callable
    doc: str
    source: str
    offers: dict[Role, Callable] = field(default_factory=dict, hash=False, compare=False)
    shaders: Callable[[], Iterable[Shader]] = no_shaders
    object_params: type[Params] | None = None
    on_by_default: bool = True
    ruled_out: Callable[[LayerKind, Any, Any, bool], bool] = not_ruled_out
    presets: dict[str, dict[str, Any]] = field(default_factory=dict, hash=False, compare=False)
    needs: frozenset[Need] = frozenset()

    def __post_init__(self):
        for kind in self.layers:
            if kind.role.is_exclusive and kind.role not in self.offers:
                raise ValueError(f"'{kind.title}' is {kind.role.value}, which '{self.id}' does not offer")
        if measured := [kind for kind in self.layers if kind.score]:
            of_lamps = any(kind.of is Subject.LAMP for kind in measured)
            object.__setattr__(self, "params", with_target(self.params, of_lamps))

    @property
    def title(self) -> str:
        """What people call it."""
        return in_words(self.id)


@dataclass(frozen=True)
class Offer:
    """What `effect` offers (`Effect.offers`), with its parameters. `is_chosen`: it is not there only for
    others to build on."""

    effect: Effect
    params: Params
    record: Callable
    is_chosen: bool


class Registry(tuple[Effect, ...]):
    """Effects, in the order of the panel."""

    def named(self, name: str) -> Effect:
        """Raises StrataError if there is none."""
        for effect in self:
            if effect.id == name:
                return effect
        raise StrataError(f"no effect '{name}'; there is {', '.join(effect.id for effect in self)}")
