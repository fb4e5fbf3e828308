"""What an error means to an eye, in words; the same in the viewport, the panel, the table and the sheet.

One rule for all: root mean square differences, as shares of the brightness there. A picture of 8 bits rounds
its middle grey by up to half a step of 1.9%: 0.55% root mean square. What is less than that is lost in the
file that anybody looks at. An eye tells two patches from each other that differ by one or two percent
(Weber's law), which is that one step: up to there an error shows only side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING

from ..core.params import Params, ParamSpec, in_words

if TYPE_CHECKING:
    from .report import LayerError

INVISIBLE_UP_TO = 0.005
FINE_UP_TO = 0.02
LEAST_SHOWN = 0.001
MOST_SETTINGS = 3  # named in one piece of advice
HALF = 0.5  # of an error: what a display hides, or what colour adds, from where on it is worth saying

USES = {
    "in use": "multiplied onto {onto}, off by {amount} of the brightness",
    "in use, added": "added to the picture, off by {amount} of the brightness",
    "share of wrong pixels": "{amount} of its pixels are wrong",
    # Of files that earlier versions baked.
    "weighted rmse": "off by {amount} at surface points (weighted RMSE, not the error in use)",
    "relative l2": "off by {amount} of its mean at pixel centres (relative L2, not the error in use)",
}
"""What a figure is of, by its metric."""


class Verdict(Enum):
    """How much of an error is to be seen."""

    INVISIBLE = "invisible"
    FINE = "fine"
    VISIBLE = "visible"


def verdict(rms: float) -> Verdict:
    """Of a root mean square difference, as a share of the brightness."""
    if rms <= INVISIBLE_UP_TO:
        return Verdict.INVISIBLE
    return Verdict.FINE if rms <= FINE_UP_TO else Verdict.VISIBLE


def worded(rms: float, high: float | None) -> str:
    """`fine`; `fine, perhaps visible` where the interval reaches up to `high`, None: nobody knows how far."""
    found, worst = verdict(rms), Verdict.VISIBLE if high is None else verdict(high)
    return found.value if worst == found else f"{found.value}, perhaps {worst.value}"


def off_by(metric: str, amount: str, light: str = "") -> str:
    """`multiplied onto its light, off by 2.0% of the brightness`, for an `amount` of 2.0%; `light`: the
    layer's, empty where it has none."""
    onto = "its light" if light else "the picture"
    return USES.get(metric, f"{metric}: {{amount}}").format(onto=onto, amount=amount)


def causes(error: LayerError, settings: Sequence[str] = (), params: type[Params] | None = None) -> list[str]:
    """Where an error comes from and what lowers it, one clause each; `settings` as a score names them
    (`lowered_by`), none where it is not to be seen."""
    found = []
    if error.unknown:
        found.append("perhaps by any amount, since part of the scene is not read")
    if error.unread:
        found.append(f"perhaps by up to {percent(error.ci95[1])}, since a material's opacity is not read")
    if settings and error.method is not None and error.sampling is not None:
        if verdict(error.value) is Verdict.INVISIBLE:
            return found  # only the interval reaches further: there is nothing to lower that is known of
        if error.sampling > error.method:
            found.append("most of it is aliasing: more samples")
        elif _is_noise(settings, params):
            found.append(f"most of it is noise: more samples or {names_of(settings[:1], params)}")
        else:
            found.append(f"most of it is the method: {names_of(settings, params)}")
    elif settings:
        found.append(advice(settings, params))
    if settings and error.display is not None and error.display < HALF * error.value:
        found.append(f"on a display {percent(error.display)}, since white is clipped")
    if error.model is not None and error.model > max(INVISIBLE_UP_TO, HALF * error.value):
        found.append(f"besides {percent(error.model)} of colour, which one channel cannot hold")
    return found


def told(
    error: LayerError, light: str, settings: Sequence[str] = (), params: type[Params] | None = None
) -> str:
    """All that is said of one layer's error, in one line; empty where it has no causes."""
    clauses = causes(error, settings, params)
    return "; ".join([off_by(error.metric, percent(error.value), light), *clauses]) if clauses else ""


def advice(settings: Sequence[str], params: type[Params] | None = None) -> str:
    """`lower it with Method Hybrid, Map Size`, as panels call the settings of an effect; empty where nothing
    does."""
    return f"lower it with {names_of(settings, params)}" if settings else ""


def names_of(settings: Sequence[str], params: type[Params] | None) -> str:
    """`Method Hybrid, Map Size`, as panels call them."""
    specs = {spec.name: spec for spec in params.specs()} if params else {}
    return ", ".join(_called(name, specs) for name in settings[:MOST_SETTINGS])


def _is_noise(settings: Sequence[str], params: type[Params] | None) -> bool:
    """Whether what lowers it most lowers an error that more samples lower too."""
    return any(spec.lowers_noise and spec.name == settings[0] for spec in (params.specs() if params else ()))


def _called(setting: str, specs: dict[str, ParamSpec]) -> str:
    name, _, value = setting.partition("=")
    if name not in specs:
        return in_words(name)
    spec = specs[name]
    return f"{spec.label} {spec.words.get(value, in_words(value))}".strip()


def percent(share: float) -> str:
    """For a person: `12%`, `1.2%`, `below 0.1%`. Never nothing, since no more than that is known."""
    if share < LEAST_SHOWN:
        return f"below {100.0 * LEAST_SHOWN:g}%"
    return f"{100.0 * share:.1f}%" if share < 0.0995 else f"{100.0 * share:.0f}%"


def interval_words(low: float, high: float | None) -> str:
    """`1.1% to 1.3%`, for a person; `0% or more` without an upper end."""
    if high is None:
        return f"{percent(low) if low >= LEAST_SHOWN else '0%'} or more"
    if high < LEAST_SHOWN:
        return percent(high)
    return f"{percent(low) if low >= LEAST_SHOWN else '0%'} to {percent(high)}"
