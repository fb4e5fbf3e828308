"""Parameters, declared once: panel rows, command-line flags, docs, uniforms and sweeps are made from this."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from typing import Any, ClassVar, Self, get_type_hints

from .conditions import ALWAYS, Condition, When, both
from .errors import StrataError
from .ramp import Ramp, srgb_code, srgb_colour


class Colour(tuple[float, float, float]):
    """Linear RGB in the working space, as the kind of a parameter."""

    __slots__ = ()

    def __new__(cls, red: float, green: float, blue: float):
        return super().__new__(cls, (red, green, blue))

    def __getnewargs__(self):
        return tuple(self)

    def __str__(self) -> str:
        return srgb_code(self)


class Lamp(str):
    """The name of a lamp, or empty, as the kind of a parameter: by itself, or as Outline's lights have it."""

    __slots__ = ()


@dataclass(frozen=True)
class Group:
    """Parameters that belong together, under a heading of their own. `switch` names the one of them that
    switches the others on; `is_open`: not folded up at first."""

    title: str
    switch: str = ""
    is_open: bool = False
    used_when: Condition = ALWAYS


NO_GROUP = Group("")
_IN_LABELS = {"m": ("_m", ""), "pixel": ("_px", ""), "1/m": ("_per_m", "/m")}
"""By unit: how names end with it, and labels, where no value shows it."""


@dataclass(frozen=True)
class ParamSpec:
    """One parameter: `kind` is int, float, bool, str, a Lamp, an Enum of strings, a Colour or a Ramp; `hard`
    is what is accepted, `soft` what a slider offers, both inclusive (of each of a Colour's channels);
    `trades_time` says that raising it costs time and lowers error, or that its choices differ so;
    `per_light` that a light may have a value of its own.

    `label` is what a panel calls it, short enough for its column, `group` where it stands there, `words` what
    choices are called where that is not the value itself; `used_when` is where it counts at all, which for
    members of a group includes what holds for that; `unlimited` is a word for the greatest value accepted,
    where that means no limit; `object_only`: of what objects have of their own, materials do not have it;
    `lowers_noise`: what raising it lowers is another error in each of a pixel's samples, so that more of
    those lower it as well; `automatic`: what the default stands for on a device that traces rays itself,
    and on others, where it is no value but leaves that open."""

    name: str
    kind: type
    default: Any
    hard: tuple[float, float] | None
    soft: tuple[float, float] | None
    unit: str
    trades_time: bool
    doc: str
    per_light: bool = False
    label: str = ""
    group: Group = NO_GROUP
    used_when: Condition = ALWAYS
    unlimited: str = ""
    words: dict[str, str] = field(default_factory=dict, hash=False)
    object_only: bool = False
    lowers_noise: bool = False
    automatic: tuple[Any, Any] | None = None

    def settled(self, value: Any, traces_rays: bool) -> Any:
        """What the value, or a choice's word, stands for (`automatic`)."""
        if self.automatic is None or plain(value) != plain(self.default):
            return value
        return self.automatic[0 if traces_rays else 1]

    @property
    def is_of_file(self) -> bool:
        """Whether panels choose a part of the Blender file for it, which no other file has."""
        return self.kind in (Ramp, Lamp)

    @property
    def choices(self) -> tuple[str, ...]:
        return tuple(member.value for member in self.kind) if issubclass(self.kind, Enum) else ()

    def check(self, owner: str, value: Any) -> Any:
        """The value as `kind`. Raises StrataError naming the parameter and its range."""
        where = f"{owner}.{self.name}"
        if issubclass(self.kind, Enum):
            word = value.value if isinstance(value, Enum) else str(value)
            if word not in self.choices:
                raise StrataError(f"{where}: '{word}' is not one of {', '.join(self.choices)}")
            return self.kind(word)
        if self.kind is bool:
            return self._check_bool(where, value)
        if issubclass(self.kind, str):
            return self.kind(value)
        if self.kind is Colour:
            return self._check_colour(where, value)
        if self.kind is Ramp:
            return self._check_ramp(where, value)
        try:
            number = self.kind(value)
        except (TypeError, ValueError, OverflowError):
            noun = "a whole number" if self.kind is int else "a number"
            raise StrataError(f"{where}: '{value}' is not {noun}") from None
        if isinstance(number, float) and math.isnan(number):
            raise StrataError(f"{where}: not a number")
        if self.kind is float and self.hard:
            # Blender keeps properties in float32, which may lie a little beyond a limit like pi.
            near = [limit for limit in self.hard if abs(number - limit) <= 1e-6 * abs(limit)]
            number = near[0] if near else number
        if self.hard and not self.hard[0] <= number <= self.hard[1]:
            raise StrataError(f"{where}: {value} is outside {self.hard[0]} to {self.hard[1]}")
        return number

    def _check_colour(self, where: str, value: Any) -> Colour:
        """From three numbers, or from `#rrggbb` (sRGB) or `0.1,0.2,0.3` (linear)."""
        try:
            if isinstance(value, str):
                value = srgb_colour(value) if value.startswith("#") else map(float, value.split(","))
            colour = Colour(*map(float, value))
        except (TypeError, ValueError):
            raise StrataError(f"{where}: '{value}' is not a colour like #ff8000 or 1,0.2,0") from None
        low, high = self.hard or (-math.inf, math.inf)
        if not all(math.isfinite(channel) and low <= channel <= high for channel in colour):
            raise StrataError(f"{where}: {tuple(colour)} is outside {low} to {high}")
        return colour

    @staticmethod
    def _check_ramp(where: str, value: Any) -> Ramp:
        if isinstance(value, Ramp):
            return value
        try:
            return Ramp.parse(str(value))
        except StrataError as error:
            raise StrataError(f"{where}: {error}") from None

    @staticmethod
    def _check_bool(where: str, value: Any) -> bool:
        words = {"true": True, "1": True, "on": True, "false": False, "0": False, "off": False}
        if str(value).lower() not in words:
            raise StrataError(f"{where}: '{value}' is neither true nor false")
        return words[str(value).lower()]


def param(default, *, doc, hard=None, soft=None, unit="", trades_time=False, **more):
    """A field of a Params class; `more` are further fields of ParamSpec."""
    ranges = {"hard": hard, "soft": soft or hard, "unit": unit}
    metadata = {**ranges, "trades_time": trades_time, "doc": doc, **more}
    return dataclasses.field(default=default, metadata=metadata)


def in_words(name: str) -> str:
    """`max_samples` as a label: Max Samples."""
    return name.replace("_", " ").title()


def _spec(name: str, kind: type, default: Any, metadata: dict[str, Any]) -> ParamSpec:
    spec = ParamSpec(name, kind, default, **metadata)
    ending, shown = _IN_LABELS.get(spec.unit, ("", ""))
    label = spec.label or in_words(name.removesuffix(ending)) + shown
    group, used_when = spec.group, spec.used_when
    if group.switch != name:
        switched = (When(group.switch, (True,)),) if group.switch else ()
        used_when = both(group.used_when, *switched, used_when)
    return dataclasses.replace(spec, label=label, used_when=used_when)


@dataclass(frozen=True)
class Params:
    """Base of an effect's parameters: a frozen dataclass of `param` fields. `target_error` is one of them
    where the effect's layers are measured (`with_target`)."""

    target_error: ClassVar[float] = 0.0

    @classmethod
    @cache
    def specs(cls) -> tuple[ParamSpec, ...]:
        kinds = get_type_hints(cls)
        return tuple(
            _spec(each.name, kinds[each.name], each.default, each.metadata)
            for each in dataclasses.fields(cls)
        )

    @classmethod
    def checked(cls, owner: str, values: dict[str, Any]) -> Params:
        """Defaults with `values` over them. Raises StrataError on an unknown name or a bad value."""
        specs = {spec.name: spec for spec in cls.specs()}
        for name in values:
            if name not in specs:
                raise StrataError(f"{owner} has no parameter '{name}'; it has {', '.join(specs)}")
        return cls(**{name: specs[name].check(owner, value) for name, value in values.items()})

    def settled(self, traces_rays: bool) -> Self:
        """With what was left automatic chosen, for a device that traces rays itself, or one that does not."""
        chosen = {
            spec.name: spec.settled(getattr(self, spec.name), traces_rays)
            for spec in self.specs()
            if spec.automatic is not None
        }
        return dataclasses.replace(self, **chosen) if chosen else self

    def lighter(self, share: float) -> Params:
        """Parameters for a frame of about `share` of the work, while something moves in a preview."""
        return self

    def finer(self) -> tuple[str, ...]:
        """Settings that lower the error from here on, most useful first: the name of one to raise, or
        `name=value`."""
        return tuple(
            spec.name
            for spec in self.specs()
            if spec.trades_time
            and not spec.choices
            and spec.used_when.holds(self.__getattribute__)
            and (spec.hard is None or getattr(self, spec.name) < spec.hard[1])
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        values = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        return {name: plain(value) for name, value in values.items()}


def with_target[P: Params](params: type[P], per_light: bool) -> type[P]:
    """The same parameters and a target error of their own."""
    if any(spec.name == "target_error" for spec in params.specs()):
        return params
    target = param(
        0.0,
        hard=(0.0, 0.99),
        soft=(0.0, 0.1),
        per_light=per_light,
        doc="Its layers get as many samples as bring their error down to this, in place of the bake's target "
        "error; 0: the bake's",
    )
    fields = [("target_error", float, target)]
    return dataclasses.make_dataclass(
        params.__name__, fields, bases=(params,), frozen=True, module=params.__module__
    )


def plain(value: Any) -> Any:
    """A parameter's value as JSON knows it: an Enum's word, a Ramp's text, a Colour's three numbers."""
    if isinstance(value, Enum):
        return value.value
    return str(value) if isinstance(value, Ramp) else list(value) if isinstance(value, Colour) else value


OwnSettings = tuple[tuple[str, str, Any], ...]
"""Settings that a light, an object or a material has of its own: effect's id, parameter and value."""


def with_own[P: Params](params: P, own: OwnSettings, effect_id: str) -> P:
    """`params` of the effect with what of `own` is for it over them. Raises StrataError on a bad value."""
    values = {name: value for effect, name, value in own if effect == effect_id}
    if not values:
        return params
    return type(params).checked(effect_id, {**vars(params), **values})
